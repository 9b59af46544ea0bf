"""A pool of worlds with free points drawn in advance, so that resets cost no geometry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hpp_framework.robot import RobotSpec
from hpp_framework.seeding import numpy_rng
from hpp_framework.worlds.loader import resolve_world
from hpp_framework.worlds.occupancy import free_space
from hpp_framework.worlds.world import World

POINTS = 256
RESOLUTION = 0.1


@dataclass(frozen=True)
class WorldPool:
    """Worlds and points in the largest free region of each.

    Attributes:
        worlds: the worlds.
        points: (worlds, points, 2) free points; any two of one world can be reached from each other.
    """

    worlds: tuple[World, ...]
    points: npt.NDArray[np.float32]

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
    radius = max(robot.footprint_radius for robot in robots) + clearance
    height = max(robot.height for robot in robots)
    worlds: list[World] = []
    factory = resolve_world(name)
    points = np.zeros((size, POINTS, 2), np.float32)
    for index in range(size):
        rng = numpy_rng(seed, "pool", name, index)
        world = factory(rng)
        space = free_space(world, body_height=height, resolution=RESOLUTION)
        points[index] = space.sample(space.largest_region(radius), POINTS, rng)
        worlds.append(world)
    return WorldPool(tuple(worlds), points)
