"""Open halls separated by walls with narrow passages."""

from __future__ import annotations

import numpy as np

from hpp_framework.core.world import Box, Cylinder, SpawnRule, World
from hpp_framework.worlds.generators.recipe import between, generate, rectangle

WIDTH = (1.4, 0.75)
"""Width of passages in metres at difficulty 0 and 1, of which each wall has up to 5 % more."""

SIDE = (10.0, 14.0)
THICK = (0.4, 1.6)
THIN = (0.08, 0.2)
HALL = 1.2
"""Least depth in metres of the space between two walls."""

JITTER = 0.3
STAGGER = 1.8
"""Least distance in metres between passages, across the path through, where there is room."""

PILLAR_GAP = 1.0
"""Least free width in metres around a pillar."""


def passages(rng: np.random.Generator, *, difficulty: float | None = None) -> World:
    """Draw a hall cut by one to three walls, thick or thin, with one or two passages each, staggered.

    Args:
        rng: source of randomness.
        difficulty: in [0, 1] narrows the passages from 1.4 m to 0.75 m, thickens walls and adds pillars;
            None draws it.

    Raises:
        ConfigError: if the difficulty is not in [0, 1].
    """
    return generate(_draw, rng, difficulty)


def _draw(rng: np.random.Generator, difficulty: float) -> World:
    length, width = rng.uniform(*SIDE, 2).tolist()
    walls = 1 + int(rng.random() < between(0.3, 0.7, difficulty)) + int(rng.random() < 0.3 * difficulty)
    pitch = length / (walls + 1)
    boxes: list[Box] = []
    openings: list[float] = []
    for index in range(walls):
        thickness = float(rng.uniform(*(THICK if rng.random() < between(0.3, 0.6, difficulty) else THIN)))
        thickness = min(thickness, pitch - HALL - 2 * JITTER)
        x = pitch * (index + 1) - length / 2 + float(rng.uniform(-JITTER, JITTER))
        openings = _openings(rng, difficulty, width, openings)
        gap = min(between(*WIDTH, difficulty) * float(rng.uniform(1.0, 1.05)), WIDTH[0])
        start = -width / 2
        for opening in sorted(openings):
            boxes.append(rectangle(x - thickness / 2, start, x + thickness / 2, opening - gap / 2))
            start = opening + gap / 2
        boxes.append(rectangle(x - thickness / 2, start, x + thickness / 2, width / 2))
    pillars = _pillars(rng, int(rng.poisson(between(1, 7, difficulty))), (length, width), boxes)
    turned = bool(rng.random() < 0.5)
    return World(
        name="passages",
        bounds=(-width / 2, -length / 2, width / 2, length / 2)
        if turned
        else (-length / 2, -width / 2, length / 2, width / 2),
        boxes=tuple(_turn(box) for box in boxes) if turned else tuple(boxes),
        cylinders=tuple(_turn_pillar(pillar) for pillar in pillars) if turned else tuple(pillars),
        spawn=SpawnRule(clearance=0.05),
    )


def _openings(
    rng: np.random.Generator, difficulty: float, width: float, previous: list[float]
) -> list[float]:
    """Draw the middles of a wall's passages, away from those of the wall before and from each other."""
    reach = width / 2 - 1.0
    count = 1 + int(rng.random() < between(0.6, 0.2, difficulty))
    chosen: list[float] = []
    for spot in rng.uniform(-reach, reach, 20).tolist():
        if len(chosen) < count and all(abs(spot - other) > STAGGER for other in (*previous, *chosen)):
            chosen.append(spot)
    return chosen or [-reach if min(previous) > 0 else reach]


def _pillars(
    rng: np.random.Generator, count: int, size: tuple[float, float], boxes: list[Box]
) -> list[Cylinder]:
    """Draw pillars with room to pass on every side: of walls, of each other and of passages."""
    pillars: list[Cylinder] = []
    for _ in range(count):
        radius = float(rng.uniform(0.1, 0.4))
        room = np.array(size) / 2 - radius - PILLAR_GAP
        x, y = rng.uniform(-room, room).tolist()
        beside_walls = all(abs(x - box.center[0]) > box.size[0] / 2 + radius + PILLAR_GAP for box in boxes)
        apart = all(
            float(np.hypot(x - other.center[0], y - other.center[1])) > radius + other.radius + PILLAR_GAP
            for other in pillars
        )
        if beside_walls and apart:
            pillars.append(Cylinder(center=(x, y), radius=radius))
    return pillars


def _turn(box: Box) -> Box:
    return Box(center=(box.center[1], box.center[0]), size=(box.size[1], box.size[0]))


def _turn_pillar(pillar: Cylinder) -> Cylinder:
    return Cylinder(center=(pillar.center[1], pillar.center[0]), radius=pillar.radius)
