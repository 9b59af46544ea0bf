"""Fields of obstacles after the BARN data set, the standard test of ground navigation in clutter.

From Perille, Truong, Xiao and Stone, "Benchmarking Metric Ground Navigation" (SSRR 2020), and the program the
authors published with it: a cellular automaton on 30 x 30 cells; initial fill ratios 0.15, 0.20, 0.25 and
0.30; 2 to 4 smoothing iterations; a cell fills with 5 or more filled neighbours of 8 and clears with 1 or
fewer; the rows beside the two side walls begin filled and what lies beyond them counts as filled; fields that
the robot cannot cross are thrown away.

Ours: cells of 1/6 m (0.15 m there) as our robots are larger than theirs, boxes for cells instead of
cylinders, open strips of 2 m at both ends, a wall all around, and the test of crossing: a disc of our robots'
radius and 5 cm more, on the grid of 0.1 m that pools of worlds use.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from hpp_framework.core.world import SpawnRule, World
from hpp_framework.worlds.generators.recipe import GRID, ROBOT_HEIGHT, ROBOT_RADIUS, fill_cells, settle
from hpp_framework.worlds.occupancy import free_space

CELLS = 30
FIELD = 5.0
"""Side of the field in metres."""

STRIP = 2.0
"""Depth of the open strips at both ends in metres."""

FILL_RATIOS = (0.15, 0.20, 0.25, 0.30)
ITERATIONS = (2, 4)
FILL_AT, CLEAR_AT = 5, 1
CLEARANCE = 0.05
_ZOOM = 3
_NEIGHBOURS = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]], np.uint8)


def barn(rng: np.random.Generator, *, difficulty: float | None = None) -> World:
    """Draw a field of 5 x 5 m that can be crossed, with an open strip at either end.

    Args:
        rng: source of randomness.
        difficulty: in [0, 1]; each quarter is one of the four fill ratios. None draws it.

    Raises:
        ConfigError: if the difficulty is not in [0, 1].
    """
    fill_ratio = FILL_RATIOS[level(settle(rng, difficulty))]
    iterations = int(rng.integers(ITERATIONS[0], ITERATIONS[1] + 1))
    # about 1 in 300 of the densest fields can be crossed, so the loop ends
    while True:
        cells = field(rng, fill_ratio, iterations)
        if may_cross(cells):
            world = build(cells)
            if crossable(world):
                return world


def level(difficulty: float) -> int:
    """Return which of the four fill ratios a difficulty stands for: 0 to 3."""
    return min(int(difficulty * len(FILL_RATIOS)), len(FILL_RATIOS) - 1)


def field(rng: np.random.Generator, fill_ratio: float, iterations: int) -> npt.NDArray[np.bool_]:
    """Run the cellular automaton.

    Args:
        rng: source of randomness.
        fill_ratio: share of cells that begin filled.
        iterations: of smoothing.

    Returns:
        (30, 30) filled cells; the path through leads along the rows.
    """
    cells = rng.random((CELLS, CELLS)) < fill_ratio
    cells[[0, -1]] = True
    for _ in range(iterations):
        # beyond the side walls all is filled, beyond the open ends nothing is
        padded = np.zeros((CELLS + 2, CELLS + 2), np.uint8)
        padded[[0, -1]] = 1
        padded[1:-1, 1:-1] = cells
        count = cv2.filter2D(padded, -1, _NEIGHBOURS, borderType=cv2.BORDER_CONSTANT)[1:-1, 1:-1]
        cells = (cells | (count >= FILL_AT)) & (count > CLEAR_AT)
    return cells


def build(cells: npt.NDArray[np.bool_]) -> World:
    """Return the world of a field (30, 30)."""
    edges = np.linspace(-FIELD / 2, FIELD / 2, CELLS + 1)
    return World(
        name="barn",
        bounds=(-FIELD / 2 - STRIP, -FIELD / 2, FIELD / 2 + STRIP, FIELD / 2),
        boxes=fill_cells(cells, edges, edges),
        spawn=SpawnRule(distance=FIELD + STRIP, axis=0.0, axis_spread=0.2, clearance=CLEARANCE),
    )


def may_cross(cells: npt.NDArray[np.bool_]) -> bool:
    """Return whether cells (30, 30) leave a robot a path along the rows, all roundings in its favour.

    Most dense fields fail this, and it is far quicker than :func:`crossable`, which decides.
    """
    solid = cells.astype(np.uint8)
    # the disc is wider than 4 cells: the 3 x 3 cells around its centre must be free
    if not _connected(cv2.dilate(solid, np.ones((3, 3), np.uint8)) == 0):
        return False
    fine = cv2.resize(solid, None, fx=_ZOOM, fy=_ZOOM, interpolation=cv2.INTER_NEAREST)
    walled = np.pad(1 - fine, ((1, 1), (0, 0)))
    distance = cv2.distanceTransform(walled, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1]
    pixel = FIELD / CELLS / _ZOOM
    return _connected(distance * pixel > ROBOT_RADIUS + CLEARANCE - pixel / 4)


def crossable(world: World) -> bool:
    """Return whether a robot with 5 cm around it can pass from one open strip to the other."""
    space = free_space(world, body_height=ROBOT_HEIGHT, resolution=GRID)
    strip = round(STRIP / GRID)
    return _connected(space.distance[:, strip - 1 : 1 - strip] > ROBOT_RADIUS + CLEARANCE)


def _connected(free: npt.NDArray[np.bool_]) -> bool:
    """Return whether free cells lead from the first column to the last."""
    _, regions = cv2.connectedComponents(free.astype(np.uint8), connectivity=8)
    ends = np.intersect1d(regions[:, 0], regions[:, -1])
    return bool((ends > 0).any())
