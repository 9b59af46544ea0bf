"""Snapshots of a PPO training, resumed only by the training they are of."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stable_baselines3 import PPO

from hpp_framework.plugins import snapshots
from hpp_framework.utils.errors import ConfigError

SNAPSHOT = "resume.safetensors"
OLD = "resume.zip"
"""What older versions wrote. To read it runs whatever program is in it."""


def save_snapshot(model: PPO, out: Path, run: Mapping[str, Any]) -> None:
    """Write the state of a training; the earlier snapshot is kept until the new one is complete.

    Args:
        model: of the training.
        out: its folder.
        run: its options; JSON-compatible.

    Raises:
        CheckpointError: if it cannot be written, e.g. because the disk is full.
    """
    counters = {"steps": model.num_timesteps, "updates": model._n_updates}  # type: ignore[reportPrivateUsage]  # has no public name
    policy = model.policy
    snapshots.save_snapshot(out / SNAPSHOT, policy, policy.optimizer, {"run": dict(run), **counters})


def load_snapshot(model: PPO, out: Path, run: Mapping[str, Any]) -> bool:
    """Give a fresh model the state of the snapshot in a folder; returns whether there is one.

    Random numbers begin again as in a fresh model.

    Args:
        model: built with the same options.
        out: the folder.
        run: options that the snapshot must share, as given to :func:`save_snapshot`.

    Raises:
        ConfigError: if the snapshot is damaged, of another training, or of an older version.
    """
    if (out / OLD).exists():
        raise ConfigError(
            f"the snapshot '{out / OLD}' cannot be read: it is of an older version, and may hold a program. "
            "Delete it to begin anew, finish the training with that version, or choose another --out."
        )
    policy, counters = model.policy, {"steps": int, "updates": int}
    found = snapshots.load_snapshot(out / SNAPSHOT, policy, policy.optimizer, run, counters)
    if found is None:
        return False
    model.num_timesteps, model._n_updates = found["steps"], found["updates"]  # type: ignore[reportPrivateUsage]  # has no public name
    return True


def remove_snapshot(out: Path) -> None:
    """Remove the snapshot of a finished training."""
    snapshots.remove_snapshot(out / SNAPSHOT)
