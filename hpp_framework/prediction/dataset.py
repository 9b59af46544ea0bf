"""Reads what ``collect`` wrote: random batches of history, goal and future for one (agent, subject) pair."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from jaxtyping import Bool, Float, Shaped
from torch import Tensor

from hpp_framework.core.team import Member, Team
from hpp_framework.core.types import Keyframes
from hpp_framework.perception.sensing import HISTORY, KEYFRAME_EVERY
from hpp_framework.plugins.registry import hub
from hpp_framework.prediction.collect import FORMAT, SCAN_UNIT
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.run_folder import read_json

VALIDATION_SHARE = 0.1
CHUNKS_PER_BATCH = 4


Prepared = tuple[Tensor, ...]
"""What a kind of model computes once of a batch."""


@dataclass(frozen=True)
class Batch:
    """Samples at random times of random trajectories; ``h`` entries of history, oldest first.

    Attributes:
        agent_poses: of the predicting robot.
        team_poses: present poses of all robots.
        subject_poses: of the predicted robot.
        scans: of the predicting robot, metres, the newest ``s``.
        goals: common goal, world coordinates.
        future: of the subject, at the offsets asked for.
        future_scans: of the agent at the first ``f`` offsets.
        valid: whether the offset lies within the trajectory and the goal is still the same.
        keyframes: what the predicting robot remembers, if asked for.
        prepared: what a kind of model computes once of a batch that comes again, if it does.
    """

    agent_poses: Float[Tensor, "b h 3"]
    team_poses: Float[Tensor, "b n 3"]
    subject_poses: Float[Tensor, "b h 3"]
    scans: Float[Tensor, "b s k"]
    goals: Float[Tensor, "b 2"]
    future: Float[Tensor, "b t 3"]
    future_scans: Float[Tensor, "b f k"]
    valid: Bool[Tensor, "b t"]
    keyframes: Keyframes | None = None
    prepared: Prepared | None = None


class TrajectoryData:
    """A data set on disk, split by world: whole chunks, whose worlds occur nowhere else, are held out.

    Nothing is kept in memory but what the operating system caches of the files.

    Args:
        folder: written by ``hpp collect``.

    Raises:
        ConfigError: if the folder is not a data set, is damaged, or has fewer than two chunks.
    """

    def __init__(self, folder: Path) -> None:
        self.meta = _read_meta(folder)
        self.team = _team(self.meta)
        folders = sorted(folder.glob("chunk-?????"))
        if len(folders) < 2:
            raise ConfigError(
                f"'{folder}' holds {len(folders)} chunks; at least 2 are needed to hold out worlds."
            )
        # memory-mapped: what does not fit in memory is read as it is used
        chunks = [{n: _load(f / f"{n}.npy") for n in ("poses", "scans", "goals")} for f in folders]
        held_out = max(1, round(VALIDATION_SHARE * len(chunks)))
        self.parts = {
            "train": range(len(chunks) - held_out),
            "validation": range(len(chunks) - held_out, len(chunks)),
        }
        self._rows, self.steps, self._robots, _ = chunks[0]["poses"].shape
        # scans are as wide as the widest of the team
        self._beams = [robot.lidar.beams for robot in self.team.robots]
        # one row a measurement, so that gathering copies whole rows
        row = {"poses": 3 * self._robots, "scans": chunks[0]["scans"].shape[-1], "goals": 2}
        self._chunks = [{name: array.reshape(-1, row[name]) for name, array in c.items()} for c in chunks]

    @property
    def trajectories(self) -> int:
        """Number of trajectories."""
        return self._rows * len(self._chunks)

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
        scan_future: int = 1,
        keyframes: int = 0,
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
            scan_future: scans to include at the first offsets.
            keyframes: of the predicting robot to include, spaced as observations space them.
        """
        chunks = rng.choice(np.array(self.parts[part]), size=CHUNKS_PER_BATCH)
        start = rng.integers(self._rows, size=(size, 1)) * self.steps
        time = rng.integers(0, self.steps - offsets[0], size=(size, 1))
        # the first entries of a history repeat the first measurement, as at run time
        past = start + np.maximum(time + np.arange(-HISTORY + 1, 1), 0)
        ahead = time + np.array(offsets)
        inside = ahead < self.steps
        ahead = start + np.minimum(ahead, self.steps - 1)
        poses = self._gather("poses", chunks, np.concatenate([past, ahead], 1))
        poses = poses.unflatten(-1, (self._robots, 3))
        seen = np.concatenate([past[:, HISTORY - scan_history :], ahead[:, :scan_future]], 1)
        scans = self._scans(chunks, seen, agent)
        goals = self._gather("goals", chunks, np.concatenate([start + time, ahead - 1], 1))
        same = (goals[:, 1:] == goals[:, :1]).all(-1)
        return Batch(
            agent_poses=poses[:, :HISTORY, agent],
            team_poses=poses[:, HISTORY - 1],
            subject_poses=poses[:, :HISTORY, subject],
            scans=scans[:, :scan_history],
            goals=goals[:, 0],
            future=poses[:, HISTORY:, subject],
            future_scans=scans[:, scan_history:],
            valid=torch.from_numpy(inside) & same,
            keyframes=self._keyframes(chunks, start, time, agent, keyframes) if keyframes else None,
        )

    def _keyframes(
        self,
        chunks: npt.NDArray[np.int64],
        start: npt.NDArray[np.int64],
        time: npt.NDArray[np.int64],
        agent: int,
        count: int,
    ) -> Keyframes:
        rows = start + np.maximum(time - KEYFRAME_EVERY * np.arange(count, 0, -1), 0)
        poses = self._gather("poses", chunks, rows).unflatten(-1, (self._robots, 3))
        return Keyframes(poses, self._scans(chunks, rows, agent))

    def _scans(
        self, chunks: npt.NDArray[np.int64], rows: npt.NDArray[np.int64], agent: int
    ) -> Float[Tensor, "b r k"]:
        """Return what one robot's lidar measured at rows (b, r), in metres."""
        scans = self._gather("scans", chunks, rows * self._robots + agent)[..., : self._beams[agent]]
        return scans.to(torch.float32).mul_(SCAN_UNIT)

    def _gather(
        self, name: str, chunks: npt.NDArray[np.int64], rows: npt.NDArray[np.int64]
    ) -> Shaped[Tensor, "b r w"]:
        """Return rows (b, r) of an array; each chunk gives an equal share of the batch."""
        out = np.empty((*rows.shape, self._chunks[0][name].shape[1]), self._chunks[0][name].dtype)
        ends = np.linspace(0, len(rows), len(chunks) + 1).round().astype(int)
        for chunk, first, last in zip(chunks, ends[:-1], ends[1:], strict=True):
            # all rows exist: "clip" only spares numpy a buffer
            np.take(self._chunks[chunk][name], rows[first:last], axis=0, out=out[first:last], mode="clip")
        return torch.from_numpy(out)


def collected_team(folder: Path) -> Team:
    """Return the team that a data set was collected with.

    Raises:
        ConfigError: if the folder is not a data set.
    """
    return _team(_read_meta(folder))


def _team(meta: dict[str, Any]) -> Team:
    robots = hub().robots
    return Team(
        tuple(Member(id=m["id"], robot=robots.create(m["robot"]), skill=m["skill"]) for m in meta["team"])
    )


def _read_meta(folder: Path) -> dict[str, Any]:
    if not (folder / "meta.json").is_file():
        raise ConfigError(
            f"'{folder}' is not a data set. Make one: hpp collect --team fetch,freight --out {folder}"
        )
    meta = read_json(folder / "meta.json")
    if meta.get("format") != FORMAT or not isinstance(meta.get("team"), list):
        raise ConfigError(
            f"'{folder / 'meta.json'}' does not describe a data set of format {FORMAT}. Collect "
            "again into another folder: hpp collect --out FOLDER"
        )
    return meta


def _load(file: Path) -> npt.NDArray[Any]:
    """Map an array of a chunk into memory."""
    try:
        return np.load(file, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise ConfigError(
            f"'{file}' is missing or damaged: {error}. Delete the folder '{file.parent}' and run the same "
            "'hpp collect' again: it writes what is missing."
        ) from error
