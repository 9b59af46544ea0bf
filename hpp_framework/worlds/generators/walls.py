"""Long thick walls around the middle of a room: for tuning planners away from the worlds of reports."""

from __future__ import annotations

import math

import numpy as np

from hpp_framework.core.world import Box, SpawnRule, World
from hpp_framework.utils.errors import ConfigError
from hpp_framework.worlds.generators.recipe import between, one_region, settle

SIDE = 20.0
LENGTH = (3.0, 10.0)
THICKNESS = (0.5, 0.9)
"""In metres: robots that touch a wall from both sides are farther apart than a rendezvous allows."""

REACH = 5.0
"""How far from the middle of the room the second and third wall may have their middles, in metres."""

DISTANCE = 5.0
CLEARANCE = 0.15
ATTEMPTS = 500


def walls(rng: np.random.Generator, *, difficulty: float | None = None) -> World:
    """Draw a room of 20 x 20 m with one to three walls; the team starts 5 m apart across the first.

    Args:
        rng: source of randomness.
        difficulty: in [0, 1] makes walls longer (up to 6.5 m to 10 m) and more; None draws it.

    Raises:
        ConfigError: if the difficulty is not in [0, 1].
    """
    level = settle(rng, difficulty)
    for _ in range(ATTEMPTS):
        world = _layout(rng, level)
        if one_region(world, CLEARANCE):
            return world
    raise ConfigError(f"walls: in {ATTEMPTS} tries no free space of difficulty {level:g} hung together.")


def _layout(rng: np.random.Generator, difficulty: float) -> World:
    longest = between(0.5 * sum(LENGTH), LENGTH[1], difficulty)
    count = 1 + int(rng.random() < between(0.2, 0.8, difficulty)) + int(rng.random() < 0.6 * difficulty)
    first = _wall(rng, 1.0, longest)
    normal = np.array([-math.sin(first.yaw), math.cos(first.yaw)])
    along = np.array([normal[1], -normal[0]])
    # anywhere along the wall but its last metre, so that now one end is nearer and now the other
    room = max(first.size[0] / 2 - 1.0, 0.0)
    x, y = (np.array(first.center) + along * rng.uniform(-room, room)).tolist()
    starts = np.array([(x, y) + side * normal * DISTANCE / 2 for side in (-1, 1)])
    others = [_wall(rng, REACH, longest) for _ in range(count - 1)]
    return World(
        name="walls",
        bounds=(-SIDE / 2, -SIDE / 2, SIDE / 2, SIDE / 2),
        boxes=(first, *(other for other in others if _gap(other, starts) > 1.0)),
        spawn=SpawnRule(
            distance=DISTANCE,
            center=(x - 0.2, y - 0.2, x + 0.2, y + 0.2),
            axis=first.yaw + math.pi / 2,
            axis_spread=math.radians(10),
            clearance=CLEARANCE,
        ),
    )


def _wall(rng: np.random.Generator, reach: float, longest: float) -> Box:
    x, y = rng.uniform(-reach, reach, 2).tolist()
    size = (float(rng.uniform(LENGTH[0], longest)), float(rng.uniform(*THICKNESS)))
    return Box(center=(x, y), size=size, yaw=float(rng.uniform(-math.pi, math.pi)))


def _gap(box: Box, points: np.ndarray) -> float:
    """Return the distance in metres from a box to the nearest of points (n, 2)."""
    away = points - np.array(box.center)
    cos, sin = math.cos(box.yaw), math.sin(box.yaw)
    own = np.abs(np.stack([cos * away[:, 0] + sin * away[:, 1], cos * away[:, 1] - sin * away[:, 0]], -1))
    return float(np.linalg.norm(np.maximum(own - np.array(box.size) / 2, 0), axis=-1).min())
