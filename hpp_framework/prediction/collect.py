"""Data collection by self-supervision: teams drive to common random goals with their own skills (sec. 4.1).

A data set is a folder: ``meta.json`` and numbered chunks, each a folder of ``.npy`` files that can be mapped
into memory. A chunk depends on the seed and its number only, so collection can stop and resume anywhere.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from jaxtyping import Float, Int
from torch import Tensor

from hpp_framework.core.disturbances import IDEAL, Disturbances
from hpp_framework.core.estimator import Estimator
from hpp_framework.core.team import Team
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import Observation, State
from hpp_framework.episodes.core import EpisodeBatch
from hpp_framework.plugins.build import make_skills
from hpp_framework.plugins.builtin import DEFAULT_WORLD
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.executor import Report, run_tasks
from hpp_framework.utils.run_folder import RunFolder, replacing
from hpp_framework.utils.seeding import child_seed, numpy_rng
from hpp_framework.utils.validation import Count, Positive, Share, validated
from hpp_framework.worlds.pool import WorldPool, build_pool, draw_starts

FORMAT = 1
SCAN_UNIT = 0.001
"""Scans are stored as unsigned 16-bit millimetres: an error of at most 0.5 mm, up to 65 m."""


@validated
class Collection:
    """How a data set is made.

    Attributes:
        trajectories: how many, rounded up to whole chunks (50,000 in the paper).
        steps: control steps per trajectory (100 in the paper).
        chunk: trajectories a chunk, simulated side by side.
        worlds: different worlds a chunk.
        world: registered world they are drawn from, or a world file, which makes all of them equal.
        near_share: share of goals drawn within ``near_radius`` of the team instead of anywhere.
        near_radius: in metres.
        switch_share: share of trajectories whose goal changes once, between steps 10 and 50, as planners do.
        start_distance: nearest and farthest neighbour at the start, in metres.
        seed: of everything.
    """

    trajectories: Count = 50_000
    steps: Count = 100
    chunk: Count = 500
    worlds: Count = 50
    world: str = DEFAULT_WORLD
    near_share: Share = 0.6
    near_radius: Positive = 5.0
    switch_share: Share = 0.5
    start_distance: tuple[float, float] = (1.5, 8.0)
    seed: int = 0

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return -(-self.trajectories // self.chunk)


def collect(team: Team, config: Collection, out: Path, *, workers: int = 1) -> Iterator[int]:
    """Write a data set chunk by chunk; chunks that are there already are kept.

    The data are the same for any number of workers.

    Args:
        team: who drives.
        config: how.
        out: folder; created, or resumed if it holds the same collection.
        workers: processes (see :func:`hpp_framework.utils.executor.run_tasks`), or 1 for none but this one.

    Yields:
        Trajectories on disk so far.

    Raises:
        ConfigError: if ``out`` holds another collection or cannot be written to.
    """
    _open_folder(out, describe(team, config))
    missing = [index for index in range(config.chunks) if not _chunk(out, index).exists()]
    done = config.chunks - len(missing)
    yield done * config.chunk
    for _ in _collect_missing(team, config, out, missing, workers):
        done += 1
        yield done * config.chunk


def _collect_missing(
    team: Team, config: Collection, out: Path, missing: list[int], workers: int
) -> Iterator[None]:
    tasks = [_ChunkTask(team, config, out, index) for index in missing]
    if workers == 1 or len(tasks) < 2:
        for task in tasks:
            _collect_chunk(task)
            yield
        return
    _warm_up(tasks[0])
    yield from run_tasks(_collect_and_report, tasks, workers=workers)


@dataclass(frozen=True)
class _ChunkTask:
    team: Team
    config: Collection
    out: Path
    index: int


def _collect_chunk(task: _ChunkTask) -> None:
    arrays = _simulate(task.team, task.config, task.index)
    _write_chunk(_chunk(task.out, task.index), arrays)


def _collect_and_report(task: _ChunkTask, report: Report) -> None:
    _collect_chunk(task)
    report(None)


def _warm_up(task: _ChunkTask) -> None:
    """Simulate two steps, so that the kernels are compiled once and not by every worker."""
    tiny = replace(task.config, chunk=1, worlds=1, steps=2)
    _simulate(task.team, tiny, task.index)


def _chunk(out: Path, index: int) -> Path:
    return out / f"chunk-{index:05d}"


def describe(team: Team, config: Collection) -> dict[str, Any]:
    """Return the metadata of a data set (JSON-compatible)."""
    members = [
        {"id": m.id, "robot": m.robot.name, "skill": m.skill, "beams": m.robot.lidar.beams}
        for m in team.members
    ]
    settings = json.loads(json.dumps(asdict(config)))
    settings.pop("trajectories")  # a collection may be extended
    return {"format": FORMAT, "team": members, "period": CONTROL_PERIOD, "collection": settings}


def _open_folder(out: Path, meta: dict[str, Any]) -> None:
    RunFolder(out).claim(
        "meta.json", meta, what="collection",
        remedy="Choose another --out, or the same team, seed and settings to extend it.",
    )  # fmt: skip


def _write_chunk(target: Path, arrays: dict[str, npt.NDArray[Any]]) -> None:
    with replacing(target, remedy="Earlier chunks are kept; free space and resume.") as temporary:
        temporary.mkdir()
        for name, array in arrays.items():
            np.save(temporary / f"{name}.npy", array, allow_pickle=False)


@dataclass(frozen=True)
class Moment:
    """A team on its way, at the beginning of a control step.

    Attributes:
        step: control steps done.
        state: the simulator's own memory, which the next step overwrites.
        observations: one per robot; their velocities are the simulator's memory too.
        goals: of all robots, world coordinates.
        world: index of each episode's world.
    """

    step: int
    state: State
    observations: list[Observation]
    goals: Float[Tensor, "c 2"]
    world: Int[Tensor, "c"]


def drive(
    team: Team,
    config: Collection,
    part: int | str,
    *,
    disturbances: Disturbances | Sequence[Disturbances] = IDEAL,
    estimators: Sequence[Estimator] | None = None,
    keyframes: int = 0,
) -> Iterator[Moment]:
    """Drive a chunk of episodes in which the whole team pursues the same random goals.

    Args:
        team: who drives.
        config: how.
        part: names the chunk; worlds, starts and goals depend on the seed and this only.
        disturbances: of sensing and acting, the same for all or one for each robot.
        estimators: one for each agent; None takes what was sensed last as it is.
        keyframes: that observations hold.

    Yields:
        The beginning of each control step.
    """
    skills = make_skills(team)
    rng = numpy_rng(config.seed, "collect", part)
    pool = build_pool(config.world, config.worlds, team.robots, seed=int(rng.integers(2**62)))
    world = rng.integers(len(pool), size=config.chunk)
    starts = draw_starts(pool, world, len(team), config.start_distance, rng)
    goals = _goals(pool, world, starts, config, rng)
    simulator = BatchSimulator(team.robots, threads=1)
    simulator.load(pool.worlds, episodes=config.chunk)
    whole_team = torch.ones(config.chunk, len(team), dtype=torch.bool)
    index = torch.from_numpy(world)
    state = simulator.place(index.to(torch.int32), whole_team, starts)
    batch = EpisodeBatch(
        simulator, disturbances=disturbances, estimators=estimators, keyframes=keyframes, shared=True
    )
    batch.start(state, [child_seed(config.seed, "collect", part, row) for row in range(config.chunk)])
    for step in range(config.steps):
        seen = [batch.observe(robot) for robot in range(len(team))]
        yield Moment(step, batch.state, seen, goals[:, step], index)
        commands = [skill.act(own, goals[:, step]) for skill, own in zip(skills, seen, strict=True)]
        batch.step(torch.stack(commands, 1))


def _simulate(team: Team, config: Collection, index: int) -> dict[str, npt.NDArray[Any]]:
    """Return poses (c, t, n, 3), scans (c, t, n, k) in millimetres, goals (c, t, 2), world (c,)."""
    beams = max(robot.lidar.beams for robot in team.robots)
    poses = np.zeros((config.chunk, config.steps, len(team), 3), np.float32)
    scans = np.zeros((config.chunk, config.steps, len(team), beams), np.uint16)
    goals = np.zeros((config.chunk, config.steps, 2), np.float32)
    world = np.zeros(config.chunk, np.int64)
    for moment in drive(team, config, index):
        poses[:, moment.step] = moment.state.poses.numpy()
        scans[:, moment.step] = (moment.state.scans / SCAN_UNIT).round().numpy().astype(np.uint16)
        goals[:, moment.step] = moment.goals.numpy()
        world = moment.world.numpy() + index * config.worlds
    return {"poses": poses, "scans": scans, "goals": goals, "world": world}


def _goals(
    pool: WorldPool,
    world: npt.NDArray[np.int64],
    starts: Float[Tensor, "c n 3"],
    config: Collection,
    rng: np.random.Generator,
) -> Float[Tensor, "c t 2"]:
    """Draw common goals, not guaranteed to be free, as in appendix C.3; some change once on the way."""
    bounds = np.array([w.bounds for w in pool.worlds])[world]
    middle = starts[..., :2].mean(1).numpy()

    def draw() -> npt.NDArray[np.float64]:
        anywhere = rng.uniform(bounds[:, :2], bounds[:, 2:])
        angle = rng.uniform(-np.pi, np.pi, len(world))
        radius = config.near_radius * np.sqrt(rng.random(len(world)))
        near = middle + radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
        return np.where(rng.random((len(world), 1)) < config.near_share, near, anywhere)

    first, second = draw(), draw()
    switches = rng.random(len(world)) < config.switch_share
    switch_at = np.where(switches, rng.integers(10, 51, len(world)), config.steps)
    late = np.arange(config.steps)[None] >= switch_at[:, None]
    return torch.from_numpy(np.where(late[..., None], second[:, None], first[:, None]).astype(np.float32))
