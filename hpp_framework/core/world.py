"""A world is data: obstacles, bounds and a rule for where robots start. It knows no simulator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.validation import NonNegative, Number, Positive, validated

WALL_THICKNESS = 0.1
WALL_HEIGHT = 1.0

Area = tuple[Number, Number, Number, Number]
"""x_min, y_min, x_max, y_max in metres."""


@validated
class Box:
    """An upright box.

    Attributes:
        center: (x, y) in metres.
        size: extents along its own x and y, in metres.
        yaw: rotation about z in radians.
        height: of its top above ``base``, in metres.
        base: height of its underside above the floor, in metres (a table top floats).
    """

    center: tuple[Number, Number]
    size: tuple[Positive, Positive]
    yaw: Number = 0.0
    height: Positive = 1.0
    base: Number = 0.0

    def corners(self) -> npt.NDArray[np.float64]:
        """Return the corners (4, 2), counter-clockwise."""
        return box_corners([self])[0]


def box_corners(boxes: Sequence[Box]) -> npt.NDArray[np.float64]:
    """Return the corners (boxes, 4, 2) of all boxes at once, counter-clockwise each."""
    numbers = np.array([(*box.center, *box.size, box.yaw) for box in boxes]).reshape(-1, 5)
    x, y, length, width, yaw = numbers.T[:, :, None]
    along, across = np.array([-0.5, 0.5, 0.5, -0.5]) * length, np.array([-0.5, -0.5, 0.5, 0.5]) * width
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.stack([x + cos * along - sin * across, y + sin * along + cos * across], -1)


@validated
class Cylinder:
    """An upright cylinder.

    Attributes:
        center: (x, y) in metres.
        radius: in metres.
        height: of its top above ``base``, in metres.
        base: height of its underside above the floor, in metres.
    """

    center: tuple[Number, Number]
    radius: Positive
    height: Positive = 1.0
    base: Number = 0.0


@validated
class Mesh:
    """A triangle mesh from any file trimesh reads (z up, metres).

    Attributes:
        file: the mesh file.
        position: (x, y, z) of its origin, in metres.
        yaw: rotation about z in radians.
        scale: factor applied to the file's coordinates.
    """

    file: Path
    position: tuple[Number, Number, Number] = (0.0, 0.0, 0.0)
    yaw: Number = 0.0
    scale: Positive = 1.0


@validated
class SpawnRule:
    """Where robots start.

    Two robots start ``distance`` apart (5 m in the paper); ``n`` robots start on a circle of that diameter,
    widened until neighbours have room.

    Attributes:
        distance: between the two robots, in metres.
        center: (x_min, y_min, x_max, y_max) of the circle's centre, or None for the whole free space.
        axis: angle in radians of the line from robot 1 to robot 0, or None for any.
        axis_spread: half-width in radians of a uniform disturbance of ``axis``.
        clearance: smallest gap between a footprint and an obstacle, in metres.
        poses: fixed starts (x, y, heading in radians), one a robot in team order; they replace all of the
            above but ``clearance``.
    """

    distance: Positive = 5.0
    center: Area | None = None
    axis: Number | None = None
    axis_spread: NonNegative = 0.0
    clearance: NonNegative = 0.15
    poses: tuple[tuple[Number, Number, Number], ...] | None = None

    def __post_init__(self) -> None:
        if self.center is not None:
            x_min, y_min, x_max, y_max = self.center
            if x_min > x_max or y_min > y_max:
                raise ConfigError(
                    f"spawn: center must be [x_min, y_min, x_max, y_max], got {list(self.center)}."
                )


@validated
class World:
    """Obstacles in a bounded area.

    Attributes:
        name: what it is called in results.
        bounds: (x_min, y_min, x_max, y_max) in metres.
        walled: whether walls of 1 m height stand along the bounds.
        boxes, cylinders, meshes: the obstacles.
        spawn: where robots start.
        file: the world file it was read from, for messages; None if it was made in code.
    """

    name: str
    bounds: Area = (-10.0, -10.0, 10.0, 10.0)
    walled: bool = True
    boxes: tuple[Box, ...] = ()
    cylinders: tuple[Cylinder, ...] = ()
    meshes: tuple[Mesh, ...] = ()
    spawn: SpawnRule = field(default_factory=SpawnRule)
    file: Path | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        x_min, y_min, x_max, y_max = self.bounds
        if x_max - x_min < 1.0 or y_max - y_min < 1.0:
            raise ConfigError(
                f"world '{self.name}': bounds must be [x_min, y_min, x_max, y_max], at least 1 m each way, "
                f"got {list(self.bounds)}."
            )

    @property
    def label(self) -> str:
        """The file, or else the name: how messages call this world."""
        return str(self.file) if self.file else f"world '{self.name}'"

    def solid_boxes(self) -> tuple[Box, ...]:
        """Return the boxes, and the outer walls if there are any."""
        return self.boxes + (self._walls() if self.walled else ())

    def _walls(self) -> tuple[Box, ...]:
        x_min, y_min, x_max, y_max = self.bounds
        center_x, center_y = (x_min + x_max) / 2, (y_min + y_max) / 2
        half = WALL_THICKNESS / 2
        long_x, long_y = x_max - x_min + 2 * WALL_THICKNESS, y_max - y_min + 2 * WALL_THICKNESS
        return (
            Box(center=(center_x, y_min - half), size=(long_x, WALL_THICKNESS), height=WALL_HEIGHT),
            Box(center=(center_x, y_max + half), size=(long_x, WALL_THICKNESS), height=WALL_HEIGHT),
            Box(center=(x_min - half, center_y), size=(WALL_THICKNESS, long_y), height=WALL_HEIGHT),
            Box(center=(x_max + half, center_y), size=(WALL_THICKNESS, long_y), height=WALL_HEIGHT),
        )
