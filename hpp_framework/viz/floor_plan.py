"""What top-down pictures draw of a world, as arrays: enough to draw it again without the world's files."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from hpp_framework.core.world import World, box_corners
from hpp_framework.worlds.slicing import planar_map, solid_outlines

Floats = np.ndarray


@dataclass(frozen=True, kw_only=True)
class FloorPlan:
    """A world as seen from above by a team.

    Attributes:
        bounds: (x_min, y_min, x_max, y_max) in metres.
        boxes: corners of the boxes, metres.
        boxes_touched: whether robots can touch them; the others hang above all robots.
        discs: x, y and radius of the cylinders, metres.
        discs_touched: whether robots can touch them.
        outlines: ends of the lines around solid parts of meshes, one array a slice, metres.
        lines: ends of all lines of meshes that robots can touch, metres.
    """

    bounds: tuple[float, float, float, float]
    boxes: Float[Floats, "m 4 2"]
    boxes_touched: Bool[np.ndarray, "m"]
    discs: Float[Floats, "c 3"]
    discs_touched: Bool[np.ndarray, "c"]
    outlines: tuple[Float[Floats, "_ 2 2"], ...]
    lines: Float[Floats, "s 2 2"]


def floor_plan(world: World, *, body_height: float) -> FloorPlan:
    """Return what is drawn of a world.

    Args:
        world: the world.
        body_height: height of the tallest robot, metres; what begins above it is not touched.
    """
    boxes = world.solid_boxes()
    outlines: tuple[np.ndarray, ...] = ()
    lines = np.zeros((0, 2, 2))
    if world.meshes:
        bare = World(name=world.name, bounds=world.bounds, walled=False, meshes=world.meshes)
        outlines = tuple(o.reshape(-1, 2, 2).astype(np.float64) for o in solid_outlines(bare, body_height))
        touched, _ = planar_map(bare, lidar_heights=(), body_height=body_height).touched_below(body_height)
        lines = touched.reshape(-1, 2, 2).astype(np.float64)
    return FloorPlan(
        bounds=world.bounds,
        boxes=box_corners(boxes),
        boxes_touched=np.array([box.base < body_height for box in boxes], bool),
        discs=np.array([(*c.center, c.radius) for c in world.cylinders], np.float64).reshape(-1, 3),
        discs_touched=np.array([c.base < body_height for c in world.cylinders], bool),
        outlines=outlines,
        lines=lines,
    )
