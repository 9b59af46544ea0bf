"""Where robots can stand, to the centimetre, in a part of a world."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt
from jaxtyping import Bool, Float, Int

from hpp_framework.core.world import World
from hpp_framework.worlds.occupancy import FreeSpace
from hpp_framework.worlds.slicing import planar_map

FINER = 4
"""Fine cells along a cell of a free space."""
YIELD = 0.005
"""Metres that contact may leave robots inside obstacles."""
_SHIFT = 8


@dataclass(frozen=True)
class Part:
    """A part of the grid of a free space.

    Attributes:
        low: its first column and row.
        shape: its rows and columns.
    """

    low: tuple[int, int]
    shape: tuple[int, int]

    def centres(self, space: FreeSpace) -> Float[np.ndarray, "p 2"]:
        """Return the centres of its cells in metres, row by row."""
        x, y = (np.arange(n) + 0.5 + first for n, first in zip(self.shape[::-1], self.low, strict=True))
        grid = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
        return grid * space.resolution + np.array(space.origin)

    def corners(self, space: FreeSpace) -> Float[np.ndarray, "2 2"]:
        """Return its least and greatest (x, y) in metres."""
        cells = np.array([self.low, np.array(self.low) + self.shape[::-1]])
        return cells * space.resolution + np.array(space.origin)

    def grown(self, cells: int, space: FreeSpace) -> Part:
        """Return a part that reaches further to all sides, but not out of the grid."""
        low = np.maximum(np.array(self.low) - cells, 0)
        high = np.minimum(np.array(self.low) + self.shape[::-1] + cells, space.distance.shape[::-1])
        return Part((int(low[0]), int(low[1])), (int(high[1] - low[1]), int(high[0] - low[0])))

    def of(
        self, field: Float[np.ndarray, "r c"], low: Int[np.ndarray, "2"], fill: float
    ) -> npt.NDArray[np.float64]:
        """Return a field on this part.

        Args:
            field: values by cell.
            low: its first column and row.
            fill: value where the field says nothing.
        """
        out = np.full(self.shape, fill)
        first = low[::-1] - np.array(self.low)[::-1]
        begin, end = np.maximum(first, 0), np.minimum(first + field.shape, self.shape)
        if (end > begin).all():
            source = field[begin[0] - first[0] : end[0] - first[0], begin[1] - first[1] : end[1] - first[1]]
            out[begin[0] : end[0], begin[1] : end[1]] = source
        return out


def standing_room(
    world: World, space: FreeSpace, part: Part, height: float, radius: float, doubt: float
) -> Bool[np.ndarray, "R C"]:
    """Return where the middle of a robot can be, on a grid :data:`FINER` times as fine.

    The free space decides where it is sure; where it is in doubt, all outlines are drawn on the fine grid.
    In case of doubt that is left a fine cell counts as free.

    Args:
        world: whose obstacles count.
        space: its free space for this height.
        part: of the free space.
        height: of the robot, in metres.
        radius: of the robot, in metres.
        doubt: metres by which the free space may call obstacles too near.
    """
    fine = space.resolution / FINER
    margin = int(np.ceil((radius + space.resolution) / fine))
    rows, columns = (FINER * n for n in part.shape)
    clear = np.ones((rows + 2 * margin, columns + 2 * margin), np.uint8)
    corner = np.array(space.origin) + np.array(part.low) * space.resolution - margin * fine
    segments, discs = _outlines(world, height)

    def pixels(points: npt.NDArray[np.floating]) -> npt.NDArray[np.int32]:
        # cv2 measures from the centre of a pixel
        return np.round(((points - corner) / fine - 0.5).clip(-1e4, 1e4) * (1 << _SHIFT)).astype(np.int32)

    cv2.polylines(clear, list(pixels(segments.reshape(-1, 2, 2))), False, 0, shift=_SHIFT)
    radii = np.round(discs[:, 2] / fine * (1 << _SHIFT)).astype(int)
    for centre, size in zip(pixels(discs[:, :2]).tolist(), radii.tolist(), strict=True):
        cv2.circle(clear, centre, size, 0, -1, shift=_SHIFT)
    gap = cv2.distanceTransform(clear, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * fine
    inner = gap[margin : margin + rows, margin : margin + columns]
    # off by half a diagonal each: where in its cell the outline is, and the robot
    possible = inner >= radius - np.sqrt(2) * fine - YIELD
    coarse = part.of(space.distance, np.zeros(2, np.int64), 0.0)
    return possible & finer(coarse > radius - doubt)


def finer(values: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
    """Return values by cell as values by fine cell."""
    return values.repeat(FINER, 0).repeat(FINER, 1)


@lru_cache(maxsize=64)
def _outlines(world: World, height: float) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    segments, discs = planar_map(world, lidar_heights=(), body_height=height).touched_below(height)
    return segments.astype(np.float64), discs.astype(np.float64)
