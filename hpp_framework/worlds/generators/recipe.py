"""What the random worlds share: a difficulty between 0 and 1, and a check that there is room to drive.

A generator draws a world and has it checked::

    def rooms(rng, *, difficulty=None):
        return generate(_draw, rng, difficulty)
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from hpp_framework.core.world import Box, World
from hpp_framework.utils.errors import ConfigError
from hpp_framework.worlds.occupancy import free_space

ROBOT_RADIUS = 0.2877
"""Footprint radius in metres the worlds are made for: that of Fetch and Freight."""

ROBOT_HEIGHT = 1.1
CLEARANCE = 0.15
"""Gap in metres between robot and obstacles in the region that must be wide enough."""

SPAN = 6.0
"""Extent in metres of that region: goals 5 m away must be found from many of its points."""

GRID = 0.1
"""Resolution of the check in metres per cell, the same as that of world pools."""

ATTEMPTS = 500
_ANGLES = np.linspace(0, np.pi, 12, endpoint=False)


def generate(
    draw: Callable[[np.random.Generator, float], World],
    rng: np.random.Generator,
    difficulty: float | None,
    *,
    clearance: float = CLEARANCE,
) -> World:
    """Draw worlds until one has room: a connected region in which points lie 6 m and more apart.

    Args:
        draw: makes a world of a difficulty.
        rng: source of randomness.
        difficulty: in [0, 1], or None to draw it uniformly from ``rng``.
        clearance: gap around the robot in that region, metres.

    Raises:
        ConfigError: if the difficulty is not in [0, 1], or no world with room was found in 500 tries.
    """
    level = settle(rng, difficulty)
    name = "world"
    for _ in range(ATTEMPTS):
        world = draw(rng, level)
        if span(world, clearance) >= SPAN:
            return world
        name = world.label
    raise ConfigError(
        f"{name}: no world of difficulty {level:g} had a free region {SPAN:g} m long in {ATTEMPTS} "
        "tries. Use a lower difficulty."
    )


def settle(rng: np.random.Generator, difficulty: float | None) -> float:
    """Return the difficulty, or a uniform draw if it is None.

    Raises:
        ConfigError: if it is not in [0, 1].
    """
    if difficulty is None:
        return float(rng.random())
    if not 0 <= difficulty <= 1:
        raise ConfigError(
            f"difficulty must be a number from 0 (easy) to 1 (hard), or None to draw one, got {difficulty}."
        )
    return float(difficulty)


def span(world: World, clearance: float) -> float:
    """Return how far points of the largest free region lie apart, within 1 % below, in metres.

    Args:
        world: the world.
        clearance: gap between the robot and obstacles in that region, metres.
    """
    space = free_space(world, body_height=ROBOT_HEIGHT, resolution=GRID)
    rows, columns = np.nonzero(space.largest_region(ROBOT_RADIUS + clearance))
    if len(rows) == 0:
        return 0.0
    along = columns[:, None] * np.cos(_ANGLES) + rows[:, None] * np.sin(_ANGLES)
    return float(np.ptp(along, axis=0).max()) * GRID


def one_region(world: World, clearance: float) -> bool:
    """Return whether all places where a robot fits hang together.

    Args:
        world: the world.
        clearance: gap between the robot and obstacles, metres.
    """
    space = free_space(world, body_height=ROBOT_HEIGHT, resolution=GRID)
    return int(space.regions(ROBOT_RADIUS + clearance).max()) == 1


def between(easy: float, hard: float, difficulty: float) -> float:
    """Interpolate: ``easy`` at difficulty 0, ``hard`` at 1."""
    return easy + (hard - easy) * difficulty


def fill_cells(
    filled: npt.NDArray[np.bool_], x: npt.NDArray[np.floating], y: npt.NDArray[np.floating]
) -> tuple[Box, ...]:
    """Cover the filled cells of a grid with few boxes that do not overlap.

    Args:
        filled: (rows, columns) which cells are solid.
        x: (columns + 1,) where columns begin and end, metres, ascending.
        y: (rows + 1,) where rows begin and end, metres, ascending.
    """
    wide, tall = _rectangles(filled), _rectangles(filled.T)
    chosen = wide if len(wide) <= len(tall) else [(c, d, a, b) for a, b, c, d in tall]
    return tuple(
        rectangle(float(x[left]), float(y[low]), float(x[right]), float(y[high]))
        for low, high, left, right in chosen
    )


def rectangle(x_min: float, y_min: float, x_max: float, y_max: float) -> Box:
    """Return the box between two corners, in metres."""
    return Box(center=((x_min + x_max) / 2, (y_min + y_max) / 2), size=(x_max - x_min, y_max - y_min))


def _rectangles(filled: npt.NDArray[np.bool_]) -> list[tuple[int, int, int, int]]:
    """Cut into (first row, end row, first column, end column): runs in a row, grown over the rows above."""
    left_over = filled.copy()
    found: list[tuple[int, int, int, int]] = []
    for low, left in zip(*(indices.tolist() for indices in np.nonzero(filled)), strict=True):
        if not left_over[low, left]:
            continue
        stops = np.flatnonzero(~left_over[low, left:])
        right = left + int(stops[0]) if len(stops) else filled.shape[1]
        gaps = np.flatnonzero(~left_over[low:, left:right].all(axis=1))
        high = low + int(gaps[0]) if len(gaps) else filled.shape[0]
        left_over[low:high, left:right] = False
        found.append((low, high, left, right))
    return found
