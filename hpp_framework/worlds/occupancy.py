"""Free space of a world on a grid: distance to the nearest obstacle and what can be reached from where."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt
from scipy import ndimage

from hpp_framework.core.world import World, box_corners
from hpp_framework.worlds.slicing import planar_map, solid_outlines

RESOLUTION = 0.05


@dataclass(frozen=True)
class FreeSpace:
    """Distances on a grid over a world's bounds.

    Attributes:
        distance: (rows, columns) metres from a cell's centre to the nearest obstacle or bound; row 0 is
            at y_min.
        origin: (x, y) of the corner of cell (0, 0).
        resolution: metres per cell.
    """

    distance: npt.NDArray[np.float32]
    origin: tuple[float, float]
    resolution: float

    def at(self, points: npt.NDArray[np.floating]) -> npt.NDArray[np.float32]:
        """Return the distance to the nearest obstacle at points (..., n, 2); 0 outside the bounds."""
        rows, columns, inside = self._cells(points)
        return np.where(inside, self.distance[rows, columns], 0.0).astype(np.float32)

    def contains(self, point: npt.NDArray[np.floating]) -> bool:
        """Return whether a point (x, y) lies within the bounds."""
        return bool(self._cells(point[None])[2].all())

    def distance_from(self, point: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
        """Return the distance (rows, columns) in metres from a point (x, y) to the centres of cells."""
        rows, columns = self.distance.shape
        x = self.origin[0] + (np.arange(columns) + 0.5) * self.resolution - point[0]
        y = self.origin[1] + (np.arange(rows) + 0.5) * self.resolution - point[1]
        return np.hypot(x, y[:, None])

    def regions(self, clearance: float) -> npt.NDArray[np.int32]:
        """Label the connected regions (rows, columns) where a disc of this radius fits; 0 is blocked."""
        free = self.distance > clearance
        labels = np.zeros(free.shape, np.int32)
        ndimage.label(free, structure=np.ones((3, 3)), output=labels)
        return labels

    def largest_region(self, clearance: float) -> npt.NDArray[np.bool_]:
        """Return the mask (rows, columns) of the largest region where a disc of this radius fits."""
        labels = self.regions(clearance)
        sizes = np.bincount(labels.ravel())
        sizes[0] = 0
        return np.asarray((labels == sizes.argmax()) & (labels > 0))

    def look_up(
        self, labels: npt.NDArray[np.int32], points: npt.NDArray[np.floating]
    ) -> npt.NDArray[np.int32]:
        """Return the region labels (..., n) at points (..., n, 2); 0 outside the bounds."""
        rows, columns, inside = self._cells(points)
        return np.where(inside, labels[rows, columns], 0).astype(np.int32)

    def sample(
        self, mask: npt.NDArray[np.bool_], count: int, rng: np.random.Generator
    ) -> npt.NDArray[np.float64]:
        """Draw points (count, 2) uniformly from the cells where ``mask`` is true."""
        rows, columns = np.nonzero(mask)
        chosen = rng.integers(len(rows), size=count)
        cells = np.stack([columns[chosen], rows[chosen]], -1) + rng.random((count, 2))
        return cells * self.resolution + np.array(self.origin)

    def _cells(
        self, points: npt.NDArray[np.floating]
    ) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
        cells = np.floor((np.asarray(points) - np.array(self.origin)) / self.resolution).astype(np.int64)
        rows, columns = self.distance.shape
        inside = (
            (cells[..., 0] >= 0) & (cells[..., 0] < columns) & (cells[..., 1] >= 0) & (cells[..., 1] < rows)
        )
        return np.clip(cells[..., 1], 0, rows - 1), np.clip(cells[..., 0], 0, columns - 1), inside


def free_space(world: World, *, body_height: float, resolution: float = RESOLUTION) -> FreeSpace:
    """Rasterise a world for a body of the given height; people and moving obstacles are left out.

    Equal worlds are rasterised once and share the result: do not write into it.

    Args:
        world: the world.
        body_height: obstacles that begin above this are ignored, metres.
        resolution: metres per cell.
    """
    return _free_space(world.at_rest(), body_height, resolution)


@lru_cache(maxsize=64)
def _free_space(world: World, body_height: float, resolution: float) -> FreeSpace:
    flat = planar_map(world, lidar_heights=(), body_height=body_height)
    segments, discs = flat.touched_below(body_height)
    x_min, y_min, x_max, y_max = world.bounds
    shape = (int(np.ceil((y_max - y_min) / resolution)), int(np.ceil((x_max - x_min) / resolution)))
    blocked = np.zeros((shape[0] + 2, shape[1] + 2), np.uint8)
    blocked[[0, -1], :] = 1
    blocked[:, [0, -1]] = 1
    to_pixel = _PixelGrid(np.array([x_min, y_min], np.float64), resolution)
    boxes = [box for box in world.boxes if box.base < body_height]
    for corners in to_pixel(box_corners(boxes)):
        cv2.fillPoly(blocked, [corners], 1, shift=to_pixel.shift)
    cv2.polylines(blocked, list(to_pixel(segments.reshape(-1, 2, 2))), False, 1, shift=to_pixel.shift)
    for lines in solid_outlines(world, body_height):
        blocked |= fill_outlines(to_pixel.cells(lines.reshape(-1, 2, 2)), blocked.shape)
    radii = np.round(discs[:, 2].astype(np.float64) / resolution * (1 << to_pixel.shift)).astype(int)
    for center, radius in zip(to_pixel(discs[:, :2]).tolist(), radii.tolist(), strict=True):
        cv2.circle(blocked, center, radius, 1, -1, shift=to_pixel.shift)
    distance = np.asarray(ndimage.distance_transform_edt(blocked == 0)) * resolution
    inner = np.maximum(distance[1:-1, 1:-1] - resolution / 2, 0).astype(np.float32)
    return FreeSpace(distance=inner, origin=(x_min, y_min), resolution=resolution)


@dataclass(frozen=True)
class _PixelGrid:
    origin: npt.NDArray[np.float64]
    resolution: float
    shift: int = 8

    def cells(self, points: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
        # one cell of margin; cv2 measures from the centre of a pixel
        return np.clip((points - self.origin) / self.resolution + 0.5, -1e4, 1e4)

    def __call__(self, points: npt.NDArray[np.floating]) -> npt.NDArray[np.int32]:
        return np.round(self.cells(points) * (1 << self.shift)).astype(np.int32)


def fill_outlines(lines: npt.NDArray[np.float64], shape: tuple[int, ...]) -> npt.NDArray[np.uint8]:
    """Fill the inside of closed outlines by the even-odd rule.

    Args:
        lines: (s, 2, 2) their lines in any order and direction, column and row of each end.
        shape: rows and columns of the result.

    Returns:
        (rows, columns) ones inside, zeros outside.
    """
    flips = np.zeros((shape[0], shape[1] + 1), np.uint8)
    for (x0, y0), (x1, y1) in lines:
        low, high = (y0, y1) if y0 < y1 else (y1, y0)
        rows = np.arange(max(math.ceil(low), 0), min(math.ceil(high), shape[0]))
        if len(rows):
            columns = np.ceil(x0 + (rows - y0) * (x1 - x0) / (y1 - y0)).astype(int)
            flips[rows, np.clip(columns, 0, shape[1])] ^= 1
    return np.bitwise_xor.accumulate(flips, axis=1)[:, :-1]
