"""A world as planar geometry: oriented segments and discs, each with the heights it spans.

The batch simulator, the occupancy grid and the top-down pictures all read a world through this module.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh
from trimesh.intersections import mesh_plane

from hpp_framework.core.world import Box, Mesh, World, box_corners
from hpp_framework.utils.errors import ConfigError
from hpp_framework.worlds.outlines import simplify

FloatArray = npt.NDArray[np.float32]

SEEN = 1
"""Flag of a segment or disc that lidars see."""
TOUCHED = 2
"""Flag of a segment or disc that robots touch."""
ONE_SIDED = 4
"""Flag of a segment that is only met from its right-hand side (outside of a counter-clockwise outline).

Such segments come in fours: the sides of a box, one after the other."""

BODY_SLICE_STEP = 0.1
LOWEST_SLICE = BODY_SLICE_STEP / 2
"""Metres above the floor below which a mesh is driven over: the floor of a scan is never quite level."""

TOLERANCE = 0.002
"""Metres by which the cut of a mesh may be off, so that it has fewer segments."""

_NUDGE = 1e-4


@dataclass(frozen=True)
class PlanarMap:
    """Segments and discs of one world.

    Attributes:
        segments: (s, 4) x0, y0, x1, y1 in metres.
        segment_heights: (s, 2) lowest and highest point in metres.
        segment_flags: (s,) sum of ``SEEN``, ``TOUCHED``, ``ONE_SIDED``.
        discs: (c, 3) x, y, radius in metres.
        disc_heights: (c, 2) lowest and highest point in metres.
    """

    segments: FloatArray
    segment_heights: FloatArray
    segment_flags: npt.NDArray[np.int32]
    discs: FloatArray
    disc_heights: FloatArray

    def touched_below(self, height: float) -> tuple[FloatArray, FloatArray]:
        """Return the segments (s, 4) and discs (c, 3) that a body of this height can touch."""
        touched = (self.segment_flags & TOUCHED > 0) & (self.segment_heights[:, 0] < height)
        return self.segments[touched], self.discs[self.disc_heights[:, 0] < height]


def planar_map(world: World, *, lidar_heights: Sequence[float], body_height: float) -> PlanarMap:
    """Slice a world.

    Args:
        world: the world.
        lidar_heights: heights of the lidar planes in the team, metres.
        body_height: height of the tallest robot, metres.

    Raises:
        ConfigError: if a mesh file is missing or holds no triangles.
    """
    boxes = world.solid_boxes()
    segments = [_outlines(boxes)]
    spans = np.array([(box.base, box.base + box.height) for box in boxes], np.float32).reshape(-1, 2)
    heights = [np.repeat(spans, 4, axis=0)]
    flags = [np.full(4 * len(boxes), SEEN | TOUCHED | ONE_SIDED, np.int32)]
    for mesh in world.meshes:
        for cut, span, flag in _slice_mesh(mesh, tuple(sorted(set(lidar_heights))), body_height):
            segments.append(cut)
            heights.append(np.tile(np.array(span, np.float32), (len(cut), 1)))
            flags.append(np.full(len(cut), flag, np.int32))
    discs = np.array([(*c.center, c.radius) for c in world.cylinders], np.float32).reshape(-1, 3)
    disc_spans = np.array([(c.base, c.base + c.height) for c in world.cylinders], np.float32).reshape(-1, 2)
    return PlanarMap(
        segments=np.concatenate(segments),
        segment_heights=np.concatenate(heights),
        segment_flags=np.concatenate(flags),
        discs=discs,
        disc_heights=disc_spans,
    )


def _outlines(boxes: Sequence[Box]) -> FloatArray:
    """Return the sides (4 * boxes, 4) of all boxes at once, in the order of their corners."""
    corners = box_corners(boxes)
    return np.concatenate([corners, np.roll(corners, -1, axis=1)], -1).reshape(-1, 4).astype(np.float32)


def solid_outlines(world: World, body_height: float) -> list[FloatArray]:
    """Return the outlines (s, 4) of watertight meshes, one array a mesh and level that a body can touch.

    Their inside is solid; that of an open mesh, such as the scan of a room, is unknown and left free.
    """
    return [
        cut
        for mesh in world.meshes
        if load_mesh(mesh).is_watertight
        for cut, (low, _), flag in _slice_mesh(mesh, (), body_height)
        if flag == TOUCHED and low < body_height
    ]


def load_mesh(mesh: Mesh) -> Any:
    """Return the placed ``trimesh.Trimesh`` of a mesh obstacle.

    Raises:
        ConfigError: if the file is missing, unreadable or holds no triangles.
    """
    loaded = _read_mesh(mesh.file).copy()
    placement = trimesh.transformations.rotation_matrix(mesh.yaw, [0, 0, 1])
    placement[:3, 3] = mesh.position
    loaded.apply_scale(mesh.scale)
    loaded.apply_transform(placement)
    return loaded


def standing_faces(placed: Any) -> npt.NDArray[np.int64]:
    """Return the faces (f, 3) of a placed mesh that are more than floor: they reach above the lowest slice.

    Args:
        placed: from :func:`load_mesh`.
    """
    faces = np.asarray(placed.faces)
    return faces[np.asarray(placed.vertices)[faces][..., 2].max(1) > LOWEST_SLICE]


@lru_cache(maxsize=64)
def _read_mesh(file: Path) -> Any:
    if not file.is_file():
        raise ConfigError(
            f"mesh file '{file}' does not exist. Paths in a world file are relative to that file."
        )
    try:
        loaded = trimesh.load(file, force="mesh")
    except Exception as error:
        raise ConfigError(
            f"mesh file '{file}' could not be read: {error}. Use STL, OBJ, PLY, GLB or OFF."
        ) from error
    if len(getattr(loaded, "faces", ())) == 0:
        raise ConfigError(f"mesh file '{file}' holds no triangles.")
    return loaded


@lru_cache(maxsize=256)
def _slice_mesh(
    mesh: Mesh, lidar_heights: tuple[float, ...], body_height: float
) -> tuple[tuple[FloatArray, tuple[float, float], int], ...]:
    """Cut a mesh at the lidar planes (seen) and every 10 cm of body height (touched)."""
    solid = load_mesh(mesh)
    cuts: list[tuple[FloatArray, tuple[float, float], int]] = []
    for height in lidar_heights:
        span = (height - 10 * _NUDGE, height + 10 * _NUDGE)
        cuts.append((_cut(solid, height), span, SEEN))
    levels = np.arange(LOWEST_SLICE, max(body_height, BODY_SLICE_STEP), BODY_SLICE_STEP)
    for level in levels:
        span = (float(level) - BODY_SLICE_STEP / 2, float(level) + BODY_SLICE_STEP / 2)
        cuts.append((_cut(solid, float(level)), span, TOUCHED))
    return tuple(cut for cut in cuts if len(cut[0]))


def _cut(solid: Any, height: float) -> FloatArray:
    # nudged off coplanar faces, which mesh_plane reports wrongly or not at all
    lines = np.asarray(mesh_plane(solid, plane_normal=[0, 0, 1], plane_origin=[0, 0, height + _NUDGE]))
    if len(lines) == 0:
        return np.zeros((0, 4), np.float32)
    flat = lines[:, :, :2].reshape(-1, 4).astype(np.float32)
    return simplify(flat, TOLERANCE)
