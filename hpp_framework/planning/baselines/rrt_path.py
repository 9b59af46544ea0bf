"""Paths as robots follow them: points at equal distances."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hpp_framework.planning.baselines.rrt_map import Points

SPACING = 0.1
"""Metres between the points of a path."""


def resampled(corners: Points) -> Points:
    """Return points (s, 2) along a path (p, 2) at equal distances, both ends included."""
    edges = np.linalg.norm(np.diff(corners, axis=0), axis=-1)
    lengths = np.concatenate([[0.0], edges.cumsum()])
    along = np.append(np.arange(0, lengths[-1], SPACING), lengths[-1])
    return np.stack([np.interp(along, lengths, corners[:, axis]) for axis in (0, 1)], -1)


def padded(paths: Sequence[Points]) -> Points:
    """Return paths (s, 2) of different lengths as one array (b, s, 2); the shorter ones stay at their end."""
    longest = max(len(path) for path in paths)
    return np.stack([np.pad(path, ((0, longest - len(path)), (0, 0)), mode="edge") for path in paths])
