"""Surfaces made of small triangles: panels, boxes, prisms and tables, as a scanner would reconstruct them.

Neighbouring panels share the points of their common edge, so a box is closed before it is worn.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh

Points = npt.NDArray[np.float64]
Vector = Sequence[float] | Points

CELL = 1.0
"""Largest side of the cells in metres, two triangles each, that surfaces are cut into."""

TABLE_TOP = 1.2
"""Underside of table tops in metres: raised desks, so that Fetch (1.1 m) passes below them too."""

TABLE_TOP_THICKNESS = 0.04
LEG = 0.035
"""Radius of a table's leg in metres; so thin a thing is reconstructed with three sides."""


def panel(corner: Vector, along: Vector, up: Vector, cell: float = CELL) -> Any:
    """Return a parallelogram as a ``trimesh.Trimesh``, cut into cells of two triangles.

    Args:
        corner: (x, y, z) in metres.
        along: from there to the next corner, in metres.
        up: from there to the last corner, in metres.
        cell: largest side of a cell, in metres.
    """
    first, second = np.asarray(along, float), np.asarray(up, float)
    columns, rows = (max(1, math.ceil(np.linalg.norm(side) / cell - 1e-9)) for side in (first, second))
    u, v = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    points = np.asarray(corner, float) + u.reshape(-1, 1) * first + v.reshape(-1, 1) * second
    low = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    high = low + columns + 1
    faces = np.concatenate([np.stack([low, low + 1, high + 1], -1), np.stack([low, high + 1, high], -1)])
    return trimesh.Trimesh(points, faces, process=False)


def box(
    center: tuple[float, float],
    size: tuple[float, float],
    height: float,
    *,
    yaw: float = 0.0,
    base: float = 0.0,
    cell: float = CELL,
) -> Any:
    """Return the sides and the top of a box, and its underside if it floats.

    Args:
        center: (x, y) in metres.
        size: along its own x and y, in metres.
        height: of its top above ``base``, in metres.
        yaw: in radians, counter-clockwise.
        base: of its underside above the floor, in metres.
        cell: as in :func:`panel`.
    """
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    own = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]) * size
    return prism(np.asarray(center) + own @ turn.T, height, base=base, cell=cell)


def prism(outline: Points, height: float, *, base: float = 0.0, cell: float = CELL) -> Any:
    """Return the sides and the top of an upright prism, and its underside if it floats.

    Args:
        outline: (k, 2) counter-clockwise, convex; one of four corners must be a parallelogram.
        height: of its top above ``base``, in metres.
        base: of its underside above the floor, in metres.
        cell: as in :func:`panel`.
    """
    corners = np.column_stack([outline, np.full(len(outline), base)])
    up = (0.0, 0.0, height)
    parts = [
        panel(corner, after - corner, up, cell)
        for corner, after in zip(corners, np.roll(corners, -1, 0), strict=True)
    ]
    parts.append(_lid(corners + up, cell))
    if base > 0:
        parts.append(_lid(corners[::-1], cell))
    return trimesh.util.concatenate(parts)


def table(center: tuple[float, float], size: tuple[float, float], yaw: float) -> Any:
    """Return a raised desk: a top and a leg at each corner.

    Args:
        center: (x, y) in metres.
        size: along its own x and y, in metres.
        yaw: in radians, counter-clockwise.
    """
    top = box(center, size, TABLE_TOP_THICKNESS, yaw=yaw, base=TABLE_TOP)
    angles = yaw + np.arange(3) * 2 * math.pi / 3
    outline = LEG * np.stack([np.cos(angles), np.sin(angles)], -1)
    legs = [prism(leg + outline, TABLE_TOP, cell=TABLE_TOP) for leg in leg_centers(center, size, yaw)]
    return trimesh.util.concatenate([top, *legs])


def leg_centers(center: tuple[float, float], size: tuple[float, float], yaw: float) -> Points:
    """Return where the legs (4, 2) of a table stand, in metres."""
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    signs = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
    return np.asarray(center) + (signs * (np.asarray(size) - 2 * LEG)) @ turn.T


def _lid(corners: Points, cell: float) -> Any:
    if len(corners) == 4:
        return panel(corners[0], corners[1] - corners[0], corners[3] - corners[0], cell)
    fan = np.arange(1, len(corners) - 1)
    faces = np.stack([np.zeros_like(fan), fan, fan + 1], -1)
    return trimesh.Trimesh(corners, faces, process=False)
