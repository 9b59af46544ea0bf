"""A pool of worlds with free points drawn in advance, so that resets cost no geometry."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from inspect import signature

import numpy as np
import numpy.typing as npt
import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.world import World
from hpp_framework.utils.seeding import numpy_rng
from hpp_framework.worlds.loader import resolve_world
from hpp_framework.worlds.occupancy import FreeSpace, free_space
from hpp_framework.worlds.paths import PathFields, comfortable_paths
from hpp_framework.worlds.people import populate

POINTS = 256
RESOLUTION = 0.1


@dataclass(frozen=True)
class WorldPool:
    """Worlds and points in the largest free region of each.

    Attributes:
        worlds: the worlds.
        points: (worlds, points, 2) free points; any two of one world can be reached from each other.
        goals: how many of each world's points, its first, have the paths to them known.
        paths: the paths to them, world by world, or None.
    """

    worlds: tuple[World, ...]
    points: npt.NDArray[np.float32]
    goals: int = 0
    paths: PathFields | None = None

    def __len__(self) -> int:
        return len(self.worlds)


def build_pool(
    name: str, size: int, robots: Sequence[RobotSpec], *, seed: int, clearance: float = 0.15
) -> WorldPool:
    """Generate worlds and draw free points in each.

    Args:
        name: registered world or world file.
        size: number of worlds.
        robots: the team; points suit its largest footprint and tallest body.
        seed: of worlds and points; world ``i`` depends on the seed and ``i`` only.
        clearance: gap between a footprint at a point and the nearest obstacle, in metres.
    """
    factory = resolve_world(name)
    return _pool(name, [factory] * size, robots, seed, clearance)[0]


def build_training_pool(
    name: str,
    size: int,
    robots: Sequence[RobotSpec],
    *,
    seed: int,
    clearance: float,
    goals: int,
    comfort: float,
) -> WorldPool:
    """Generate worlds from easy to hard, draw free points in each, and find the paths to some of them.

    A world whose generator takes a ``difficulty`` gets one that rises evenly from 0 to 1 along the pool.

    Args:
        name: registered world or world file.
        size: number of worlds.
        robots: the team; points suit its largest footprint and tallest body.
        seed: of worlds and points; world ``i`` depends on the seed, ``i`` and ``size`` only.
        clearance: gap between a footprint at a point and the nearest obstacle, in metres.
        goals: points per world that paths are found to.
        comfort: gap to obstacles that paths prefer to keep, in metres.
    """
    factory = resolve_world(name)
    factories: list[Callable[..., World]] = [factory] * size
    if "difficulty" in signature(factory).parameters:
        factories = [partial(each, difficulty=(i + 0.5) / size) for i, each in enumerate(factories)]
    pool, spaces = _pool(name, factories, robots, seed, clearance)
    paths = comfortable_paths(
        spaces,
        max(robot.footprint_radius for robot in robots),
        comfort,
        torch.from_numpy(pool.points[:, :goals].reshape(-1, 2).copy()),
        torch.arange(size).repeat_interleave(goals),
    )
    return replace(pool, goals=goals, paths=paths)


def draw_starts(
    pool: WorldPool,
    world: npt.NDArray[np.int64],
    count: int,
    distance: tuple[float, float],
    rng: np.random.Generator,
) -> Float[Tensor, "b n 3"]:
    """Draw start poses among the points of a pool, headings random.

    Args:
        pool: worlds and points.
        world: of each episode, as an index into the pool.
        count: robots per team.
        distance: nearest neighbour at least and first robot at most, in metres; where no point suits, the one
            farthest from all others is taken.
        rng: source of randomness.
    """
    points = pool.points[world]
    rows = np.arange(len(world))
    chosen = [points[rows, rng.integers(points.shape[1], size=len(world))]]
    low, high = distance
    while len(chosen) < count:
        candidates = points[rows[:, None], rng.integers(points.shape[1], size=(len(world), 64))]
        gaps = np.linalg.norm(candidates[:, :, None] - np.stack(chosen, 1)[:, None], axis=-1)
        suitable = (gaps.min(-1) >= low) & (gaps[:, :, 0] <= high)
        # where no candidate suits, the one farthest from all others
        fallback = gaps.min(-1).argmax(1)
        first = np.where(suitable.any(1), suitable.argmax(1), fallback)
        chosen.append(candidates[rows, first])
    heading = rng.uniform(-np.pi, np.pi, (len(world), count, 1))
    return torch.from_numpy(np.concatenate([np.stack(chosen, 1), heading], -1).astype(np.float32))


def _pool(
    name: str,
    factories: Sequence[Callable[..., World]],
    robots: Sequence[RobotSpec],
    seed: int,
    clearance: float,
) -> tuple[WorldPool, list[FreeSpace]]:
    radius = max(robot.footprint_radius for robot in robots) + clearance
    height = max(robot.height for robot in robots)
    worlds: list[World] = []
    spaces: list[FreeSpace] = []
    points = np.zeros((len(factories), POINTS, 2), np.float32)
    for index, factory in enumerate(factories):
        rng = numpy_rng(seed, "pool", name, index)
        world = factory(rng)
        world = populate(world, robots, np.zeros((0, 2)), numpy_rng(seed, "people", name, index))
        space = free_space(world, body_height=height, resolution=RESOLUTION)
        points[index] = space.sample(space.largest_region(radius), POINTS, rng)
        worlds.append(world)
        spaces.append(space)
    return WorldPool(tuple(worlds), points), spaces
