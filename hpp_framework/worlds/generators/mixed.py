"""The mixture of worlds that skills are trained in."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hpp_framework.core.world import World
from hpp_framework.worlds.generators.barn import barn
from hpp_framework.worlds.generators.corridors import corridors
from hpp_framework.worlds.generators.legs import legs
from hpp_framework.worlds.generators.passages import passages
from hpp_framework.worlds.generators.recipe import between, generate, settle
from hpp_framework.worlds.generators.rooms import rooms
from hpp_framework.worlds.generators.training import Furniture, training

SHARES = {"furnished": 0.3, "rooms": 0.15, "corridors": 0.1, "passages": 0.15, "legs": 0.15, "barn": 0.15}
"""How often each kind comes up."""

SIDE = (10.0, 20.0)
PIECES = (12, 40)
"""Pieces of furniture a room of 20 x 20 m at difficulty 0 and 1: the range of ``training``."""


def mixed(rng: np.random.Generator, *, difficulty: float | None = None) -> World:
    """Draw a world of a random kind; its name tells which.

    Args:
        rng: source of randomness.
        difficulty: in [0, 1]; None draws it.

    Raises:
        ConfigError: if the difficulty is not in [0, 1].
    """
    level = settle(rng, difficulty)
    kind = list(SHARES)[int(rng.choice(len(SHARES), p=list(SHARES.values())))]
    return _KINDS[kind](rng, difficulty=level)


def furnished(rng: np.random.Generator, *, difficulty: float | None = None) -> World:
    """Draw a room as in ``training``, but 10 to 20 m wide, with furniture by area and difficulty.

    Args:
        rng: source of randomness.
        difficulty: in [0, 1]; None draws it.

    Raises:
        ConfigError: if the difficulty is not in [0, 1].
    """
    return generate(_furnish, rng, difficulty)


def _furnish(rng: np.random.Generator, difficulty: float) -> World:
    side = float(rng.uniform(*SIDE))
    pieces = between(*PIECES, difficulty) * (side / SIDE[1]) ** 2
    return training(rng, Furniture(side=side, pieces=(round(0.8 * pieces), round(1.2 * pieces))))


_KINDS: dict[str, Callable[..., World]] = {
    "furnished": furnished,
    "rooms": rooms,
    "corridors": corridors,
    "passages": passages,
    "legs": legs,
    "barn": barn,
}
