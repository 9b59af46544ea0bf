"""Forests of table and chair legs. Table tops are left out: the robots drive among the legs."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from hpp_framework.core.world import Cylinder, SpawnRule, World
from hpp_framework.worlds.generators.recipe import between, generate

GAP = (1.2, 0.6)
"""Least distance in metres between legs of different pieces, surface to surface, at difficulty 0 and 1."""

TABLES = (0.05, 0.6)
"""Tables tried a square metre at difficulty 0 and 1; the gap leaves no room for some."""

CHAIRS_PER_TABLE = 1.5
SIDE = (9.0, 13.0)
RADIUS = (0.02, 0.05)
TABLE_LENGTH, TABLE_WIDTH, CHAIR = (0.8, 1.8), (0.7, 1.2), (0.38, 0.5)
_SIGNS = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])


def legs(rng: np.random.Generator, *, difficulty: float | None = None) -> World:
    """Draw a room of tables and chairs, four legs each, no leg nearer than 0.6 m to one of another piece.

    Args:
        rng: source of randomness.
        difficulty: in [0, 1] brings more pieces, nearer to each other; None draws it.

    Raises:
        ConfigError: if the difficulty is not in [0, 1].
    """
    return generate(_draw, rng, difficulty)


def _draw(rng: np.random.Generator, difficulty: float) -> World:
    size = rng.uniform(*SIDE, 2)
    gap = between(*GAP, difficulty)
    tables = round(between(*TABLES, difficulty) * float(size.prod()))
    is_table = np.arange(round(tables * (1 + CHAIRS_PER_TABLE))) < tables
    pieces = _pieces(rng, size, is_table)
    fits = (np.abs(pieces[..., :2]) < size / 2 - pieces[..., 2:] - gap).all((1, 2))
    placed = np.zeros((0, 3))
    for piece in pieces[fits]:
        if _gaps(piece, placed).min(initial=math.inf) >= gap:
            placed = np.concatenate([placed, piece])
    width, depth = (size / 2).tolist()
    return World(
        name="legs",
        bounds=(-width, -depth, width, depth),
        cylinders=tuple(Cylinder(center=(x, y), radius=radius) for x, y, radius in placed.tolist()),
        spawn=SpawnRule(clearance=0.05),
    )


def _pieces(
    rng: np.random.Generator, size: npt.NDArray[np.float64], is_table: npt.NDArray[np.bool_]
) -> npt.NDArray[np.float64]:
    """Draw the legs (p, 4, 3) of pieces anywhere in a room of this size: x, y, radius in metres."""
    count = len(is_table)
    table = np.column_stack([rng.uniform(*TABLE_LENGTH, count), rng.uniform(*TABLE_WIDTH, count)])
    extent = np.where(is_table[:, None], table, rng.uniform(*CHAIR, (count, 1)))
    yaw = rng.uniform(-math.pi, math.pi, count)
    axis = np.stack([np.cos(yaw), np.sin(yaw)], -1)
    side = np.stack([-axis[:, 1], axis[:, 0]], -1)
    own = _SIGNS * extent[:, None]
    offsets = own[..., :1] * axis[:, None] + own[..., 1:] * side[:, None]
    centers = rng.uniform(-size / 2, size / 2, (count, 2))
    radii = np.broadcast_to(rng.uniform(*RADIUS, (count, 1, 1)), (count, 4, 1))
    return np.concatenate([centers[:, None] + offsets, radii], -1)


def _gaps(some: npt.NDArray[np.float64], others: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the gaps (a, b) between legs (a, 3) and legs (b, 3), surface to surface."""
    apart = np.linalg.norm(some[:, None, :2] - others[None, :, :2], axis=-1)
    return apart - some[:, None, 2] - others[None, :, 2]
