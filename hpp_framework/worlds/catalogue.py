"""The worlds that come with the framework as world files, in the folder ``catalogue`` beside this module.

Factories have the registry's signature; the files hold no randomness, so the generator goes unused.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from hpp_framework.worlds.loader import load_world
from hpp_framework.worlds.world import World

FOLDER = Path(__file__).parent / "catalogue"


def simple(rng: np.random.Generator) -> World:
    """Return the empty room."""
    del rng
    return _bundled("simple")


def wall(rng: np.random.Generator) -> World:
    """Return the room with one wall between the robots."""
    del rng
    return _bundled("wall")


def navigation(rng: np.random.Generator) -> World:
    """Return the cluttered room."""
    del rng
    return _bundled("navigation")


@cache
def _bundled(name: str) -> World:
    return load_world(FOLDER / f"{name}.yaml")
