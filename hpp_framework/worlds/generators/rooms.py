"""Flats: rooms joined by doors, with furniture."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from hpp_framework.core.world import Box, Cylinder, SpawnRule, World
from hpp_framework.worlds.generators.recipe import between, generate, rectangle

DOOR = (1.6, 0.8)
"""Narrowest door in metres at difficulty 0 and 1."""

DOOR_SPREAD = 1.3
"""The widest door of a world as a multiple of the narrowest, but 1.6 m at most."""

SIDE = (11.0, 13.0)
SMALLEST_ROOM = 3.0
LARGEST_ROOM = 6.5
WALL = (0.08, 0.2)
PIECES = (0.04, 0.3)
"""Pieces of furniture tried a square metre at difficulty 0 and 1."""

PIECE_GAP = (1.2, 0.75)
"""Least distance in metres between pieces of furniture at difficulty 0 and 1."""

DOORWAY = 0.6
"""Free space in metres on all sides of a door."""

Rectangle = tuple[float, float, float, float]


@dataclass
class _Plan:
    difficulty: float
    rooms: list[Rectangle] = field(default_factory=list[Rectangle])
    walls: list[Box] = field(default_factory=list[Box])
    doors: list[tuple[float, float, float]] = field(default_factory=list[tuple[float, float, float]])
    """x, y and width of each."""


def rooms(rng: np.random.Generator, *, difficulty: float | None = None) -> World:
    """Draw a flat of about 12 x 12 m, cut into rooms with doors between them, and furnish it.

    Args:
        rng: source of randomness.
        difficulty: in [0, 1] narrows doors from 1.6 m to 0.8 m and brings more furniture; None draws it.

    Raises:
        ConfigError: if the difficulty is not in [0, 1].
    """
    return generate(_draw, rng, difficulty)


def _draw(rng: np.random.Generator, difficulty: float) -> World:
    x, y = (rng.uniform(*SIDE, 2) / 2).tolist()
    plan = _Plan(difficulty)
    _divide(rng, plan, (-x, -y, x, y))
    boxes, cylinders = _furnish(rng, plan)
    return World(
        name="rooms",
        bounds=(-x, -y, x, y),
        boxes=(*plan.walls, *boxes),
        cylinders=tuple(cylinders),
        spawn=SpawnRule(clearance=0.05),
    )


def _divide(rng: np.random.Generator, plan: _Plan, room: Rectangle) -> None:
    """Cut a room in two, with a door, until rooms are small enough; note what comes out in the plan."""
    x_min, y_min, x_max, y_max = room
    size = np.array([x_max - x_min, y_max - y_min])
    axis = int(size.argmax()) if rng.random() < 0.8 else int(size.argmin())
    low, high = room[axis] + SMALLEST_ROOM, room[axis + 2] - SMALLEST_ROOM
    done = bool(size.max() < LARGEST_ROOM and rng.random() < 0.7)
    cuts: list[float] = [] if done or low > high else rng.uniform(low, high, 8).tolist()
    cuts = [cut for cut in cuts if _free(plan, room, axis, cut)]
    if not cuts:
        plan.rooms.append(room)
        return
    _wall(rng, plan, room, axis, cuts[0])
    first, second = list(room), list(room)
    first[axis + 2] = second[axis] = cuts[0]
    for half in (first, second):
        _divide(rng, plan, (half[0], half[1], half[2], half[3]))


def _free(plan: _Plan, room: Rectangle, axis: int, cut: float) -> bool:
    """Return whether a wall at this cut would keep clear of the doors in the room's own walls."""
    across = 1 - axis
    return all(
        abs(door[axis] - cut) > door[2] / 2 + DOORWAY
        for door in plan.doors
        if room[across] - 0.1 < door[across] < room[across + 2] + 0.1
    )


def _wall(rng: np.random.Generator, plan: _Plan, room: Rectangle, axis: int, cut: float) -> None:
    """Build a wall with one door, or two if it is long."""
    across = 1 - axis
    half = float(rng.uniform(*WALL)) / 2
    start, end = room[across], room[across + 2]
    parts = 2 if end - start > 6 and rng.random() < 0.5 else 1
    step = (end - start) / parts
    for index in range(parts):
        narrowest = between(*DOOR, plan.difficulty)
        width = min(narrowest * float(rng.uniform(1.0, DOOR_SPREAD)), DOOR[0])
        low, high = start + index * step, start + (index + 1) * step
        door = float(rng.uniform(low + width / 2 + 0.3, high - width / 2 - 0.3))
        for a, b in ((low, door - width / 2), (door + width / 2, high)):
            corners = (cut - half, a, cut + half, b) if axis == 0 else (a, cut - half, b, cut + half)
            plan.walls.append(rectangle(*corners))
        plan.doors.append((cut, door, width) if axis == 0 else (door, cut, width))


def _furnish(rng: np.random.Generator, plan: _Plan) -> tuple[list[Box], list[Cylinder]]:
    """Put pieces into rooms, so far from each other and from doors that a robot can pass between any two."""
    boxes: list[Box] = []
    cylinders: list[Cylinder] = []
    gap = between(*PIECE_GAP, plan.difficulty)
    taken = [(x, y, width / 2 + DOORWAY - gap) for x, y, width in plan.doors]
    for x_min, y_min, x_max, y_max in plan.rooms:
        area = (x_max - x_min) * (y_max - y_min)
        for _ in range(int(rng.poisson(between(*PIECES, plan.difficulty) * area))):
            length, width = rng.uniform(0.4, 1.6), rng.uniform(0.3, 0.8)
            round_one = bool(rng.random() < 0.3)
            reach = width / 2 if round_one else math.hypot(length, width) / 2
            x = float(rng.uniform(x_min + reach, x_max - reach))
            y = float(rng.uniform(y_min + reach, y_max - reach))
            if any(math.hypot(x - a, y - b) < reach + radius + gap for a, b, radius in taken):
                continue
            taken.append((x, y, reach))
            if round_one:
                cylinders.append(Cylinder(center=(x, y), radius=width / 2))
            else:
                yaw = rng.integers(2) * math.pi / 2 if rng.random() < 0.6 else rng.uniform(-math.pi, math.pi)
                boxes.append(Box(center=(x, y), size=(length, width), yaw=float(yaw)))
    return boxes, cylinders
