"""Worlds in which people walk: an open hall, and corridors wide enough to pass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hpp_framework.core.world import Cylinder, Person, SpawnRule, World
from hpp_framework.utils.errors import ConfigError
from hpp_framework.worlds.generators.corridors import corridors

PEOPLE = 5
"""People of a world, unless another number is asked for."""
MOST = 100

HALL = (12.0, 18.0)
"""Shortest and longest side of a hall in metres."""

PILLARS = 4
"""Pillars of a hall, at most."""
PILLAR = (0.15, 0.35)
"""Radius of a pillar in metres."""
ASIDE = 2.5
"""Metres from the walls and from the middle to the middle of a pillar, at least."""

WIDE = 0.3
"""Largest difficulty of the corridors: 2.5 m to 2 m wide, so that a robot and a person pass."""


def crowd(rng: np.random.Generator, *, people: int = PEOPLE) -> World:
    """Draw an open hall with a few pillars, in which people walk between random places.

    Args:
        rng: source of randomness.
        people: how many.

    Raises:
        ConfigError: if the number of people is not from 0 to 100.
    """
    _check(people)
    width, depth = rng.uniform(*HALL, 2)
    pillars: list[Cylinder] = []
    for _ in range(int(rng.integers(PILLARS + 1))):
        x = rng.choice((-1, 1)) * rng.uniform(ASIDE, width / 2 - ASIDE)
        y = rng.choice((-1, 1)) * rng.uniform(ASIDE, depth / 2 - ASIDE)
        pillars.append(Cylinder(center=(float(x), float(y)), radius=float(rng.uniform(*PILLAR)), height=2.0))
    return World(
        name="crowd",
        bounds=(-float(width) / 2, -float(depth) / 2, float(width) / 2, float(depth) / 2),
        cylinders=tuple(pillars),
        people=(Person(),) * people,
        spawn=SpawnRule(clearance=0.3),
    )


def corridor_crowd(rng: np.random.Generator, *, people: int = PEOPLE) -> World:
    """Draw corridors of 2 m and more, in which people walk between random places.

    Args:
        rng: source of randomness.
        people: how many.

    Raises:
        ConfigError: if the number of people is not from 0 to 100.
    """
    _check(people)
    drawn = corridors(rng, difficulty=float(rng.uniform(0.0, WIDE)))
    return replace(drawn, name="corridor-crowd", people=(Person(),) * people)


def _check(people: int) -> None:
    if not 0 <= people <= MOST:
        raise ConfigError(f"people must be from 0 to {MOST}, got {people}.")
