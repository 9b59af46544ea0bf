"""The mixture of worlds that far-sighted motion models are trained in."""

from __future__ import annotations

import numpy as np

from hpp_framework.core.world import World
from hpp_framework.worlds.generators.mixed import mixed
from hpp_framework.worlds.generators.training import training
from hpp_framework.worlds.generators.walls import walls

_KINDS = (training, mixed, walls)
_SHARES = (0.4, 0.35, 0.25)


def varied(rng: np.random.Generator) -> World:
    """Draw a furnished room, a world of ``mixed``, or long walls; its name tells which.

    Args:
        rng: source of randomness.
    """
    return _KINDS[int(rng.choice(len(_KINDS), p=_SHARES))](rng)
