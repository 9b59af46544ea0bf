"""Reads a planar robot off a URDF: wheels, footprint, lidar, mass; each number with where it came from.

The robot's frame has its origin on the floor, half-way between the driven wheels, x forward: that is the
point that drives along arcs. What the file does not say is left out here and asked for by
:mod:`hpp_framework.onboarding.urdf.robot`.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field

import numpy as np

from hpp_framework.onboarding.urdf.model import Joint, Matrix, Model, Shape
from hpp_framework.utils.errors import ConfigError

LIDAR_NAMES = re.compile(r"lidar|laser|scan|hokuyo|sick|rplidar|ydlidar|urg|tim5|tim7")
LEVEL = 0.02
"""Radians that a wheel's axle or a lidar may be out of level."""
SAME = 0.005
"""Metres within which two wheels have the same radius, height and place along the robot."""
BESIDE = 0.95
"""Share of the lidar's distance from the centre that the disc which others see may have."""


@dataclass
class Reading:
    """Numbers that were found, and where; names are those of the answers that would give them.

    Attributes:
        values: SI units and radians.
        sources: where each came from.
        missing: what must be answered, and why.
    """

    values: dict[str, float] = field(default_factory=dict[str, float])
    sources: dict[str, str] = field(default_factory=dict[str, str])
    missing: dict[str, str] = field(default_factory=dict[str, str])

    def found(self, name: str, value: float, source: str) -> None:
        """Note a number."""
        self.values[name], self.sources[name] = round(float(value), 4), source

    def lacks(self, name: str, why: str) -> None:
        """Note that a number must be asked for."""
        self.missing[name] = why


@dataclass(frozen=True)
class Wheels:
    """The driven pair.

    Attributes:
        left, right: their joints.
        radius: metres.
        track: metres between them.
        frame: pose of the robot's frame in the root's, 4 x 4.
    """

    left: Joint
    right: Joint
    radius: float
    track: float
    frame: Matrix


def find_wheels(model: Model, named: tuple[str, str] | None) -> Wheels:
    """Find the two driven wheels: continuous joints about one axle, one on either side.

    Args:
        model: the robot.
        named: their joints, left and right, where the file has several such pairs.

    Raises:
        ConfigError: if there is no such pair, several, or the named ones are none.
    """
    wheels = {joint.name: joint for joint in model.joints if _is_wheel(model, joint)}
    if named:
        lost = [name for name in named if name not in wheels]
        if lost:
            raise ConfigError(
                f"'{model.file}': joint '{lost[0]}' is no wheel: continuous, with an axle along y and "
                f"a collision shape. Such joints: {', '.join(wheels) or 'none'}."
            )
        return _pair(model, wheels[named[0]], wheels[named[1]])
    pairs = [
        (a, b) for a in wheels.values() for b in wheels.values() if a.name < b.name and _fit(model, a, b)
    ]
    if len(pairs) != 1:
        found = "; ".join(f"{a.name}, {b.name}" for a, b in pairs) or ", ".join(wheels) or "no wheel at all"
        raise ConfigError(
            f"'{model.file}': which two wheels drive it? Found: {found}. Name their joints, left and right: "
            "'wheels: [LEFT, RIGHT]' in the answers. Other drives than two wheels on one axle are not read; "
            "write such a robot by hand (hpp new robot)."
        )
    return _pair(model, *pairs[0])


def _is_wheel(model: Model, joint: Joint) -> bool:
    # x forward and y to the left, as URDFs have it (REP 103)
    axle = model.places[joint.child][:3, :3] @ joint.axis
    across = abs(axle[1]) >= math.cos(LEVEL) * np.linalg.norm(axle)
    return joint.kind == "continuous" and bool(across) and bool(model.shapes[joint.child])


def _radius(model: Model, joint: Joint) -> float:
    """Return how far a wheel reaches down from its axle."""
    low, _ = _heights(model.shapes[joint.child])
    return float(model.places[joint.child][2, 3] - low)


def _fit(model: Model, one: Joint, other: Joint) -> bool:
    """Return whether two wheels are alike and on one axle."""
    x, y, z = np.abs((model.places[one.child] - model.places[other.child])[:3, 3])
    return bool(max(x, z) < SAME < y and abs(_radius(model, one) - _radius(model, other)) < SAME)


def _pair(model: Model, one: Joint, other: Joint) -> Wheels:
    a, b = (model.places[joint.child][:3, 3] for joint in (one, other))
    left, right = (one, other) if a[1] >= b[1] else (other, one)
    frame = np.eye(4)
    frame[:3, 3] = (a + b) / 2
    radius = _radius(model, one)
    frame[2, 3] -= radius
    return Wheels(left, right, radius, float(np.linalg.norm((a - b)[:2])), frame)


def read_drive(model: Model, wheels: Wheels, reading: Reading) -> None:
    """Read speeds off the wheels' limits; accelerations no URDF has."""
    turning = [joint.velocity for joint in (wheels.left, wheels.right) if joint.velocity]
    if len(turning) == 2:
        speed = min(turning) * wheels.radius
        where = f"limits of {wheels.left.name} and {wheels.right.name}, {min(turning):g} rad/s"
        reading.found("speed", speed, f"{where}, times their radius of {wheels.radius:.4g} m")
        turn = f"twice the speed over the {wheels.track:.4g} m between the wheels"
        reading.found("turn_rate", 2 * speed / wheels.track, turn)
    else:
        why = "the wheels' joints have no velocity limits"
        reading.lacks("speed", f"highest forward speed in m/s: {why}")
        reading.lacks("turn_rate", f"highest turn rate in rad/s: {why}")
    reading.lacks("reverse_speed", "highest backward speed in m/s, 0 if it must not: no URDF says")
    reading.lacks("acceleration", "highest acceleration in m/s^2: no URDF says")
    reading.lacks("turn_acceleration", "highest angular acceleration in rad/s^2: no URDF says")


def read_body(model: Model, wheels: Wheels, reading: Reading) -> None:
    """Read footprint, height and mass."""
    shapes = {name: shapes for name, shapes in model.shapes.items() if shapes}
    if not shapes:
        raise ConfigError(f"'{model.file}' has no collision shapes, so nothing says how large the robot is.")
    reach = {name: max(_reach(shape, wheels.frame) for shape in each) for name, each in shapes.items()}
    widest = max(reach, key=reach.__getitem__)
    reading.found("footprint_radius", reach[widest], f"collision shape of link {widest}, the farthest out")
    tops = {name: _heights(each)[1] - wheels.frame[2, 3] for name, each in shapes.items()}
    highest = max(tops, key=tops.__getitem__)
    reading.found("height", tops[highest], f"collision shape of link {highest}, the highest")
    if model.masses:
        source = f"<inertial> of {len(model.masses)} of {len(model.places)} links, added up"
        reading.found("mass", sum(model.masses.values()), source)
    else:
        reading.lacks("mass", "in kg: no link has an <inertial>")


def read_lidar(model: Model, wheels: Wheels, named: str | None, reading: Reading) -> str:
    """Read where the lidar sits and, from a sensor for Gazebo, what it measures; returns its link.

    Raises:
        ConfigError: if it is not clear which link it is, or it looks up or down.
    """
    link = named or _lidar_link(model)
    if link not in model.places:
        raise ConfigError(
            f"'{model.file}' has no link '{link}' for a lidar. Links: {', '.join(model.places)}."
        )
    place = np.linalg.inv(wheels.frame) @ model.places[link]
    if abs(place[2, 2]) < math.cos(LEVEL):
        raise ConfigError(
            f"'{model.file}': the lidar of link '{link}' does not look around in a level plane."
        )
    hangs = ", which hangs upside down" if place[2, 2] < 0 else ""
    for name, value in (("lidar_x", place[0, 3]), ("lidar_y", place[1, 3]), ("lidar_height", place[2, 3])):
        reading.found(name, value, f"link {link}{hangs}")
    reading.found("lidar_yaw", math.atan2(place[1, 0], place[0, 0]), f"link {link}{hangs}")
    _read_sensor(model, link, reading)
    return link


def _lidar_link(model: Model) -> str:
    found = [name for name in model.places if LIDAR_NAMES.search(name.lower())]
    if len(found) != 1:
        those = f"several links sound like one: {', '.join(found)}" if found else "no link sounds like one"
        raise ConfigError(
            f"'{model.file}': which link is the lidar? {those}. Name it: 'lidar_link: LINK' in the "
            f"answers. Links: {', '.join(model.places)}."
        )
    return found[0]


def _read_sensor(model: Model, link: str, reading: Reading) -> None:
    """Read beams, field of view, ranges and noise where an extension for Gazebo gives them."""
    sensor = model.sensors.get(link)
    where = f"<gazebo reference='{link}'>"
    low, high = (_number(sensor, f".//horizontal/{end}_angle") for end in ("min", "max"))
    for name, value, ask in (
        ("beams", _number(sensor, ".//horizontal/samples"), "beams per scan"),
        ("field_of_view", None if low is None or high is None else high - low, "field of view in radians"),
        ("min_range", _number(sensor, ".//range/min"), "shortest range in m"),
        ("max_range", _number(sensor, ".//range/max"), "longest range in m"),
        ("noise_std", _number(sensor, ".//noise/stddev"), "standard deviation of ranges in m"),
    ):
        if value is None:
            reading.lacks(name, f"the lidar's {ask}: the file has none")
        else:
            reading.found(name, value, where)
    if low is not None and high is not None and abs(low + high) > LEVEL:
        # a lidar's field of view is symmetric about its mount
        reading.found("lidar_yaw", reading.values["lidar_yaw"] + (low + high) / 2, where)


def _number(sensor: ET.Element | None, path: str) -> float | None:
    found = None if sensor is None else sensor.findtext(path)
    try:
        return None if found is None else float(found)
    except ValueError:
        return None


def read_profile(model: Model, wheels: Wheels, lidar_link: str, reading: Reading) -> None:
    """Read what other robots' lidars see of it, at the height of its own: the widest shape there.

    The lidar itself does not count, and must see past the disc that stands for the body.
    """
    height = reading.values["lidar_height"] + float(wheels.frame[2, 3])
    there = {
        name: max(_reach(shape, wheels.frame) for shape in crossing)
        for name, shapes in model.shapes.items()
        if name != lidar_link and (crossing := [shape for shape in shapes if _crosses(shape, height)])
    }
    if not there:
        reading.lacks(
            "profile_radius",
            "radius in m of what other robots' lidars see of it: no collision shape lies at its own lidar's "
            f"height of {reading.values['lidar_height']:g} m",
        )
        return
    widest = max(there, key=there.__getitem__)
    radius, source = there[widest], f"collision shape of link {widest} at the lidar's height"
    out = math.hypot(reading.values["lidar_x"], reading.values["lidar_y"])
    if radius >= out:
        radius, source = BESIDE * out, f"{source}, made smaller than the lidar's distance from the centre"
    if radius > 0:
        reading.found("profile_radius", radius, source)
    else:
        reading.lacks(
            "profile_radius", "radius in m of what other robots' lidars see of it: the lidar is in its centre"
        )


def _reach(shape: Shape, frame: Matrix) -> float:
    """Return the farthest point of a shape from the robot's centre, seen from above."""
    return float(np.linalg.norm(shape.points[:, :2] - frame[:2, 3], axis=1).max()) + shape.rounding


def _heights(shapes: tuple[Shape, ...]) -> tuple[float, float]:
    """Return the lowest and the highest point in the root's frame."""
    low = min(shape.points[:, 2].min() - shape.rounding for shape in shapes)
    high = max(shape.points[:, 2].max() + shape.rounding for shape in shapes)
    return float(low), float(high)


def _crosses(shape: Shape, height: float) -> bool:
    low, high = _heights((shape,))
    return bool(low <= height <= high)
