"""What Fetch and Freight share: one mobile base, one SICK TIM571, two sets of drive limits.

All numbers are facts from Fetch Robotics' published robot description (fetch_ros, melodic, URDF 0.8.3) and
configuration (fetch_robots), the SICK TIM571 data sheet, and appendix C.1 of the paper (Wang et al., CoRL
2020).
"""

from __future__ import annotations

import math

from hpp_framework.core.robot import DriveLimits, Lidar, Part

FLOOR_GAP = 0.005
"""base_link origin above the floor: wheel radius 0.0605 minus wheel centre 0.0553 (URDF)."""

FOOTPRINT_RADIUS = 0.2877
"""Largest radius of the base shell (collision STL)."""

PROFILE_RADIUS = 0.21
"""Disc that stands for the shell behind the laser slot: the STL section at 0.2878 m spans x -0.282..0.050 and
y -0.264..0.264; the largest centred disc that leaves the laser its 220 degrees has radius 0.2208."""

BASE_HEIGHT = 0.3589 + FLOOR_GAP
"""Top of the base shell above the floor (STL)."""

PAPER_DRIVE = DriveLimits(speed=(0.0, 1.0), turn_rate=3.0, acceleration=0.4, turn_acceleration=1.48)
"""Appendix C.1: v in [0, 1] m/s, omega in [-3, 3] rad/s, 0.4 m/s^2, 1.48 rad/s^2."""

FETCH_DRIVE = DriveLimits(speed=(0.0, 1.0), turn_rate=4.5, acceleration=0.75, turn_acceleration=3.0)
"""Fetch's own limits: 1.0 m/s and 0.75 m/s^2 (fetch_robots, Fetch's bringup), 4.5 rad/s and 3.0 rad/s^2
(defaults of robot_controllers' base controller). Forward only, as in the paper: it does not see behind it."""

FREIGHT_DRIVE = DriveLimits(speed=(0.0, 1.5), turn_rate=4.5, acceleration=2.0, turn_acceleration=3.0)
"""Freight's own limits: 1.5 m/s and 2.0 m/s^2 (fetch_robots, Freight's bringup), turning as Fetch."""

LIDAR = Lidar(
    beams=222,  # appendix C.1
    field_of_view=math.radians(220.0),  # appendix C.1; TIM571 in the base slot
    mount=(0.235, 0.0, 0.0),  # laser_joint (URDF); the real one hangs upside down, mirrored by its driver
    height=0.2878 + FLOOR_GAP,  # laser_joint (URDF)
    min_range=0.05,  # TIM571
    max_range=25.0,  # TIM571
    noise_std=0.02,  # fetch_gazebo's model of it
)

LIGHT_SHELL = (0.62, 0.63, 0.66)
_SHELL = (0.10, 0.11, 0.13)
_DARK = (0.02, 0.02, 0.025)
_SILVER = (0.62, 0.64, 0.68)
SLOT = (0.262, 0.322)
"""Lowest and highest point of the laser slot above the floor, in metres."""


def base_parts(trim: tuple[float, float, float], lid: tuple[float, float, float]) -> tuple[Part, ...]:
    """Return the parts of the mobile base: skirt, shell, laser slot, lid, laser, bumper, wheels.

    Args:
        trim: colour of the ring that tells one robot from the other.
        lid: colour of the top inside that ring.
    """
    low, high = SLOT
    return (
        _disc(0.278, 0.025, 0.06, _DARK),
        _disc(FOOTPRINT_RADIUS, 0.06, low - 0.016, _SHELL, solid=True),
        _disc(0.280, low - 0.016, low - 0.006, _SHELL),
        _disc(0.268, low - 0.006, low, _SHELL),
        _disc(PROFILE_RADIUS, low, high, _DARK, solid=True),
        # the slot is open to the front only: the shell goes on behind it
        _disc(0.215, low, high, _SHELL, x=-0.068),
        _disc(FOOTPRINT_RADIUS, high, high + 0.026, trim, solid=True),
        _disc(0.276, high + 0.026, high + 0.035, lid),
        _disc(0.258, high + 0.035, BASE_HEIGHT, lid),
        # the laser, with its window
        _disc(0.030, low, LIDAR.height - 0.012, _DARK, x=0.235),
        _disc(0.033, LIDAR.height - 0.012, LIDAR.height + 0.012, (0.25, 0.02, 0.02), x=0.235),
        _disc(0.030, LIDAR.height + 0.012, high, _DARK, x=0.235),
        # charging contacts and bumper
        Part(shape="box", size=(0.02, 0.17, 0.035), position=(0.279, 0, 0.165), color=_SILVER),
        Part(shape="box", size=(0.012, 0.10, 0.012), position=(0.285, 0, 0.165), color=_DARK),
        *(
            Part(shape="cylinder", size=(0.0605, 0.04, 0), position=(0, side * 0.187, 0.0605),
                 rotation=(math.pi / 2, 0, 0), color=_DARK)
            for side in (-1, 1)
        ),
    )  # fmt: skip


def _disc(
    radius: float,
    low: float,
    high: float,
    color: tuple[float, float, float],
    *,
    x: float = 0.0,
    solid: bool = False,
) -> Part:
    """Return an upright cylinder between two heights above the floor."""
    return Part(
        shape="cylinder",
        size=(radius, high - low, 0),
        position=(x, 0, (low + high) / 2),
        color=color,
        solid=solid,
    )
