"""Snapshots of trainings: network and optimiser as safetensors, everything else as JSON beside and in it.

Reading one runs none of its content, so a run folder can be shared: what is not numbers is refused.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from hpp_framework.plugins.weights import load_checkpoint, load_into, require_same_run, save_checkpoint
from hpp_framework.utils.errors import CheckpointError, ConfigError

MODEL, OPTIMISER = "model.", "adam."
STATE = {"step", "exp_avg", "exp_avg_sq"}
"""What Adam keeps of each parameter."""


def save_snapshot(
    file: Path, model: nn.Module, optimiser: torch.optim.Optimizer, metadata: Mapping[str, Any]
) -> None:
    """Write the state of a training; an earlier snapshot is kept until the new one is complete.

    Args:
        file: ends in ``.safetensors``.
        model: the network.
        optimiser: of the network; Adam.
        metadata: JSON-compatible; ``run`` says what the snapshot is of.

    Raises:
        CheckpointError: if it cannot be written, e.g. because the disk is full.
    """
    # names of a module may share memory, which the file must not
    tensors = {f"{MODEL}{name}": value.clone() for name, value in model.state_dict().items()}
    for index, entry in optimiser.state_dict()["state"].items():
        for name, value in entry.items():
            tensors[f"{OPTIMISER}{index}.{name}"] = value.reshape(value.shape or (1,))
    save_checkpoint(file, tensors, metadata)


def load_snapshot(
    file: Path,
    model: nn.Module,
    optimiser: torch.optim.Optimizer,
    run: Mapping[str, Any],
    counters: Mapping[str, type],
) -> dict[str, Any] | None:
    """Give a network and its optimiser the state that a snapshot holds.

    Args:
        file: written by :func:`save_snapshot`.
        model: as it was built for the training.
        optimiser: likewise.
        run: options that the snapshot must share.
        counters: further metadata that it must hold, with their types.

    Returns:
        The metadata, or None if there is no snapshot.

    Raises:
        ConfigError: if the snapshot is damaged, of another training, or does not say which it is of.
    """
    if not file.exists():
        return None
    try:
        tensors, metadata = load_checkpoint(file, {})
        if not isinstance(metadata.get("run"), dict):
            raise ConfigError(f"'{file}' does not say what it is of. Delete it to begin anew.")
        require_same_run(file, metadata["run"], run)
        if wrong := [name for name, kind in counters.items() if type(metadata.get(name)) is not kind]:
            raise ValueError(f"{', '.join(wrong)} missing or wrong.")
        state = _optimiser_state(tensors, optimiser)
        load_into(model, {n.removeprefix(MODEL): v for n, v in tensors.items() if n.startswith(MODEL)}, file)
        optimiser.load_state_dict({**optimiser.state_dict(), "state": state})
    except (CheckpointError, ValueError, IndexError) as error:
        raise ConfigError(
            f"the snapshot '{file}' cannot be read: {error} Delete it to begin anew, or choose another --out."
        ) from error
    return metadata


def _optimiser_state(
    tensors: Mapping[str, Tensor], optimiser: torch.optim.Optimizer
) -> dict[int, dict[str, Tensor]]:
    """Return the state of each parameter by its place; a step count is a scalar.

    Raises:
        ValueError: if it is not of these parameters.
    """
    parameters: list[Tensor] = [each for group in optimiser.param_groups for each in group["params"]]
    state: dict[int, dict[str, Tensor]] = {}
    for name, value in tensors.items():
        if name.startswith(OPTIMISER):
            _, index, key = name.split(".")
            shape = () if key == "step" else parameters[int(index)].shape
            if value.numel() != torch.Size(shape).numel():
                raise ValueError(f"{name} has shape {tuple(value.shape)}, expected {tuple(shape)}.")
            state.setdefault(int(index), {})[key] = value.reshape(shape)
    if any(set(entry) != STATE for entry in state.values()):
        raise ValueError("the state of the optimiser is incomplete.")
    return state


def remove_snapshot(file: Path) -> None:
    """Remove the snapshot of a finished training."""
    for each in (file, file.with_suffix(".json")):
        each.unlink(missing_ok=True)
