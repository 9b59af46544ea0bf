"""Robots as frozen data: drive limits, footprint, lidar, body.

``RobotSpec`` is all that skills, predictors and both simulators ever learn about a robot.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.validation import NonNegative, NonPositive, Number, Positive, Several, validated

HOUSING = 0.15
"""Largest radius in metres of a mast or turret that carries a lidar and does not stand in its view."""


@validated
class DriveLimits:
    """Unicycle limits: speeds and accelerations, SI units.

    Attributes:
        speed: (lowest, highest) forward speed in m/s; the lowest is 0 or less.
        turn_rate: highest absolute turn rate in rad/s.
        acceleration: highest absolute forward acceleration in m/s^2.
        turn_acceleration: highest absolute angular acceleration in rad/s^2.
    """

    speed: Annotated[
        tuple[NonPositive, Positive], Field(description="It is (low, high) with low <= 0 < high.")
    ]
    turn_rate: Positive
    acceleration: Positive
    turn_acceleration: Positive


@validated
class Lidar:
    """A planar lidar.

    Attributes:
        beams: number of beams, both ends of the field of view included.
        field_of_view: in radians, symmetric about the mount's heading.
        mount: (x, y, theta) in the robot's frame, metres and radians.
        height: of the scan plane above the floor, in metres.
        min_range: in metres; nearer hits read as this.
        max_range: in metres; misses read as this.
        noise_std: standard deviation of the range error in metres, used when noise is asked for.
    """

    beams: Several
    field_of_view: Annotated[Positive, Field(le=2 * math.pi, description="It is in (0, 2*pi] radians.")]
    mount: tuple[float, float, float]
    height: Positive
    min_range: NonNegative
    max_range: Number
    noise_std: float

    def __post_init__(self) -> None:
        if not 0 <= self.min_range < self.max_range:
            raise ConfigError(f"need 0 <= min_range < max_range, got {self.min_range}, {self.max_range}.")

    def angles(self) -> npt.NDArray[np.float64]:
        """Return beam angles (beams,) in the mount's frame, most clockwise first."""
        return np.linspace(-self.field_of_view / 2, self.field_of_view / 2, self.beams)


@dataclass(frozen=True, kw_only=True)
class Part:
    """One visible primitive of a body, in the robot's frame (x forward, z up from the floor).

    Attributes:
        shape: ``"box"`` (full extents x, y, z), ``"cylinder"`` (radius, length along z; the third is ignored)
            or ``"sphere"`` (radius).
        size: in metres, as ``shape`` says.
        position: centre, in metres.
        rotation: roll, pitch, yaw in radians (applied x, then y, then z).
        color: red, green, blue in 0..1.
        solid: whether it belongs to the hull. Contact and lidars know the hull as ``RobotSpec``'s discs, so a
            solid part lies within the footprint.
    """

    shape: Literal["box", "cylinder", "sphere"]
    size: tuple[float, float, float]
    position: tuple[float, float, float]
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    color: tuple[float, float, float] = (0.8, 0.8, 0.8)
    solid: bool = False


def _no_parts() -> tuple[Part, ...]:
    return ()


@validated
class RobotSpec:
    """A mobile robot.

    Attributes:
        name: registered name.
        drive: drive limits.
        lidar: the one lidar.
        footprint_radius: of the disc that touches obstacles, in metres.
        profile_radius: of the disc that other robots' lidars see, in metres.
        height: above the floor, in metres; obstacles that begin higher are driven under.
        mass: in kilograms; decides who yields when two robots push each other.
        body: function that returns the visible parts.
        sources: provenance of the numbers, one line each.
    """

    name: str
    drive: DriveLimits
    lidar: Lidar
    footprint_radius: Positive
    profile_radius: Positive
    height: Positive
    mass: Positive
    body: Callable[[], tuple[Part, ...]] = _no_parts
    sources: tuple[str, ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        reach = math.hypot(*self.lidar.mount[:2])
        inside = reach <= self.profile_radius and self.lidar.field_of_view > math.pi
        if inside and self.profile_radius > HOUSING:
            raise ConfigError(
                f"robot '{self.name}': the lidar sits {reach:.3f} m from the centre, inside the disc of "
                f"{self.profile_radius} m that lidars see; it would see itself. Make profile_radius smaller; "
                f"up to {HOUSING} m it is taken for the lidar's own housing, which it looks past."
            )

    def build_body(self) -> tuple[Part, ...]:
        """Return the visible parts of the body."""
        return self.body()
