"""Journeys that skills are judged on: a world, a start, a goal that can be reached, and how hard it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.world import World
from hpp_framework.evaluation.lower_bound import time_bounds
from hpp_framework.evaluation.trial import ARRIVAL, RESOLUTION, Trial
from hpp_framework.evaluation.ways import Ways, journey_ways
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.seeding import numpy_rng
from hpp_framework.worlds.loader import resolve_world
from hpp_framework.worlds.occupancy import FreeSpace, free_space

Array = npt.NDArray[np.float64]
Progress = Callable[[int], None]

DISTANCES = (1.0, 2.0, 4.0, 6.0, 8.0, 10.0, 15.0)
"""Edges in metres of the bins of the straight distance from start to goal."""
CLEARANCES = (0.0, 0.05, 0.15, 0.3, 0.6, float("inf"))
"""Edges in metres of the bins of a journey's clearance."""
LADDER = (0.02, 0.035, 0.05, 0.075, 0.1, 0.125, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)
"""Gaps in metres that are tried to find a journey's clearance."""

POINTS = 256
"""Free points drawn in a world."""
STARTS = 32
"""Of those, how many are tried as starts."""
REDRAWS = 20
"""Worlds drawn for an episode before a goal at the wanted distance is given up."""
CHUNK = 128
"""Worlds whose ways are worked out at a time, so that memory stays bounded."""


@dataclass(frozen=True)
class Journeys:
    """Episodes to come, and what can be known of them beforehand.

    Attributes:
        worlds: one an episode.
        poses: start, robot at rest.
        goals: in metres.
        distance: (b,) straight from start to goal, metres.
        clearance: (b,) largest gap of :data:`LADDER` that a disc of the footprint keeps to everything on some
            way from start to goal, ends included; 0 if none. Metres.
        shortest: (b,) length of the shortest way of the footprint, metres.
        bound: (b,) seconds that no drive within the robot's limits can beat.
    """

    worlds: tuple[World, ...]
    poses: Float[Tensor, "b 1 3"]
    goals: Float[Tensor, "b 2"]
    distance: Array
    clearance: Array
    shortest: Array
    bound: Array

    def __len__(self) -> int:
        return len(self.worlds)


@dataclass(frozen=True)
class _Journey:
    world: World
    pose: Array
    goal: Array
    clearance: float


def draw_journeys(robot: RobotSpec, trial: Trial, *, progress: Progress = lambda _: None) -> Journeys:
    """Draw the journeys of a trial; the same whatever skill drives them and in whatever simulator.

    The first episodes of a longer trial are those of a shorter one.

    Args:
        robot: whose footprint, height and drive limits count.
        trial: which journeys.
        progress: called with the number of journeys drawn so far.

    Raises:
        HppError: if the world is unknown or has no goal at the distance asked for.
    """
    factory = resolve_world(trial.world)
    counts = np.zeros((len(DISTANCES) - 1, len(CLEARANCES) - 1), np.int64)
    drawn: list[_Journey] = []
    spaces: list[FreeSpace] = []
    ways: list[Ways] = []
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
        spaces.append(_space(found.world, robot))
        if len(spaces) == CHUNK or len(drawn) == trial.episodes:
            ways.append(_ways(drawn[-len(spaces) :], spaces, robot))
            spaces.clear()
        progress(len(drawn))
    return _journeys(drawn, ways, robot)


def bin_of(
    distance: npt.NDArray[np.floating], clearance: npt.NDArray[np.floating]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the distance bin and the clearance bin of journeys; -1 outside the map. Same shapes as given."""
    columns = np.searchsorted(DISTANCES, distance, side="right") - 1
    rows = np.searchsorted(CLEARANCES, clearance, side="right") - 1
    return np.where(columns < len(DISTANCES) - 1, columns, -1), rows


def clearances(
    world: World, robot: RobotSpec, starts: Float[np.ndarray, "m 2"], goals: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, "m n"]:
    """Return the clearance of the journeys from every start to every goal, as in :class:`Journeys`.

    Args:
        world: with the points in it.
        robot: whose footprint counts.
        starts: points in metres.
        goals: points in metres.
    """
    result = np.zeros((len(starts), len(goals)))
    low, high = 0, len(LADDER)
    # one journey is settled by halving, many by trying every gap
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
) -> _Journey | None:
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
    clearance = float(clearances(world, robot, points[[start]], points[[goal]])[0, 0])
    return _Journey(world, np.append(points[start], rng.uniform(-np.pi, np.pi)), points[goal], clearance)


def _least_filled(
    bins: npt.NDArray[np.int64],
    suitable: npt.NDArray[np.bool_],
    counts: npt.NDArray[np.int64],
    rng: np.random.Generator,
) -> npt.NDArray[np.bool_]:
    """Return the pairs of the bin that has fewest journeys among those on offer, and count one more there."""
    offered = np.unique(bins[:, suitable & (bins >= 0).all(0)], axis=1)
    if not offered.size:
        return suitable
    # fractions of a journey settle ties
    fewest = int(np.argmin(counts[tuple(offered)] + rng.random(offered.shape[1])))
    column, row = offered[:, fewest]
    counts[column, row] += 1
    return (bins[0] == column) & (bins[1] == row)


def _ways(journeys: list[_Journey], spaces: list[FreeSpace], robot: RobotSpec) -> Ways:
    return journey_ways(
        spaces,
        robot.footprint_radius,
        np.stack([journey.pose[:2] for journey in journeys]),
        np.stack([journey.goal for journey in journeys]),
        goal_radius=ARRIVAL.goal_radius,
    )


def _journeys(drawn: list[_Journey], parts: list[Ways], robot: RobotSpec) -> Journeys:
    poses = np.stack([journey.pose for journey in drawn])
    goals = np.stack([journey.goal for journey in drawn])
    ways = Ways.concatenate(parts)
    return Journeys(
        worlds=tuple(journey.world for journey in drawn),
        poses=torch.from_numpy(poses).float()[:, None],
        goals=torch.from_numpy(goals).float(),
        distance=ways.straight,
        clearance=np.array([journey.clearance for journey in drawn]),
        shortest=ways.shortest,
        bound=time_bounds(ways, poses, goals, robot.drive, ARRIVAL),
    )
