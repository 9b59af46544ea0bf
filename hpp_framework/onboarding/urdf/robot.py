"""Robots from URDF files and answers to what those do not say."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
import numpy.typing as npt
import yaml
from trimesh.transformations import euler_from_matrix

from hpp_framework.core.robot import DriveLimits, Lidar, Part, RobotSpec
from hpp_framework.onboarding.urdf.model import Model, Shape, read_urdf
from hpp_framework.onboarding.urdf.reading import (
    Reading,
    Wheels,
    find_wheels,
    read_body,
    read_drive,
    read_lidar,
    read_profile,
)
from hpp_framework.utils.errors import ConfigError, reason, suggest

WHEELS, LIDAR_LINK = "wheels", "lidar_link"
ANSWERS = (
    "speed", "reverse_speed", "turn_rate", "acceleration", "turn_acceleration", "footprint_radius",
    "profile_radius", "height", "mass", "beams", "field_of_view", "min_range", "max_range", "noise_std",
    "lidar_x", "lidar_y", "lidar_yaw", "lidar_height",
)  # fmt: skip
"""Numbers that may be answered; an answer goes before what the file says."""
ROUNDING = 0.01
"""Radians by which a whole turn in a file may be too large."""
COLORS = {"wheel": (0.05, 0.05, 0.05), "lidar": (0.10, 0.10, 0.12), "other": (0.45, 0.47, 0.50)}


@dataclass(frozen=True)
class Body:
    """What a robot looks like; compares and travels to workers as data does."""

    parts: tuple[Part, ...]

    def __call__(self) -> tuple[Part, ...]:
        """Return the parts."""
        return self.parts


def robot_from_urdf(file: Path, name: str, answers: Mapping[str, Any] | None = None) -> RobotSpec:
    """Read a robot with two driven wheels and a lidar off a URDF.

    Footprint, height and drive kind come from collision shapes and joints at rest, speeds from the wheels'
    limits, the lidar's pose from its link, its beams from an extension for Gazebo, mass from inertias; see
    ``RobotSpec.sources``.

    Args:
        file: the URDF.
        name: registered name of the robot.
        answers: numbers that the file does not say or that must override it, by the names of
            :data:`ANSWERS`; ``wheels``: names of the left and the right wheel's joint; ``lidar_link``.

    Raises:
        ConfigError: if the file is wrong, an answer is unknown or no number, or something is neither said nor
            answered: names all of it.
    """
    return read_robot(file, name, answers)[0]


def read_robot(file: Path, name: str, answers: Mapping[str, Any] | None = None) -> tuple[RobotSpec, Reading]:
    """Read a robot and what is known of its numbers; see :func:`robot_from_urdf`."""
    given = dict(answers or {})
    model = read_urdf(file)
    wheels = find_wheels(model, _wheel_names(given.pop(WHEELS, None)))
    link = given.pop(LIDAR_LINK, None)
    reading = Reading()
    read_drive(model, wheels, reading)
    read_body(model, wheels, reading)
    link = read_lidar(model, wheels, None if link is None else str(link), reading)
    read_profile(model, wheels, link, reading)
    _answer(reading, given)
    if reading.missing:
        raise ConfigError(_questions(file, reading))
    return _robot(name, file, reading, parts_of(model, wheels, link)), reading


def read_answers(file: Path) -> dict[str, Any]:
    """Read a YAML file of answers.

    Raises:
        ConfigError: if it cannot be read, or holds anything but ``name: value``.
    """
    try:
        found = yaml.safe_load(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"cannot read the answers in '{file}': {reason(error)}.") from error
    except (UnicodeDecodeError, yaml.YAMLError) as error:
        raise ConfigError(f"cannot read the answers in '{file}': {error}.") from error
    if not isinstance(found, dict):
        raise ConfigError(f"'{file}' must hold lines of 'name: value', e.g. 'acceleration: 0.5'.")
    return {str(key): value for key, value in found.items()}


def _wheel_names(given: Any) -> tuple[str, str] | None:
    if given is None:
        return None
    if not isinstance(given, list) or len(given) != 2:
        raise ConfigError(f"answers: wheels must be the joints [LEFT, RIGHT], got {given!r}.")
    return str(given[0]), str(given[1])


def _answer(reading: Reading, given: Mapping[str, Any]) -> None:
    for name, value in given.items():
        if name not in ANSWERS:
            raise ConfigError(
                f"answers: '{name}' is unknown.{suggest(name, ANSWERS)} Known: "
                f"{', '.join((*ANSWERS, WHEELS, LIDAR_LINK))}."
            )
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise ConfigError(f"answers: {name} must be a number, got {value!r}.")
        reading.missing.pop(name, None)
        reading.found(name, value, "answered")


def _questions(file: Path, reading: Reading) -> str:
    lines = [f"  {name}:  # {why}" for name, why in reading.missing.items()]
    return (
        f"'{file}' does not say all that a robot needs, and nothing is guessed. Put these lines into a YAML "
        "file, fill them in, and give it as --answers FILE:\n" + "\n".join(lines)
    )


def _robot(name: str, file: Path, reading: Reading, parts: tuple[Part, ...]) -> RobotSpec:
    value = reading.values
    return RobotSpec(
        name=name,
        drive=DriveLimits(
            speed=(-abs(value["reverse_speed"]) + 0.0, value["speed"]),
            turn_rate=value["turn_rate"],
            acceleration=value["acceleration"],
            turn_acceleration=value["turn_acceleration"],
        ),
        lidar=Lidar(
            beams=round(value["beams"]),
            field_of_view=_rounded_down(value["field_of_view"]),
            mount=(value["lidar_x"], value["lidar_y"], value["lidar_yaw"]),
            height=value["lidar_height"],
            min_range=value["min_range"],
            max_range=value["max_range"],
            noise_std=value["noise_std"],
        ),
        footprint_radius=value["footprint_radius"],
        profile_radius=value["profile_radius"],
        height=value["height"],
        mass=value["mass"],
        body=Body(parts),
        sources=tuple(
            f"{file.name}: {key} {value[key]:g}, {where}" for key, where in reading.sources.items()
        ),
    )


def _rounded_down(field_of_view: float) -> float:
    """Return a whole turn for what is one but for rounding; everything else as it is."""
    return 2 * math.pi if 0 < field_of_view - 2 * math.pi < ROUNDING else field_of_view


def parts_of(model: Model, wheels: Wheels, lidar_link: str) -> tuple[Part, ...]:
    """Return what a robot looks like: its collision shapes; for meshes the boxes around them."""
    turning = {wheels.left.child, wheels.right.child}
    to_robot = np.linalg.inv(wheels.frame)
    found: list[Part] = []
    for link, shapes in model.shapes.items():
        color = COLORS["wheel" if link in turning else "lidar" if link == lidar_link else "other"]
        found += [_part(shape, to_robot @ shape.place, color) for shape in shapes]
    return tuple(found)


def _part(shape: Shape, place: npt.NDArray[Any], color: tuple[float, float, float]) -> Part:
    roll, pitch, yaw = map(_rounded, euler_from_matrix(place, axes="sxyz"))
    x, y, z = map(_rounded, place[:3, 3])
    size = [*map(_rounded, shape.size), 0.0, 0.0]
    kind = "box" if shape.kind == "mesh" else shape.kind
    return Part(
        shape=cast("Literal['box', 'cylinder', 'sphere']", kind), size=(size[0], size[1], size[2]),
        position=(x, y, z), rotation=(roll, pitch, yaw), color=color,
    )  # fmt: skip


def _rounded(value: Any) -> float:
    # no minus zero
    return round(float(value), 6) + 0.0
