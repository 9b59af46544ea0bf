"""Navigation tasks that skills are judged on: a start, a goal that can be reached, and their difficulty."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.world import World
from hpp_framework.evaluation.path_bounds import in_periods, least_time, path_lengths
from hpp_framework.evaluation.trial import ARRIVAL, RESOLUTION, Trial
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.seeding import numpy_rng
from hpp_framework.worlds.loader import resolve_world
from hpp_framework.worlds.occupancy import FreeSpace, free_space

Array = npt.NDArray[np.float64]
Progress = Callable[[int], None]

DISTANCES = (1.0, 2.0, 4.0, 6.0, 8.0, 10.0, 15.0)
"""Edges in metres of the bins of the straight distance from start to goal."""
CLEARANCES = (0.0, 0.05, 0.15, 0.3, 0.6, float("inf"))
"""Edges in metres of the bins of a task's clearance."""
LADDER = (0.02, 0.035, 0.05, 0.075, 0.1, 0.125, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)
"""Gaps in metres that are tried to find a task's clearance."""

POINTS = 256
"""Free points drawn in a world."""
STARTS = 32
"""Of those, how many are tried as starts."""
REDRAWS = 20
"""Worlds drawn for an episode before a goal at the wanted distance is given up."""


@dataclass(frozen=True)
class NavigationTask:
    """A robot at rest and a goal.

    Attributes:
        world: where.
        pose: start.
        goal: in metres.
        clearance: largest gap of :data:`LADDER` that a disc of the footprint keeps to everything on some
            path from start to goal, ends included; 0 if none. Metres.
        shortest: length of the shortest path of the footprint, metres.
        bound: seconds that no drive within the robot's limits can beat.
    """

    world: World
    pose: Float[np.ndarray, "3"]
    goal: Float[np.ndarray, "2"]
    clearance: float
    shortest: float
    bound: float


@dataclass(frozen=True)
class NavigationTasks:
    """Navigation tasks side by side, one per episode; see :class:`NavigationTask`.

    Attributes:
        worlds: one per episode.
        poses: starts.
        goals: in metres.
        distance: straight from start to goal, metres.
        clearance: in metres.
        shortest: in metres.
        bound: in seconds.
    """

    worlds: tuple[World, ...]
    poses: Float[Tensor, "b 1 3"]
    goals: Float[Tensor, "b 2"]
    distance: Float[np.ndarray, "b"]
    clearance: Float[np.ndarray, "b"]
    shortest: Float[np.ndarray, "b"]
    bound: Float[np.ndarray, "b"]

    def __len__(self) -> int:
        return len(self.worlds)

    @staticmethod
    def of(tasks: Sequence[NavigationTask]) -> NavigationTasks:
        """Return single tasks side by side."""
        poses, goals = np.stack([task.pose for task in tasks]), np.stack([task.goal for task in tasks])
        return NavigationTasks(
            worlds=tuple(task.world for task in tasks),
            poses=torch.from_numpy(poses).float()[:, None],
            goals=torch.from_numpy(goals).float(),
            distance=np.linalg.norm(goals - poses[:, :2], axis=1),
            clearance=np.array([task.clearance for task in tasks]),
            shortest=np.array([task.shortest for task in tasks]),
            bound=np.array([task.bound for task in tasks]),
        )


def draw_navigation_tasks(
    robot: RobotSpec, trial: Trial, *, progress: Progress = lambda _: None
) -> NavigationTasks:
    """Draw the navigation tasks of a trial; they are the same for all skills and simulators.

    The first episodes of a longer trial are those of a shorter one.

    Args:
        robot: whose footprint, height and drive limits count.
        trial: which tasks.
        progress: called with the number of tasks drawn so far.

    Raises:
        HppError: if the world is unknown or has no goal at the distance asked for.
    """
    factory = resolve_world(trial.world)
    counts = np.zeros((len(DISTANCES) - 1, len(CLEARANCES) - 1), np.int64)
    drawn: list[NavigationTask] = []
    for index in range(trial.episodes):
        # the worlds of a pool of the same seed
        rng = numpy_rng(trial.seed, "pool", trial.world, index)
        for _ in range(REDRAWS):
            found = _draw(factory(rng), robot, trial, counts, rng)
            if found:
                break
        else:
            low, high = trial.goal_distance
            raise ConfigError(
                f"world '{trial.world}' has no goal {low:g} to {high:g} m away that '{robot.name}' can reach "
                f"with a clearance of {trial.clearance:g} m. Ask for nearer goals or less clearance."
            )
        drawn.append(found)
        progress(len(drawn))
    return NavigationTasks.of(drawn)


def navigation_task(
    world: World, robot: RobotSpec, pose: Float[np.ndarray, "3"], goal: Float[np.ndarray, "2"]
) -> NavigationTask:
    """Return the task of driving from a pose to a goal, with its clearance, path length and least time.

    The bound is the time of the shortest path to the disc around the goal under a trapezoidal speed profile,
    from rest to the speed that counts as rest, and of the dwell at the goal.

    Args:
        world: where.
        robot: whose footprint, height and drive limits count.
        pose: start, at rest.
        goal: in metres.
    """
    start = pose[:2]
    shortest, least = path_lengths(
        _space(world, robot), robot.footprint_radius, start, goal, ARRIVAL.goal_radius
    )
    seconds = least_time(least, robot.drive, ARRIVAL.rest_speed)
    return NavigationTask(
        world, pose, goal,
        clearance=float(clearances(world, robot, start[None], goal[None])[0, 0]),
        shortest=shortest, bound=float(in_periods(seconds, ARRIVAL.dwell)),
    )  # fmt: skip


def bin_of(
    distance: npt.NDArray[np.floating], clearance: npt.NDArray[np.floating]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the distance bin and the clearance bin of tasks; -1 outside the map. Same shapes as given."""
    columns = np.searchsorted(DISTANCES, distance, side="right") - 1
    rows = np.searchsorted(CLEARANCES, clearance, side="right") - 1
    return np.where(columns < len(DISTANCES) - 1, columns, -1), rows


def clearances(
    world: World, robot: RobotSpec, starts: Float[np.ndarray, "m 2"], goals: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, "m n"]:
    """Return the clearance of the tasks from every start to every goal, as in :class:`NavigationTask`.

    Args:
        world: with the points in it.
        robot: whose footprint counts.
        starts: points in metres.
        goals: points in metres.
    """
    result = np.zeros((len(starts), len(goals)))
    low, high = 0, len(LADDER)
    # one task is settled by halving, many by trying every gap
    while low < high:
        level = (low + high) // 2 if result.size == 1 else low
        joined = _joined(world, robot, LADDER[level], starts, goals)
        result[joined] = np.maximum(result[joined], LADDER[level])
        low, high = (level + 1, high) if joined.any() else (low, level)
    return result


def _joined(world: World, robot: RobotSpec, gap: float, starts: Array, goals: Array) -> npt.NDArray[np.bool_]:
    space, labels = _space(world, robot), _regions(world, robot, gap)
    here, there = space.look_up(labels, starts), space.look_up(labels, goals)
    return (here[:, None] == there) & (here[:, None] > 0)


def _space(world: World, robot: RobotSpec) -> FreeSpace:
    return free_space(world, body_height=robot.height, resolution=RESOLUTION)


@lru_cache(maxsize=len(LADDER))
def _regions(world: World, robot: RobotSpec, gap: float) -> npt.NDArray[np.int32]:
    """Return what is connected at a gap; kept, because worlds may come again."""
    return _space(world, robot).regions(robot.footprint_radius + gap)


def _draw(
    world: World, robot: RobotSpec, trial: Trial, counts: npt.NDArray[np.int64], rng: np.random.Generator
) -> NavigationTask | None:
    """Draw a start and a goal in a world and count their bin, or return None if it has no such pair."""
    space = _space(world, robot)
    even = trial.draw == "even"
    mask = space.largest_region(robot.footprint_radius + (LADDER[0] if even else trial.clearance))
    mask &= space.distance > robot.footprint_radius + trial.clearance
    if not mask.any():
        return None
    points = space.sample(mask, POINTS, rng)
    gaps = np.linalg.norm(points[:STARTS, None] - points, axis=-1)
    suitable = (gaps >= trial.goal_distance[0]) & (gaps <= trial.goal_distance[1])
    if even and suitable.any():
        bins = np.stack(bin_of(gaps, clearances(world, robot, points[:STARTS], points)))
        suitable &= _least_filled(bins, suitable, counts, rng)
    if not suitable.any():
        return None
    # the start is the first point that has any such goal, the goal a random one of those
    start = int(suitable.any(1).argmax())
    goal = int(rng.choice(np.flatnonzero(suitable[start])))
    pose = np.append(points[start], rng.uniform(-np.pi, np.pi))
    return navigation_task(world, robot, pose, points[goal])


def _least_filled(
    bins: npt.NDArray[np.int64],
    suitable: npt.NDArray[np.bool_],
    counts: npt.NDArray[np.int64],
    rng: np.random.Generator,
) -> npt.NDArray[np.bool_]:
    """Return the pairs of the bin that has fewest tasks among those on offer, and count one more there."""
    offered = np.unique(bins[:, suitable & (bins >= 0).all(0)], axis=1)
    if not offered.size:
        return suitable
    # fractions of a task settle ties
    fewest = int(np.argmin(counts[tuple(offered)] + rng.random(offered.shape[1])))
    column, row = offered[:, fewest]
    counts[column, row] += 1
    return (bins[0] == column) & (bins[1] == row)
