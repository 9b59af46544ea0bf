"""Weights as safetensors with metadata that says what they were made for, and a readable card beside them."""

from __future__ import annotations

import hashlib
import json
import os
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import CheckpointError, ConfigError
from hpp_framework.utils.run_folder import write_bytes, write_json

FORMAT = 1
WEIGHTS_VARIABLE = "HPP_WEIGHTS"
"""Environment variable with more folders of weights, separated as in PATH; workers inherit it."""

RESUMES = (
    "Free space or allow writing; the same command then resumes from the last snapshot, if there is one."
)


def save_checkpoint(file: Path, weights: Mapping[str, Tensor], metadata: Mapping[str, Any]) -> None:
    """Write weights and their card (``FILE.json``).

    Args:
        file: ends in ``.safetensors``.
        weights: a state dict.
        metadata: what the weights were made for and with; JSON-compatible.

    Raises:
        CheckpointError: if the file cannot be written, e.g. because the disk is full; an earlier one is kept.
    """
    described = {"format": FORMAT, **metadata}
    tensors = {name: tensor.detach().cpu().contiguous().float() for name, tensor in weights.items()}
    content = save(tensors, metadata={"card": json.dumps(described)})
    write_bytes(file, content, remedy=RESUMES, error=CheckpointError)
    write_json(file.with_suffix(".json"), described, remedy=RESUMES, error=CheckpointError)


def load_checkpoint(file: Path, expected: Mapping[str, Any]) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Read weights, refusing those made for something else.

    Args:
        file: written by :func:`save_checkpoint`.
        expected: metadata that must be equal, e.g. ``{"robot": "fetch", "beams": 222}``.

    Returns:
        The state dict and all metadata.

    Raises:
        CheckpointError: if the file is missing or damaged, of another format, or its metadata differ; names
            the field.
    """
    if not file.is_file():
        raise CheckpointError(f"weights file '{file}' does not exist.")
    try:
        with safe_open(file, framework="pt") as stream:
            metadata: Any = json.loads((stream.metadata() or {}).get("card", "{}"))
            weights = {name: stream.get_tensor(name) for name in stream.keys()}  # noqa: SIM118  # not a dict
    except (SafetensorError, OSError, ValueError, RecursionError) as error:
        raise CheckpointError(
            f"weights file '{file}' cannot be read: {error}. Train or copy it again."
        ) from error
    if not isinstance(metadata, dict):
        raise CheckpointError(f"weights file '{file}' cannot be read: its card is no JSON object.")
    # weights without a card, written by other programs, name no format
    if metadata.get("format", FORMAT) != FORMAT:
        raise CheckpointError(
            f"weights file '{file}' has format {metadata['format']!r}, but this version reads {FORMAT}. "
            "Train it again, or use the version that wrote it."
        )
    for key, value in expected.items():
        if metadata.get(key) != value:
            raise CheckpointError(
                f"weights file '{file}' was made for {key} = {metadata.get(key)!r}, but {value!r} is needed."
            )
    return weights, metadata


def weight_folders(extra: Sequence[Path]) -> list[Path]:
    """Return where weights are searched.

    In this order: folders of one's own, those that the environment variable :data:`WEIGHTS_VARIABLE` names,
    then those of plugins.

    Raises:
        CheckpointError: if the environment variable names a folder that does not exist.
    """
    return [*extra, *_named_folders(), *(e.factory()() for e in hub().checkpoints)]


def _named_folders() -> list[Path]:
    """Return the folders that the environment variable names; each must exist."""
    folders = [Path(name) for name in os.environ.get(WEIGHTS_VARIABLE, "").split(os.pathsep) if name]
    missing = next((folder for folder in folders if not folder.is_dir()), None)
    if missing is not None:
        raise CheckpointError(
            f"{WEIGHTS_VARIABLE} names '{missing}', which is no folder, seen from '{Path.cwd()}'. Give its "
            f"whole path, or clear the variable: unset {WEIGHTS_VARIABLE}"
        )
    return folders


def find_weights(
    folders: Sequence[Path],
    role: str,
    kind: str,
    name: str,
    remedy: str,
    *,
    expected: Mapping[str, Any] | None = None,
    asked: int = 0,
) -> Path:
    """Return the first file of weights, ``KIND/NAME.safetensors`` in one of the folders.

    Args:
        folders: searched in this order.
        role: what the weights are of, for the message, e.g. ``"predictor"``.
        kind: registered name of that.
        name: of the file.
        remedy: how to make them.
        expected: metadata that must be equal; weights made for something else are passed over.
        asked: how many folders, from the first, were asked for by name: of their weights none is passed over.

    Raises:
        CheckpointError: if there is none.
    """
    others: list[str] = []
    for place, folder in enumerate(folders):
        file = folder / kind / f"{name}.safetensors"
        if not file.is_file():
            continue
        if expected is None or place < asked:
            return file
        try:
            load_checkpoint(file, expected)
        except CheckpointError as error:
            others.append(str(error))
        else:
            return file
    if others:
        raise CheckpointError(f"{others[0]} {remedy}")
    searched = ", ".join(f"'{folder / kind}'" for folder in folders) or "no folder"
    raise CheckpointError(f"no weights '{name}.safetensors' of {role} '{kind}' found in {searched}. {remedy}")


def load_into(module: torch.nn.Module, weights: Mapping[str, Tensor], file: Path) -> None:
    """Load a state dict into a module.

    Raises:
        CheckpointError: if names or shapes do not fit.
    """
    try:
        module.load_state_dict(dict(weights))
    except RuntimeError as error:
        raise CheckpointError(f"weights file '{file}' does not fit the network: {error}") from error


def require_same_run(file: Path, saved: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    """Refuse to resume from the snapshot of another training.

    Args:
        file: the snapshot.
        saved: options of the training it was taken of.
        wanted: options of the training that would resume; JSON-compatible.

    Raises:
        ConfigError: if any differ; names them and the remedy.
    """
    plain: dict[str, Any] = json.loads(json.dumps(dict(wanted)))
    different = differences(saved, plain)
    if different:
        raise ConfigError(
            f"'{file}' is the snapshot of another training: {', '.join(different)}. "
            "Give the same options to resume it, choose another --out, or delete the snapshot."
        )


def differences(saved: Mapping[str, Any], wanted: Mapping[str, Any]) -> list[str]:
    """Return how a record differs from the one wanted, a phrase for each entry; long values are left out."""
    found = {key: (saved.get(key), value) for key, value in wanted.items() if saved.get(key) != value}
    return [
        f"{key} differs" if any(isinstance(value, dict) for value in pair)
        else f"{key} was {pair[0]!r}, is {pair[1]!r}"
        for key, pair in found.items()
    ]  # fmt: skip


def file_digest(file: Path | None) -> str | None:
    """Return what tells files apart, whatever their name; None for none."""
    return hashlib.sha256(file.read_bytes()).hexdigest() if file else None


def portable(path: Path) -> str:
    """Return a path for a card's command: as it is below the working directory, else its name only.

    Cards travel with their weights; folders of the machine they were made on mean nothing elsewhere.
    """
    if not path.is_absolute():
        return shlex.quote(str(path))
    inside = path.is_relative_to(Path.cwd())
    return shlex.quote(str(path.relative_to(Path.cwd())) if inside else path.name)
