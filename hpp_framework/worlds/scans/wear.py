"""What a scanner makes of clean surfaces: every point is a little off, and there are holes."""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh

DRIFT, NOISE = 0.01, 0.003
"""Standard deviations of each coordinate of a point, in metres: what points above each other have
in common, and what each has of its own."""

LARGEST_NOISE = 0.02
"""Of both together, in metres; errors beyond it are clipped, as reconstructions drop outliers."""

HOLES = 0.2
"""Holes a square metre of surface."""

HOLE_RADIUS = (0.04, 0.15)
"""In metres: a robot is 0.58 m wide, so none falls through."""

FINEST = 0.12
"""Triangles around holes are divided until their sides are shorter than this, in metres."""


def wear(mesh: Any, rng: np.random.Generator) -> Any:
    """Return a mesh as a scan: joined where points coincide, noisy, and with holes.

    Args:
        mesh: a ``trimesh.Trimesh``.
        rng: source of randomness.
    """
    # points coincide but for rounding; what is joined stays joined under noise
    _, first, place = np.unique(np.round(mesh.vertices, 5), axis=0, return_index=True, return_inverse=True)
    points, faces = np.asarray(mesh.vertices)[first], place.ravel()[np.asarray(mesh.faces)]
    columns = np.unique(np.round(points[:, :2], 5), axis=0, return_inverse=True)[1].ravel()
    noise = rng.normal(0.0, DRIFT, points.shape)[columns] + rng.normal(0.0, NOISE, points.shape)
    points = points + np.clip(noise, -LARGEST_NOISE, LARGEST_NOISE)
    areas = np.asarray(trimesh.triangles.area(points[faces]))
    count = int(rng.poisson(HOLES * float(areas.sum())))
    chosen = points[faces[rng.choice(len(areas), count, p=areas / areas.sum())]]
    middles = (rng.dirichlet(np.ones(3), count)[:, :, None] * chosen).sum(1)
    for middle, radius in zip(middles, rng.uniform(*HOLE_RADIUS, count), strict=True):
        points, faces = _punch(points, faces, middle, float(radius))
    worn = trimesh.Trimesh(points, faces, process=False)
    worn.remove_unreferenced_vertices()
    return worn


def _punch(
    points: np.ndarray, faces: np.ndarray, middle: np.ndarray, radius: float
) -> tuple[np.ndarray, np.ndarray]:
    """Remove all triangles with their middle within a radius, after dividing those that are too large."""
    while True:
        corners = points[faces]
        low, high = corners.min(1) - radius, corners.max(1) + radius
        near = ((low < middle) & (middle < high)).all(-1)
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).max(1)
        large = np.flatnonzero(near & (sides > FINEST))
        if len(large) == 0:
            break
        points, faces = trimesh.remesh.subdivide(points, faces, face_index=large)[:2]
    inside = np.linalg.norm(points[faces].mean(1) - middle, axis=-1) < radius
    return points, faces[~inside]
