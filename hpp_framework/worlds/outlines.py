"""Outlines with fewer lines: what a fine mesh is cut into, without the points that say nothing."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

Lines = npt.NDArray[np.float32]

JOINED = 1e-5
"""Ends nearer than about this are one point, in metres."""


def simplify(lines: Lines, tolerance: float) -> Lines:
    """Replace chains of lines by fewer lines (Ramer, Douglas and Peucker), all points within a tolerance.

    Points in which other than two lines meet stay, and closed outlines stay closed.

    Args:
        lines: (s, 4) x0, y0, x1, y1 in metres, in any order and direction.
        tolerance: largest distance of a point that is left out from the new line, in metres.

    Returns:
        (r, 4) lines with r <= s.
    """
    ends = np.unique(np.round(lines.reshape(-1, 2) / JOINED), axis=0, return_inverse=True)[1].reshape(-1, 2)
    points = np.zeros((int(ends.max(initial=-1)) + 1, 2), np.float32)
    points[ends.ravel()] = lines.reshape(-1, 2)
    parts = [_fewer(points[chain], tolerance) for chain in _chains(ends[ends[:, 0] != ends[:, 1]])]
    return np.concatenate([np.zeros((0, 4), np.float32), *parts])


def _fewer(chain: npt.NDArray[np.float32], tolerance: float) -> Lines:
    """Return the lines (r, 4) that stand for a chain of points (k, 2), closed if it ends where it begins."""
    closed = len(chain) > 3 and bool((chain[0] == chain[-1]).all())
    points = chain[:-1] if closed else chain
    kept = np.asarray(cv2.approxPolyDP(points[:, None], tolerance, closed)[:, 0], np.float32)
    if len(kept) < (3 if closed else 2):
        kept = points
    following = np.roll(kept, -1, 0) if closed else kept[1:]
    return np.concatenate([kept[: len(following)], following], -1)


def _chains(ends: npt.NDArray[np.int64]) -> list[list[int]]:
    """Walk along lines, given as indices (s, 2) of their ends; where not two lines meet, a walk ends."""
    at: dict[int, list[int]] = {}
    for line, pair in enumerate(ends.tolist()):
        for end in pair:
            at.setdefault(end, []).append(line)
    left = set(range(len(ends)))
    # first from loose ends and crossings; what is left after that are closed outlines
    starts = [end for end, lines in at.items() if len(lines) != 2] + list(at)
    pairs = ends.tolist()
    chains: list[list[int]] = []
    for start in starts:
        for line in at[start]:
            if line in left:
                chains.append(_walk(start, line, pairs, at, left))
    return chains


def _walk(
    start: int, line: int, pairs: list[list[int]], at: dict[int, list[int]], left: set[int]
) -> list[int]:
    chain = [start]
    while True:
        left.remove(line)
        first, second = pairs[line]
        chain.append(second if first == chain[-1] else first)
        onwards = [other for other in at[chain[-1]] if other in left]
        if len(at[chain[-1]]) != 2 or not onwards:
            return chain
        line = onwards[0]
