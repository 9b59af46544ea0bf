"""Corridors with bends, junctions, dead ends and alcoves, between solid blocks."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from hpp_framework.core.world import SpawnRule, World
from hpp_framework.worlds.generators.recipe import between, fill_cells, generate

WIDTH = (2.5, 0.9)
"""Narrowest corridor in metres at difficulty 0 and 1."""

SPREAD = 1.4
"""The widest corridor of a world as a multiple of the narrowest, but 2.5 m at most."""

BLOCK = (0.8, 2.6)
"""Thickness in metres of what lies between neighbouring corridors."""

EXTENT = 12.0
"""About how long and wide a world is, in metres."""

ALCOVES = (0.2, 0.5)
LOOPS = (0.5, 0.2)

Mask = npt.NDArray[np.bool_]


def corridors(rng: np.random.Generator, *, difficulty: float | None = None) -> World:
    """Draw a random spanning tree of corridors on a crooked lattice, with some loops and many alcoves.

    Args:
        rng: source of randomness.
        difficulty: in [0, 1] narrows corridors from 2.5 m to 0.9 m, and brings more of them, fewer loops and
            more alcoves; None draws it.

    Raises:
        ConfigError: if the difficulty is not in [0, 1].
    """
    return generate(_draw, rng, difficulty)


def _draw(rng: np.random.Generator, difficulty: float) -> World:
    narrowest = between(*WIDTH, difficulty)
    lines = int(np.clip(round(EXTENT / (narrowest + 1.5)), 3, 5))
    x, y = _edges(rng, lines, narrowest), _edges(rng, lines, narrowest)
    open_cells = np.zeros((3 * lines - 2, 3 * lines - 2), bool)
    open_cells[::3, ::3] = True
    along, across = spanning_links(rng, lines, between(*LOOPS, difficulty))
    for row, column in np.argwhere(along).tolist():
        open_cells[3 * row, 3 * column : 3 * column + 4] = True
    for row, column in np.argwhere(across).tolist():
        open_cells[3 * row : 3 * row + 4, 3 * column] = True
    open_cells |= _alcoves(rng, open_cells, between(*ALCOVES, difficulty))
    return World(
        name="corridors",
        bounds=(float(x[0]), float(y[0]), float(x[-1]), float(y[-1])),
        boxes=fill_cells(~open_cells, x, y),
        spawn=SpawnRule(clearance=0.05),
    )


def _edges(rng: np.random.Generator, lines: int, narrowest: float) -> npt.NDArray[np.float64]:
    """Return where cells begin and end: one per corridor, and two for each block between corridors."""
    widths = np.minimum(narrowest * rng.uniform(1.0, SPREAD, lines), WIDTH[0])
    blocks = rng.uniform(*BLOCK, lines - 1)
    cut = blocks * rng.uniform(0.35, 0.65, lines - 1)
    sizes = np.empty(3 * lines - 2)
    sizes[::3], sizes[1::3], sizes[2::3] = widths, cut, blocks - cut
    edges = np.concatenate([[0.0], np.cumsum(sizes)])
    return edges - edges[-1] / 2


def spanning_links(rng: np.random.Generator, lines: int, loops: float) -> tuple[Mask, Mask]:
    """Join all junctions of a lattice by a random tree (Kruskal), and some of the others on top.

    Args:
        rng: source of randomness.
        lines: junctions in a row and in a column.
        loops: twice the share of the links outside the tree that are opened too.

    Returns:
        (lines, lines - 1) links along x and (lines - 1, lines) links along y.
    """
    along, across = np.zeros((lines, lines - 1), bool), np.zeros((lines - 1, lines), bool)
    group = np.arange(lines * lines).reshape(lines, lines)
    links = [(row, column, 0, 1) for row in range(lines) for column in range(lines - 1)]
    links += [(row, column, 1, 0) for row in range(lines - 1) for column in range(lines)]
    for index in rng.permutation(len(links)).tolist():
        row, column, down, right = links[index]
        here, there = group[row, column], group[row + down, column + right]
        if here != there or rng.random() < loops / 2:
            group[group == there] = here
            (across if down else along)[row, column] = True
    return along, across


def _alcoves(rng: np.random.Generator, open_cells: Mask, share: float) -> Mask:
    """Open half blocks beside corridors: niches and blind turns, traps for who drives straight at a goal."""
    beside = np.zeros_like(open_cells)
    beside[1:] |= open_cells[:-1]
    beside[:-1] |= open_cells[1:]
    beside[:, 1:] |= open_cells[:, :-1]
    beside[:, :-1] |= open_cells[:, 1:]
    return beside & ~open_cells & (rng.random(open_cells.shape) < share / 2)
