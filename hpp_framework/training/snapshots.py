"""Snapshots of a PPO training: written completely or not at all, resumed only by the training they are of."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv

from hpp_framework.plugins.weights import cannot_write, require_same_run
from hpp_framework.utils.errors import CheckpointError, ConfigError
from hpp_framework.utils.files import read_json, replacing

SNAPSHOT = "resume.zip"
RUN = "resume.json"
"""Says which training the snapshot is of."""


def describe_run(out: Path, run: Mapping[str, Any]) -> None:
    """Write what later snapshots in ``out`` are of, before the first of them.

    Raises:
        CheckpointError: if it cannot be written.
    """
    _replace(out / RUN, (json.dumps(run, indent=2) + "\n").encode())


def save_snapshot(model: PPO, out: Path) -> None:
    """Write the state of a training; the earlier snapshot is kept until the new one is complete.

    Raises:
        CheckpointError: if it cannot be written, e.g. because the disk is full.
    """
    content = io.BytesIO()
    model.save(content)
    _replace(out / SNAPSHOT, content.getvalue())


def load_snapshot(out: Path, env: VecEnv, run: Mapping[str, Any]) -> PPO | None:
    """Load the snapshot in a folder.

    Args:
        out: the folder.
        env: robots to go on with.
        run: options that the snapshot must share, as given to :func:`describe_run`.

    Returns:
        The model, or None if there is no snapshot.

    Raises:
        ConfigError: if the snapshot is damaged, of another training, or says not which it is of.
    """
    file = out / SNAPSHOT
    if not file.exists():
        return None
    try:
        saved = read_json(out / RUN)
    except ConfigError as error:
        raise ConfigError(f"'{file}' does not say what it is of: {error} Delete it to begin anew.") from error
    require_same_run(file, saved, run)
    try:
        return PPO.load(file, env=env, device="cpu")
    except Exception as error:  # unpickling damaged content may raise anything
        raise ConfigError(
            f"the snapshot '{file}' cannot be read: {error}. Delete it to begin anew, or choose "
            "another --out."
        ) from error


def remove_snapshot(out: Path) -> None:
    """Remove the snapshot of a finished training."""
    for name in (SNAPSHOT, RUN):
        (out / name).unlink(missing_ok=True)


def _replace(file: Path, content: bytes) -> None:
    try:
        with replacing(file) as temporary:
            temporary.write_bytes(content)
    except OSError as error:
        raise CheckpointError(cannot_write(file, error)) from error
