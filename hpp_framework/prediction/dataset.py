"""Reads what ``collect`` wrote: random batches of history, goal and future for one (agent, subject) pair."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.errors import ConfigError
from hpp_framework.files import read_json
from hpp_framework.prediction.collect import FORMAT, SCAN_UNIT
from hpp_framework.sensing import HISTORY

VALIDATION_SHARE = 0.1
CHUNKS_PER_BATCH = 4


@dataclass(frozen=True)
class Batch:
    """Samples at random times of random trajectories; ``h`` entries of history, oldest first.

    Attributes:
        agent_poses: of the predicting robot.
        subject_poses: of the predicted robot.
        scans: of the predicting robot, metres, the newest ``s``.
        goals: common goal, world coordinates.
        future: of the subject, at the offsets asked for.
        future_scans: of the agent at the first offset.
        valid: whether the offset lies within the trajectory and the goal is still the same.
    """

    agent_poses: Float[Tensor, "b h 3"]
    subject_poses: Float[Tensor, "b h 3"]
    scans: Float[Tensor, "b s k"]
    goals: Float[Tensor, "b 2"]
    future: Float[Tensor, "b t 3"]
    future_scans: Float[Tensor, "b k"]
    valid: Bool[Tensor, "b t"]


class TrajectoryData:
    """A data set in memory, split by world: whole chunks, whose worlds occur nowhere else, are held out.

    Args:
        folder: written by ``hpp collect``.

    Raises:
        ConfigError: if the folder is not a data set, is damaged, or has fewer than two chunks.
    """

    def __init__(self, folder: Path) -> None:
        if not (folder / "meta.json").is_file():
            raise ConfigError(
                f"'{folder}' is not a data set. Make one: hpp collect --team fetch,freight --out {folder}"
            )
        self.meta: dict[str, Any] = read_json(folder / "meta.json")
        if self.meta.get("format") != FORMAT or not isinstance(self.meta.get("team"), list):
            raise ConfigError(
                f"'{folder / 'meta.json'}' does not describe a data set of format {FORMAT}. Collect "
                "again into another folder: hpp collect --out FOLDER"
            )
        chunks = sorted(folder.glob("chunk-?????"))
        if len(chunks) < 2:
            raise ConfigError(
                f"'{folder}' holds {len(chunks)} chunks; at least 2 are needed to hold out worlds."
            )
        # memory-mapped: what does not fit in memory is read as it is used
        self._chunks = [{n: _load(c / f"{n}.npy") for n in ("poses", "scans", "goals")} for c in chunks]
        held_out = max(1, round(VALIDATION_SHARE * len(chunks)))
        self.parts = {
            "train": range(len(chunks) - held_out),
            "validation": range(len(chunks) - held_out, len(chunks)),
        }
        self.steps = self._chunks[0]["poses"].shape[1]
        self._poses = [torch.from_numpy(np.array(c["poses"])) for c in self._chunks]
        self._goals = [torch.from_numpy(np.array(c["goals"])) for c in self._chunks]

    @property
    def trajectories(self) -> int:
        """Number of trajectories."""
        return sum(len(poses) for poses in self._poses)

    def sample(
        self,
        part: str,
        size: int,
        rng: np.random.Generator,
        *,
        agent: int,
        subject: int,
        offsets: tuple[int, ...],
        scan_history: int = HISTORY,
    ) -> Batch:
        """Draw a batch; a batch comes from a few chunks so that reading stays sequential.

        Args:
            part: ``"train"`` or ``"validation"``.
            size: samples.
            rng: source of randomness.
            agent: index of the predicting robot.
            subject: index of the predicted robot.
            offsets: control steps ahead to predict.
            scan_history: newest scans to include.
        """
        chunks = rng.choice(np.array(self.parts[part]), size=CHUNKS_PER_BATCH)
        least, left_over = divmod(size, CHUNKS_PER_BATCH)
        draws = [
            self._draw(int(chunk), least + (place < left_over), rng, agent, subject, offsets, scan_history)
            for place, chunk in enumerate(chunks)
        ]
        return Batch(*(torch.cat(parts) for parts in zip(*draws, strict=True)))

    def _draw(
        self,
        chunk: int,
        size: int,
        rng: np.random.Generator,
        agent: int,
        subject: int,
        offsets: tuple[int, ...],
        scan_history: int,
    ) -> tuple[Tensor, ...]:
        poses, goals = self._poses[chunk], self._goals[chunk]
        row = rng.integers(len(poses), size=size)
        last = self.steps - 1 - offsets[0]
        time = rng.integers(0, last + 1, size=size)
        # the first entries of a history repeat the first measurement, as at run time
        past = np.maximum(time[:, None] + np.arange(-HISTORY + 1, 1), 0)
        ahead = time[:, None] + np.array(offsets)
        inside = torch.from_numpy(ahead < self.steps)
        ahead = np.minimum(ahead, self.steps - 1)
        now = goals[row, time]
        same = (goals[row[:, None], ahead - 1] == now[:, None]).all(-1)
        scans = self._chunks[chunk]["scans"]
        seen = scans[row[:, None], past[:, -scan_history:], agent]
        next_scan = scans[row, ahead[:, 0], agent]
        return (
            poses[row[:, None], past, agent],
            poses[row[:, None], past, subject],
            torch.from_numpy(seen.astype(np.float32)) * SCAN_UNIT,
            now,
            poses[row[:, None], ahead, subject],
            torch.from_numpy(next_scan.astype(np.float32)) * SCAN_UNIT,
            inside & same,
        )


def _load(file: Path) -> npt.NDArray[Any]:
    """Map an array of a chunk into memory."""
    try:
        return np.load(file, mmap_mode="r")
    except (OSError, ValueError, EOFError) as error:
        raise ConfigError(
            f"'{file}' is missing or damaged: {error}. Delete the folder '{file.parent}' and run the same "
            "'hpp collect' again: it writes what is missing."
        ) from error
