"""``check_robot``: whether a robot's numbers can be true, and are in the framework's units."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np

from hpp_framework.core.robot import Part, RobotSpec
from hpp_framework.testing.build import build, find_source
from hpp_framework.testing.report import Report, Rule

NAME = Rule(
    name="robot-name",
    why="weights, cards and results are filed under RobotSpec.name, and found again by the registered name.",
    fix='RobotSpec(name=...) with the very name given to hub.robots.add(...): letters, digits, "-" and "_".',
)
UNITS = Rule(
    name="units",
    why="skills and simulators take metres, seconds, kilograms and radians; other units give a robot that "
    "cannot be driven.",
    fix="SI units: math.radians(...) for angles and turn rates, metres (not mm), m/s (not km/h).",
)
NOT_A_NUMBER = Rule(
    name="robot-number",
    why="NaN, infinity and negative sizes end up in poses and scans of every episode.",
    fix="a finite number, 0 or more where it is a size or a deviation.",
)
LIDAR_OUTSIDE = Rule(
    name="lidar-outside",
    why="contact knows the footprint disc alone: a lidar outside of it reaches into walls and measures "
    "from within.",
    fix="lidar.mount within footprint_radius of the centre, or a footprint_radius that covers the lidar.",
)
LIDAR_ABOVE = Rule(
    name="lidar-above",
    why="the lidar is part of the body: what passes over the body would pass through the lidar.",
    fix="height (top of the robot) of at least lidar.height.",
)
BLIND = Rule(
    name="lidar-blind",
    why="what is nearer than min_range reads as min_range: the robot does not see what it is about to touch.",
    fix="a min_range below footprint_radius; it is the sensor's own dead zone, usually centimetres.",
)
BRAKING = Rule(
    name="braking",
    why="it cannot stop for what its lidar sees; every skill then collides at speed.",
    fix="a drive.speed from which speed^2 / (2 * acceleration) is well within lidar.max_range.",
)
PROFILE = Rule(
    name="profile",
    why="other robots would see it larger than it is, and keep away from nothing.",
    fix="profile_radius (what other lidars see, at their height) no larger than footprint_radius (what "
    "touches).",
)
BODY = Rule(
    name="body",
    why="pictures, and contact in SAPIEN, show the body; contact in the batch simulator knows the discs.",
    fix="parts as a tuple of Part, finite, colours 0..1; solid parts within footprint_radius and height.",
)
VARIES = Rule(
    name="robot-varies",
    why="a robot is data: weights and predictors are made for its numbers.",
    fix="a factory that returns the same numbers each time; put variants under names of their own.",
)
RULES = (
    NAME, UNITS, NOT_A_NUMBER, LIDAR_OUTSIDE, LIDAR_ABOVE, BLIND, BRAKING, PROFILE, BODY, VARIES,
)  # fmt: skip

SIGNATURE = "() -> RobotSpec"
MOST = {
    "drive.speed": 15.0, "drive.turn_rate": 15.0, "drive.acceleration": 30.0, "drive.turn_acceleration": 60.0,
    "footprint_radius": 3.0, "profile_radius": 3.0, "height": 5.0, "mass": 5000.0,
    "lidar.max_range": 400.0, "lidar.height": 5.0, "lidar.mount angle": 2 * math.pi, "lidar.noise_std": 1.0,
}  # fmt: skip
"""Beyond these a number is in other units, in all likelihood: degrees, millimetres, km/h, grams."""
LEAST = {
    "footprint_radius": 0.02,
    "profile_radius": 0.01,
    "height": 0.02,
    "mass": 0.05,
    "lidar.max_range": 0.2,
}
REACH = 0.02
"""Metres that a solid part may reach beyond footprint and height."""


def check_robot(robot: str | RobotSpec | Callable[[], RobotSpec]) -> None:
    """Check a robot's numbers: possible, in SI units and radians, and true to one another.

    Args:
        robot: registered name, factory or spec.

    Raises:
        CheckError: if anything is wrong; holds everything that was found.
        UnknownNameError: if nothing has that name.
    """
    source, report = find_source("robot", robot, RobotSpec)
    spec = build(source, report, (), RobotSpec, SIGNATURE, fresh=False)
    if isinstance(spec, RobotSpec):
        _check_name(report, spec, source.name or spec.name)
        if source.factory is not None:
            with report.guarded("the factory", "at its second call"):
                again = source.factory()
                report.require(
                    again == spec, VARIES, "the factory", "returns other numbers at its second call."
                )
        if _check_numbers(report, spec):
            _check_lidar(report, spec)
            _check_body(report, spec)
    report.finish()


def _check_name(report: Report, spec: RobotSpec, name: str) -> None:
    report.require(spec.name == name, NAME, "name", f"is '{spec.name}', but it is registered as '{name}'.")
    odd = sorted({mark for mark in spec.name if not (mark.isalnum() or mark in "-_.")})
    if odd or not spec.name:
        report.add(
            NAME, "name", f"'{spec.name}' holds {odd}: file names and team lists have no room for those."
        )


def _numbers(spec: RobotSpec) -> dict[str, float]:
    drive, lidar = spec.drive, spec.lidar
    return {
        "drive.speed": max(map(abs, drive.speed)), "drive.turn_rate": drive.turn_rate,
        "drive.acceleration": drive.acceleration, "drive.turn_acceleration": drive.turn_acceleration,
        "footprint_radius": spec.footprint_radius, "profile_radius": spec.profile_radius,
        "height": spec.height, "mass": spec.mass, "lidar.max_range": lidar.max_range,
        "lidar.height": lidar.height, "lidar.mount angle": abs(lidar.mount[2]),
        "lidar.mount distance": math.hypot(*lidar.mount[:2]), "lidar.noise_std": lidar.noise_std,
    }  # fmt: skip


def _check_numbers(report: Report, spec: RobotSpec) -> bool:
    fine = True
    for name, value in _numbers(spec).items():
        if not math.isfinite(value) or value < 0:
            fine = report.require(False, NOT_A_NUMBER, name, f"is {value}.")  # reads as assert
        elif value > MOST.get(name, math.inf):
            report.add(UNITS, name, f"is {value:g}, more than any robot's ({MOST[name]:g}).")
        elif value < LEAST.get(name, 0):
            report.add(UNITS, name, f"is {value:g}, less than any robot's ({LEAST[name]:g}).")
    return fine


def _check_lidar(report: Report, spec: RobotSpec) -> None:
    lidar, drive = spec.lidar, spec.drive
    out = math.hypot(*lidar.mount[:2])
    report.require(
        out <= spec.footprint_radius, LIDAR_OUTSIDE, "lidar.mount",
        f"lies {out:.2f} m from the centre, outside the footprint of {spec.footprint_radius:.2f} m.",
    )  # fmt: skip
    report.require(
        lidar.height <= spec.height, LIDAR_ABOVE, "lidar.height",
        f"is {lidar.height:.2f} m, above the robot's height of {spec.height:.2f} m.",
    )  # fmt: skip
    report.require(
        lidar.min_range <= max(spec.footprint_radius, 0.1), BLIND, "lidar.min_range",
        f"is {lidar.min_range:.2f} m, more than the footprint's {spec.footprint_radius:.2f} m.",
    )  # fmt: skip
    stop = drive.speed[1] ** 2 / (2 * drive.acceleration)
    report.require(
        stop <= lidar.max_range, BRAKING, "drive",
        f"takes {stop:.1f} m to stop from {drive.speed[1]:g} m/s at {drive.acceleration:g} m/s^2; the "
        "lidar sees "
        f"{lidar.max_range:g} m.",
    )  # fmt: skip
    report.require(
        spec.profile_radius <= spec.footprint_radius, PROFILE, "profile_radius",
        f"is {spec.profile_radius:.2f} m, larger than footprint_radius of {spec.footprint_radius:.2f} m.",
    )  # fmt: skip


def _check_body(report: Report, spec: RobotSpec) -> None:
    with report.guarded("body()", rule=BODY):
        # plugins are not always typed
        parts: Any = spec.body()
        if not isinstance(parts, tuple) or not all(isinstance(part, Part) for part in parts):
            report.add(BODY, "body()", f"returned {type(parts).__name__} that is no tuple of Part.")
            return
        for index, part in enumerate(parts):
            numbers = (*part.size, *part.position, *part.rotation, *part.color)
            if not all(map(math.isfinite, numbers)) or not all(0 <= share <= 1 for share in part.color):
                report.add(
                    BODY, "body()", f"part {index} has NaN, infinity or a colour outside 0..1: {part}."
                )
            elif part.solid:
                across, top = _extent(part)
                if across > spec.footprint_radius + REACH or top > spec.height + REACH:
                    report.add(
                        BODY, "body()",
                        f"solid part {index} reaches {across:.2f} m from the centre and {top:.2f} m "
                        "up; footprint "
                        f"and height are {spec.footprint_radius:.2f} m and {spec.height:.2f} m.",
                    )  # fmt: skip


def _extent(part: Part) -> tuple[float, float]:
    """Return how far a part reaches from the robot's centre, and how high."""
    if part.shape == "sphere":
        return math.hypot(*part.position[:2]) + part.size[0], part.position[2] + part.size[0]
    if part.shape == "cylinder":
        angles = np.linspace(0, 2 * math.pi, 24, endpoint=False)
        rim = np.stack([np.cos(angles), np.sin(angles)], -1) * part.size[0]
        points = np.concatenate([np.c_[rim, np.full(24, side * part.size[1] / 2)] for side in (-1, 1)])
    else:
        points = np.array(list(product((-0.5, 0.5), repeat=3))) * np.array(part.size)
    points = points @ _rotation(part.rotation).T + np.array(part.position)
    return float(np.hypot(points[:, 0], points[:, 1]).max()), float(points[:, 2].max())


def _rotation(angles: tuple[float, float, float]) -> np.ndarray:
    """Return the matrix of a roll, then a pitch, then a yaw."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(angles), np.sin(angles)
    roll = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    pitch = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    yaw = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return yaw @ pitch @ roll
