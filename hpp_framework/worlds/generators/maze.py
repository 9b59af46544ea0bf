"""Mazes of low density. Held out for reports: nothing is trained or tuned in them."""

from __future__ import annotations

import numpy as np

from hpp_framework.core.world import Box, World
from hpp_framework.worlds.generators.corridors import spanning_links
from hpp_framework.worlds.generators.recipe import rectangle

CELLS = (5, 7)
PASSAGE = (1.4, 2.0)
"""Clear width of the narrowest paths of a maze, in metres."""

THICKNESS = (0.12, 0.3)
OPENED = 0.4
"""Share of the walls of a perfect maze (one with a single path between any two cells) that are left out."""


def maze(rng: np.random.Generator) -> World:
    """Draw a maze: cells joined by a random tree, with four in ten of the walls that are left taken out.

    Args:
        rng: source of randomness.
    """
    cells = int(rng.integers(CELLS[0], CELLS[1] + 1))
    wall = float(rng.uniform(*THICKNESS))
    pitch = float(rng.uniform(*PASSAGE)) + wall
    along, across = spanning_links(rng, cells, 2 * OPENED)
    # of the walls between cells, those beside a link along x stand upright
    half = cells * pitch / 2
    boxes = [
        _wall((column + 1) * pitch - half, row * pitch - half, pitch, wall, upright=True)
        for row, column in np.argwhere(~along).tolist()
    ]
    boxes += [
        _wall(column * pitch - half, (row + 1) * pitch - half, pitch, wall, upright=False)
        for row, column in np.argwhere(~across).tolist()
    ]
    return World(name="maze", bounds=(-half, -half, half, half), boxes=tuple(boxes))


def _wall(x: float, y: float, length: float, thickness: float, *, upright: bool) -> Box:
    """Return the wall that starts at (x, y); it overlaps with its neighbours by half its thickness."""
    half = thickness / 2
    if upright:
        return rectangle(x - half, y - half, x + half, y + length + half)
    return rectangle(x - half, y - half, x + length + half, y + half)
