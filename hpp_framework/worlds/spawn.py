"""Start poses and random goals in the free space of a world."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.world import World
from hpp_framework.utils.errors import ConfigError
from hpp_framework.worlds.occupancy import free_space

ATTEMPTS = 2000
GAP = 0.5
"""Smallest gap between two footprints at the start, in metres."""
GROWTH = 1.1
"""By which factor the ring of three and more robots grows after every tenth of the attempts."""


def spawn_poses(
    world: World, robots: Sequence[RobotSpec], rng: np.random.Generator
) -> npt.NDArray[np.float64]:
    """Draw start poses (n, 3) by the world's spawn rule: free, mutually reachable, headings random.

    Robots start on a ring. That of three and more grows where it does not fit: many robots around a wall
    cannot all be as near it as two. A world with fixed starts gives those, one per robot in team order.

    Args:
        world: the world.
        robots: the team.
        rng: source of randomness.

    Raises:
        ConfigError: if no placement was found in 2,000 tries, or the fixed starts do not suit the team.
    """
    if world.spawn.poses is not None:
        check_spawn(world, robots)
        return np.array(world.spawn.poses[: len(robots)], np.float64)
    space = free_space(world, body_height=max(robot.height for robot in robots))
    radius = max(robot.footprint_radius for robot in robots)
    regions = space.regions(radius + world.spawn.clearance)
    ring = _ring_radius(world.spawn.distance, radius, len(robots))
    for attempt in range(ATTEMPTS):
        growth = GROWTH ** (10 * attempt // ATTEMPTS) if len(robots) > 2 else 1.0
        points = _ring(world, len(robots), ring * growth, rng)
        labels = space.look_up(regions, points)
        if labels.min() > 0 and labels.min() == labels.max():
            return np.column_stack([points, rng.uniform(-math.pi, math.pi, len(robots))])
    raise ConfigError(
        f"{world.label}: 'spawn' finds no room for {len(robots)} robots {world.spawn.distance} m apart with "
        f"{world.spawn.clearance} m clearance. Use a smaller team, a smaller spawn distance or clearance, a "
        "larger spawn center area, or fewer obstacles."
    )


def check_spawn(world: World, robots: Sequence[RobotSpec]) -> None:
    """Check the fixed starts of a world for a team; a world without fixed starts passes.

    Args:
        world: the world.
        robots: the team, or none to check the starts as points.

    Raises:
        ConfigError: if starts are too few, overlap, or lie in or too near an obstacle or outside the bounds.
    """
    starts = world.spawn.poses
    if starts is None:
        return
    if len(starts) < len(robots):
        raise ConfigError(
            f"{world.label}: 'spawn.poses' has {len(starts)} starts for {len(robots)} robots. "
            "List [x, y, heading_deg] for each robot, or use a smaller team."
        )
    space = free_space(world, body_height=max((robot.height for robot in robots), default=0.3))
    radii = [robot.footprint_radius for robot in robots] or [0.0] * len(starts)
    points = np.array(starts)[: len(radii), :2]
    for i, gap in enumerate(space.at(points).tolist()):
        need = radii[i] + (world.spawn.clearance if robots else 0.0)
        if gap <= 0 or gap < need - space.resolution:
            raise ConfigError(
                f"{world.label}: 'spawn.poses[{i}]' at {points[i].tolist()} is {gap:.2f} m from an obstacle "
                f"or the bounds; it needs {need:.2f} m. Move it into the open, or lower 'spawn.clearance'."
            )
        for j in range(i):
            apart = float(np.hypot(*(points[i] - points[j])))
            if apart <= max(radii[i] + radii[j], 1e-3):
                raise ConfigError(
                    f"{world.label}: 'spawn.poses[{i}]' overlaps 'spawn.poses[{j}]': {apart:.2f} m apart. "
                    f"Place them more than {radii[i] + radii[j]:.2f} m apart."
                )


def _ring_radius(distance: float, footprint: float, count: int) -> float:
    if count == 1:
        return 0.0
    return max(distance / 2, (2 * footprint + GAP) / (2 * math.sin(math.pi / count)))


def _ring(world: World, count: int, radius: float, rng: np.random.Generator) -> npt.NDArray[np.float64]:
    x_min, y_min, x_max, y_max = world.spawn.center or world.bounds
    center = rng.uniform((x_min, y_min), (x_max, y_max))
    axis = rng.uniform(-math.pi, math.pi)
    if world.spawn.axis is not None:
        axis = world.spawn.axis + rng.uniform(-1, 1) * world.spawn.axis_spread
        if count % 4 == 0:
            # no robot starts across the axis, where a world has what two robots are to be on either side of
            axis += math.pi / count
    angles = axis + 2 * math.pi * np.arange(count) / count
    return center + radius * np.stack([np.cos(angles), np.sin(angles)], -1)
