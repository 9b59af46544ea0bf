"""When and where a team can have met, from the steps at which each robot can be in each cell of a grid."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import cv2
import numpy as np
from jaxtyping import Bool, Int

from hpp_framework.evaluation.standing import FINER


def coarser(arrivals: Sequence[Int[np.ndarray, "R C"]]) -> list[Int[np.ndarray, "r c"]]:
    """Return the earliest arrivals by coarse cell."""
    rows, columns = (n // FINER for n in arrivals[0].shape)
    return [steps.reshape(rows, FINER, columns, FINER).min((1, 3)) for steps in arrivals]


def first_met(have_met: Callable[[int], bool], low: int, limit: int) -> int:
    """Return the first step from ``low`` on at which the team can have met, limit + 1 if none, by halving."""
    if low > limit or have_met(low):
        return low
    low, high = low + 1, limit + 1
    while low < high:
        middle = (low + high) // 2
        if have_met(middle):
            high = middle
        else:
            low = middle + 1
    return low


def meeting_box(
    arrivals: Sequence[Int[np.ndarray, "r c"]], radius: float, step: int
) -> tuple[slice, slice] | None:
    """Return the rows and columns of the cells within a radius of one where each robot can be, None without.

    Args:
        arrivals: first step at which each robot can be in each cell.
        radius: in cells.
        step: at which they meet.
    """
    reached = [steps <= step for steps in arrivals]
    if not all(cells.any() for cells in reached):
        return None
    part = _around_all(reached, math.ceil(radius))
    together = np.ones(reached[0][part].shape, np.bool_)
    for cells in reached:
        away = (~cells[part]).astype(np.uint8)
        if away.all():
            return None
        together &= cv2.distanceTransform(away, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) <= radius
    if not together.any():
        return None
    ends = [np.flatnonzero(together.any(1 - axis))[[0, -1]] + part[axis].start for axis in (0, 1)]
    rows, columns = (slice(int(first), int(last) + 1) for first, last in ends)
    return rows, columns


def _around_all(reached: Sequence[Bool[np.ndarray, "r c"]], radius: int) -> tuple[slice, slice]:
    """Return the rows and columns where what all robots reach comes within twice a radius."""
    parts: list[slice] = []
    for axis, size in enumerate(reached[0].shape):
        ends = [np.flatnonzero(cells.any(1 - axis))[[0, -1]] for cells in reached]
        low = max(int(first) for first, _ in ends) - 2 * radius
        high = min(int(last) for _, last in ends) + 2 * radius + 1
        parts.append(slice(max(low, 0), min(max(high, low, 1), size)))
    return parts[0], parts[1]
