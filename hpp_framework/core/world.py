"""A world is data: obstacles, bounds and a rule for where robots start. It knows no simulator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt

from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.validation import Flag, NonNegative, Number, Positive, validated

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
class Person:
    """A pedestrian, an upright cylinder that walks from place to place and avoids what it meets.

    Without waypoints and goal it walks between random places, which belong to the episode; see
    :func:`hpp_framework.worlds.people.populate`.

    Attributes:
        start: (x, y) in metres, or None: its first waypoint, or else a random free place.
        waypoints: (x, y) of the places that it walks to after its start, in straight lines, in metres.
        goal: (x, y) of the one place that it walks to along a shortest path and stays at, or None.
        loop: whether it returns from the last waypoint to its start and walks on; else it stays there.
        speed: that it prefers, in m/s; 0 for a person who stands; None for a random one.
        radius: of its body, in metres.
        height: in metres.
    """

    start: tuple[Number, Number] | None = None
    waypoints: tuple[tuple[Number, Number], ...] = ()
    goal: tuple[Number, Number] | None = None
    loop: Flag = True
    speed: NonNegative | None = None
    radius: Positive = 0.25
    height: Positive = 1.7

    def __post_init__(self) -> None:
        if self.waypoints and self.goal is not None:
            raise ConfigError("person: 'goal' has no use beside 'waypoints'; remove one of the two.")

    @property
    def route(self) -> tuple[tuple[float, float], ...]:
        """Start and waypoints, the places it walks along; empty while its start is unknown."""
        return () if self.start is None else (self.start, *self.waypoints)

    @property
    def settled(self) -> bool:
        """Whether nothing about this person is left to chance."""
        known = self.start is not None and self.speed is not None and self.goal is None
        return known and (bool(self.waypoints) or self.speed == 0)


@validated
class MovingObstacle:
    """A box or an upright cylinder on a timetable, for example a sliding door; it avoids nothing.

    It moves in straight lines from place to place. Before the first time it is at the first place, after the
    last at the last one.

    Attributes:
        path: (time, x, y) of its centre, in seconds and metres, times increasing from 0 on.
        size: extents of a box along its own x and y, in metres; None for a cylinder.
        radius: of a cylinder, in metres; None for a box.
        yaw: rotation of a box about z, in radians.
        height: of its top above ``base``, in metres.
        base: height of its underside above the floor, in metres.
        loop: whether the timetable starts again after its last time.
    """

    path: tuple[tuple[NonNegative, Number, Number], ...]
    size: tuple[Positive, Positive] | None = None
    radius: Positive | None = None
    yaw: Number = 0.0
    height: Positive = 2.0
    base: Number = 0.0
    loop: Flag = False

    def __post_init__(self) -> None:
        if (self.size is None) == (self.radius is None):
            raise ConfigError(
                "moving obstacle: give either 'size' (a box) or 'radius' (a cylinder), and not both."
            )
        times = [time for time, _, _ in self.path]
        if not times or any(later <= earlier for earlier, later in pairwise(times)):
            raise ConfigError(
                f"moving obstacle: 'path' must list [time, x, y] with increasing times, got times {times}."
            )

    def at(self, time: float) -> tuple[float, float]:
        """Return (x, y) of its centre at a time in seconds."""
        times, x, y = np.array(self.path, np.float64).T
        if self.loop and times[-1] > 0:
            time %= times[-1]
        return float(np.interp(time, times, x)), float(np.interp(time, times, y))

    def outline(self, time: float) -> npt.NDArray[np.float64]:
        """Return its outline (24, 2) at a time in seconds, counter-clockwise; a box repeats its corners."""
        if self.size is not None:
            corners = Box(center=self.at(time), size=self.size, yaw=self.yaw).corners()
            return np.repeat(corners, 6, axis=0)
        angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
        return np.array(self.at(time)) + (self.radius or 0.0) * np.stack([np.cos(angles), np.sin(angles)], -1)


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
        poses: fixed starts (x, y, heading in radians), one per robot in team order; they replace all of the
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
        people: who walks around in it.
        moving: obstacles on a timetable.
        spawn: where robots start.
        file: the world file it was read from, for messages; None if it was made in code.
    """

    name: str
    bounds: Area = (-10.0, -10.0, 10.0, 10.0)
    walled: bool = True
    boxes: tuple[Box, ...] = ()
    cylinders: tuple[Cylinder, ...] = ()
    meshes: tuple[Mesh, ...] = ()
    people: tuple[Person, ...] = ()
    moving: tuple[MovingObstacle, ...] = ()
    spawn: SpawnRule = field(default_factory=SpawnRule)
    file: Path | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        x_min, y_min, x_max, y_max = self.bounds
        if x_max - x_min < 1.0 or y_max - y_min < 1.0:
            raise ConfigError(
                f"world '{self.name}': bounds must be [x_min, y_min, x_max, y_max], at least 1 m in x and y, "
                f"got {list(self.bounds)}."
            )

    @property
    def label(self) -> str:
        """The file, or else the name: how messages call this world."""
        return str(self.file) if self.file else f"world '{self.name}'"

    def at_rest(self) -> World:
        """Return the world without what moves: the same for all episodes, whichever people walk in them."""
        return replace(self, people=(), moving=()) if self.people or self.moving else self

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
