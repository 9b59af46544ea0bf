"""Sorts the obstacles of a pool of worlds into grids, for the kernels of the batch simulator.

Every obstacle lies whole in the one cell that holds its middle, and may reach out of it; nothing is cut, so
there are no cracks, and nothing is met twice. What is longer than a cell lies in an extra cell that is always
looked at.
All worlds are sorted together, without a loop over worlds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from hpp_framework.sim.batch import kernels as batch_kernels
from hpp_framework.utils.kernels import wp
from hpp_framework.worlds.slicing import ONE_SIDED, SEEN, TOUCHED, PlanarMap

SEEN_CONTENT = 6
"""Obstacles per cell that the grids of lidars aim at: with more, more are looked at in vain; with fewer,
there are too many cells."""
TOUCHED_CONTENT = 1
"""Obstacles per cell that the grids of bodies aim at."""
MAX_CELLS = 32
"""Cells along one side of a grid, at most."""
MARGIN = 1e-4
"""Metres that circles around cells are widened by against rounding."""

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Layer:
    """What lies at one lidar height, or is touched by one body height, in all worlds of a pool.

    Attributes:
        boxes: (b, 6) as ``batch_kernels.Box`` has them.
        box_world: (b,) index of each box's world.
        discs: (c, 3) x, y, radius in metres.
        disc_world: (c,) index of each disc's world.
        content: obstacles per cell that its grids aim at.
    """

    boxes: Floats
    box_world: Indices
    discs: Floats
    disc_world: Indices
    content: float


@dataclass(frozen=True)
class _Gridded:
    """A layer in the order of its cells, and its cells, as structured arrays."""

    grids: npt.NDArray[Any]
    cells: npt.NDArray[Any]
    boxes: Floats
    discs: Floats


def build_geometry(
    maps: Sequence[PlanarMap], seen_from: Sequence[float], touched_below: Sequence[float], device: Any
) -> Any:
    """Sort the worlds of a pool into grids, on a device.

    Args:
        maps: the worlds.
        seen_from: heights of lidars in metres; each gets a layer.
        touched_below: heights of bodies in metres; each gets a layer, after those of the lidars.
        device: Warp's.

    Returns:
        A ``batch_kernels.Geometry``.
    """
    layers = _layers(maps, seen_from, touched_below)
    gridded = [_sort(layer, len(maps)) for layer in layers]
    cell, box, disc = 0, 0, 0
    for part in gridded:
        part.grids["first_cell"] += cell
        part.cells["first_box"] += box
        part.cells["first_disc"] += disc
        cell, box, disc = cell + len(part.cells), box + len(part.boxes), disc + len(part.discs)
    last = np.zeros(1, gridded[0].cells.dtype)
    last["first_box"], last["first_disc"] = box, disc
    geometry = batch_kernels.Geometry()
    geometry.worlds = len(maps)

    def array(data: npt.NDArray[Any], dtype: Any) -> Any:
        return wp.array(data, dtype=dtype, device=device)

    geometry.grids = array(np.concatenate([part.grids for part in gridded]), batch_kernels.Grid)
    geometry.cells = array(np.concatenate([*(part.cells for part in gridded), last]), batch_kernels.Cell)
    boxes = np.concatenate([part.boxes for part in gridded]).astype(np.float32)
    geometry.boxes = array(boxes.view(_dtype(batch_kernels.Box))[:, 0], batch_kernels.Box)
    geometry.discs = array(np.concatenate([part.discs for part in gridded]).astype(np.float32), wp.vec3)
    return geometry


def _layers(
    maps: Sequence[PlanarMap], seen_from: Sequence[float], touched_below: Sequence[float]
) -> list[Layer]:
    segments = np.concatenate([m.segments for m in maps]).astype(np.float64)
    one_sided = np.concatenate([m.segment_flags for m in maps]) & ONE_SIDED > 0
    boxes = np.concatenate(
        [_boxes(segments[one_sided][0::4], segments[one_sided][1::4]), _lines(segments[~one_sided])]
    )

    def of_each(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        return np.concatenate([values[one_sided][::4], values[~one_sided]])

    heights = of_each(np.concatenate([m.segment_heights for m in maps]))
    flags = of_each(np.concatenate([m.segment_flags for m in maps]))
    box_world = of_each(np.repeat(np.arange(len(maps)), [len(m.segments) for m in maps]))
    discs = np.concatenate([m.discs for m in maps]).astype(np.float64)
    disc_heights = np.concatenate([m.disc_heights for m in maps])
    disc_world = np.repeat(np.arange(len(maps)), [len(m.discs) for m in maps])
    layers: list[Layer] = []
    for height in seen_from:
        chosen = (flags & SEEN > 0) & (heights[:, 0] <= height) & (height < heights[:, 1])
        round_ = (disc_heights[:, 0] <= height) & (height < disc_heights[:, 1])
        layers.append(
            Layer(boxes[chosen], box_world[chosen], discs[round_], disc_world[round_], SEEN_CONTENT)
        )
    for height in touched_below:
        chosen = (flags & TOUCHED > 0) & (heights[:, 0] < height)
        round_ = disc_heights[:, 0] < height
        layers.append(
            Layer(boxes[chosen], box_world[chosen], discs[round_], disc_world[round_], TOUCHED_CONTENT)
        )
    return layers


def _boxes(first: Floats, second: Floats) -> Floats:
    """Return rectangles (b, 6) of which two neighbouring sides (b, 4) are given."""
    along, across = first[:, 2:] - first[:, :2], second[:, 2:] - second[:, :2]
    length, width = np.hypot(*along.T)[:, None], np.hypot(*across.T)[:, None]
    # a point may face anywhere
    unit = np.where(length > 0, along / np.maximum(length, 1e-12), [1.0, 0.0])
    return np.concatenate([first[:, :2] + (along + across) / 2, unit, length / 2, width / 2], 1)


def _lines(segments: Floats) -> Floats:
    """Return segments as rectangles (s, 6) without width."""
    return _boxes(segments, segments[:, [2, 3, 2, 3]])


def _sort(layer: Layer, worlds: int) -> _Gridded:
    """Put each obstacle into a cell and order them by it."""
    middle = np.concatenate([layer.boxes[:, :2], layer.discs[:, :2]])
    reach = np.concatenate([np.hypot(layer.boxes[:, 4], layer.boxes[:, 5]), layer.discs[:, 2]])
    world = np.concatenate([layer.box_world, layer.disc_world])
    grids, cell_size = _grids(middle, world, worlds, layer.content)
    columns, rows = grids["columns"][world], grids["rows"][world]
    place = (middle - grids["origin"][world]) * grids["cells_per_metre"][world]
    column = np.clip(place[:, 0].astype(np.int64), 0, columns - 1)
    row = np.clip(place[:, 1].astype(np.int64), 0, rows - 1)
    long = 2 * reach > cell_size[world]
    inside = np.where(long, rows * columns, row * columns + column)
    cell = grids["first_cell"][world] + inside
    np.maximum.at(grids["spill"], world, np.where(long, 0, reach))
    total = int((grids["rows"] * grids["columns"] + 1).sum())
    is_disc = np.arange(len(cell)) >= len(layer.boxes)
    by_box = np.argsort(cell[~is_disc], kind="stable")
    by_disc = np.argsort(cell[is_disc], kind="stable")
    cells = np.zeros(total, _dtype(batch_kernels.Cell))
    cells["first_box"] = _starts(cell[~is_disc], total)
    cells["first_disc"] = _starts(cell[is_disc], total)
    cells["center"], cells["radius"] = _circles(middle, reach, cell, total)
    return _Gridded(grids, cells, layer.boxes[by_box], layer.discs[by_disc])


def _grids(middle: Floats, world: Indices, worlds: int, content: float) -> tuple[npt.NDArray[Any], Floats]:
    """Return one grid per world over the middles (s, 2) of its obstacles, and the longer sides of cells."""
    low, high = np.full((worlds, 2), np.inf), np.full((worlds, 2), -np.inf)
    np.minimum.at(low, world, middle)
    np.maximum.at(high, world, middle)
    empty = ~np.isfinite(low[:, 0])
    low[empty], high[empty] = 0.0, 1.0
    counts = np.bincount(world, minlength=worlds)
    side = np.clip(np.sqrt(counts / content).round(), 1, MAX_CELLS).astype(np.int32)
    extent = np.maximum(high - low, 1e-3)
    size = extent / side[:, None]
    grids = np.zeros(worlds, _dtype(batch_kernels.Grid))
    grids["origin"] = low
    grids["cells_per_metre"] = 1 / size
    grids["cell_size"] = size.min(1)
    grids["columns"] = grids["rows"] = side
    grids["first_cell"] = np.concatenate([[0], np.cumsum(side * side + 1)[:-1]])
    return grids, size.max(1)


def _dtype(struct: Any) -> np.dtype[Any]:
    return np.dtype(struct.numpy_dtype())


def _starts(cell: Indices, cells: int) -> Indices:
    """Return how many of the sorted obstacles come before each cell (cells,)."""
    counts = np.bincount(cell, minlength=cells)
    return np.cumsum(counts) - counts


def _circles(middle: Floats, reach: Floats, cell: Indices, cells: int) -> tuple[Floats, Floats]:
    """Return centres (cells, 2) and radii (cells,) of circles around the content; no content, radius 0."""
    low, high = np.full((cells, 2), np.inf), np.full((cells, 2), -np.inf)
    np.minimum.at(low, cell, middle)
    np.maximum.at(high, cell, middle)
    filled = np.isfinite(low[:, 0])
    low[~filled] = high[~filled] = 0.0
    center = (low + high) / 2
    radius = np.zeros(cells)
    gaps = middle - center[cell]
    np.maximum.at(radius, cell, np.hypot(gaps[:, 0], gaps[:, 1]) + reach + MARGIN)
    return center, radius
