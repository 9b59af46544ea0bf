"""Worlds held out for reports: planners, predictors and skills are neither trained nor tuned in them.

Each is another trap for a team that cannot talk: a dead end, two equally good doors, a corner that hides the
other robot. The fourth is the maze, in a module of its own.
"""

from __future__ import annotations

import math

import numpy as np

from hpp_framework.core.world import Box, SpawnRule, World
from hpp_framework.worlds.generators.recipe import rectangle

DISTANCE = 5.0
SPREAD = math.radians(10)
JITTER = 0.2
"""Half-width in metres of the area in which the middle of the team lies."""

TRAP_WIDTH, TRAP_DEPTH, TRAP_WALL = (3.2, 5.0), (2.2, 2.9), (0.5, 0.6)
"""Of the U: clear width, clear depth, thickness of its walls, in metres."""

DOOR, DOOR_OFFSET = (1.4, 1.8), (2.0, 4.2)
"""Width of doors, and how far they are from the middle of their wall, in metres."""

LEG = (3.5, 5.0)
"""Width of the legs of the L, in metres."""


def u_trap(rng: np.random.Generator) -> World:
    """Draw a U of walls with its back to one robot; the other stands inside it or before its opening.

    Args:
        rng: source of randomness.
    """
    width, depth, wall = (float(rng.uniform(*span)) for span in (TRAP_WIDTH, TRAP_DEPTH, TRAP_WALL))
    heading = float(rng.uniform(-math.pi, math.pi))
    middle = rng.uniform(-2.0, 2.0, 2)
    # in the frame of the U its opening looks along x, and (0, 0) is the middle of the space inside
    parts = (
        (-(depth + wall) / 2, 0.0, wall, width + 2 * wall),
        (0.0, (width + wall) / 2, depth, wall),
        (0.0, -(width + wall) / 2, depth, wall),
    )
    inside = rng.random() < 0.5
    # the robot behind the back keeps 0.9 m from it, which leaves 0.6 m to the one before the opening
    ahead = -DISTANCE / 2 if inside else DISTANCE / 2 - 0.9 - depth / 2 - wall
    team = (ahead, float(rng.uniform(-0.2, 0.2)) * width)
    return World(
        name="u-trap",
        boxes=tuple(
            Box(center=_turned((x, y), heading, middle), size=(length, thickness), yaw=heading)
            for x, y, length, thickness in parts
        ),
        spawn=_starts(rng, _turned(team, heading, middle), heading),
    )


def two_doors(rng: np.random.Generator) -> World:
    """Draw a room cut by a wall or by a corridor, with two doors in each wall and a robot on either side.

    Args:
        rng: source of randomness.
    """
    length, width = rng.uniform(12, 16), rng.uniform(12, 16)
    corridor = rng.random() < 0.5
    middles = (-0.5, 0.5) if corridor else (0.0,)
    wall = float(rng.uniform(0.2, 0.4) if corridor else rng.uniform(0.6, 1.2))
    apart = float(rng.uniform(1.8, 2.4)) + wall
    boxes: list[Box] = []
    for middle in middles:
        start, x = -width / 2, middle * apart
        for side in (-1, 1):
            door, half = side * float(rng.uniform(*DOOR_OFFSET)), float(rng.uniform(*DOOR)) / 2
            boxes.append(rectangle(x - wall / 2, float(start), x + wall / 2, door - half))
            start = door + half
        boxes.append(rectangle(x - wall / 2, float(start), x + wall / 2, float(width / 2)))
    return World(
        name="two-doors",
        bounds=(float(-length / 2), float(-width / 2), float(length / 2), float(width / 2)),
        boxes=tuple(boxes),
        spawn=_starts(rng, (0.0, float(rng.uniform(-0.8, 0.8))), 0.0),
    )


def l_room(rng: np.random.Generator) -> World:
    """Draw an L-shaped room with a robot in either leg; the inner corner stands between them.

    Args:
        rng: source of randomness.
    """
    half = float(rng.uniform(6.0, 8.0))
    signs = rng.choice([-1.0, 1.0], 2)
    corner = rng.uniform(*LEG, 2) - half
    low, high = np.sort(np.stack([corner * signs, half * signs]), axis=0)
    into = corner + float(rng.uniform(0.3, 0.8))
    across = math.atan2(-signs[1], signs[0])
    return World(
        name="l-room",
        bounds=(-half, -half, half, half),
        boxes=(rectangle(float(low[0]), float(low[1]), float(high[0]), float(high[1])),),
        spawn=_starts(rng, (float(into[0] * signs[0]), float(into[1] * signs[1])), across),
    )


def _starts(rng: np.random.Generator, middle: tuple[float, float], axis: float) -> SpawnRule:
    """Return starts 5 m apart around a point, along an axis, either robot at either end."""
    x, y = middle
    return SpawnRule(
        distance=DISTANCE,
        center=(x - JITTER, y - JITTER, x + JITTER, y + JITTER),
        axis=axis + (math.pi if rng.random() < 0.5 else 0.0),
        axis_spread=SPREAD,
    )


def _turned(point: tuple[float, float], angle: float, origin: np.ndarray) -> tuple[float, float]:
    """Return a point of a turned frame in the frame of the world, in metres."""
    cos, sin = math.cos(angle), math.sin(angle)
    x, y = point
    return float(origin[0] + cos * x - sin * y), float(origin[1] + sin * x + cos * y)
