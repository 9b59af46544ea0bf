"""Weights as safetensors with metadata that says what they were made for, and a readable card beside them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from hpp_framework.errors import CheckpointError

FORMAT = 1


def save_checkpoint(file: Path, weights: Mapping[str, Tensor], metadata: Mapping[str, Any]) -> None:
    """Write weights and their card (``FILE.json``).

    Args:
        file: ends in ``.safetensors``.
        weights: a state dict.
        metadata: what the weights were made for and with; JSON-compatible.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    described = {"format": FORMAT, **metadata}
    tensors = {name: tensor.detach().cpu().contiguous().float() for name, tensor in weights.items()}
    temporary = file.with_suffix(".tmp")
    save_file(tensors, temporary, metadata={"card": json.dumps(described)})
    temporary.replace(file)
    file.with_suffix(".json").write_text(json.dumps(described, indent=2) + "\n")


def load_checkpoint(file: Path, expected: Mapping[str, Any]) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Read weights, refusing those made for something else.

    Args:
        file: written by :func:`save_checkpoint`.
        expected: metadata that must be equal, e.g. ``{"robot": "fetch", "beams": 222}``.

    Returns:
        The state dict and all metadata.

    Raises:
        CheckpointError: if the file is missing or damaged, or its metadata differ; names the field.
    """
    if not file.is_file():
        raise CheckpointError(f"weights file '{file}' does not exist.")
    try:
        with safe_open(file, framework="pt") as stream:
            metadata = json.loads((stream.metadata() or {}).get("card", "{}"))
            weights = {name: stream.get_tensor(name) for name in stream.keys()}  # noqa: SIM118  # not a dict
    except (SafetensorError, OSError, json.JSONDecodeError) as error:
        raise CheckpointError(
            f"weights file '{file}' cannot be read: {error}. Train or copy it again."
        ) from error
    for key, value in expected.items():
        if metadata.get(key) != value:
            raise CheckpointError(
                f"weights file '{file}' was made for {key} = {metadata.get(key)!r}, but {value!r} is needed."
            )
    return weights, metadata


def load_into(module: torch.nn.Module, weights: Mapping[str, Tensor], file: Path) -> None:
    """Load a state dict into a module.

    Raises:
        CheckpointError: if names or shapes do not fit.
    """
    try:
        module.load_state_dict(dict(weights))
    except RuntimeError as error:
        raise CheckpointError(f"weights file '{file}' does not fit the network: {error}") from error
