"""The worlds that come with the framework as world files, in the folder ``catalogue`` beside this module.

Factories have the registry's signature; the files hold no randomness, so the generator goes unused.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from hpp_framework.core.world import World
from hpp_framework.worlds.loader import load_world

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


def real_simple(rng: np.random.Generator) -> World:
    """Return the scanned room with furniture along its walls."""
    del rng
    return _bundled("real-simple")


def real_wall(rng: np.random.Generator) -> World:
    """Return the scanned room with a row of cupboards between the robots."""
    del rng
    return _bundled("real-wall")


def real_forest(rng: np.random.Generator) -> World:
    """Return the scanned room full of raised desks."""
    del rng
    return _bundled("real-forest")


def real_roundabout(rng: np.random.Generator) -> World:
    """Return the scanned room with a path around an island."""
    del rng
    return _bundled("real-roundabout")


@cache
def _bundled(name: str) -> World:
    return load_world(FOLDER / f"{name}.yaml")
