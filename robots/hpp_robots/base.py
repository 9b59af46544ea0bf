"""What Fetch and Freight share: one mobile base, one SICK TIM571, the paper's drive limits.

All numbers are facts from Fetch Robotics' published robot description (fetch_ros, melodic, URDF 0.8.3), the
SICK TIM571 data sheet, and appendix C.1 of the paper (Wang et al., CoRL 2020).
"""

from __future__ import annotations

import math

from hpp_framework.robot import DriveLimits, Lidar, Part

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

LIDAR = Lidar(
    beams=222,  # appendix C.1
    field_of_view=math.radians(220.0),  # appendix C.1; TIM571 in the base slot
    mount=(0.235, 0.0, 0.0),  # laser_joint (URDF); the real one hangs upside down, mirrored by its driver
    height=0.2878 + FLOOR_GAP,  # laser_joint (URDF)
    min_range=0.05,  # TIM571
    max_range=25.0,  # TIM571
    noise_std=0.02,  # fetch_gazebo's model of it
)

_SHELL = (0.20, 0.22, 0.26)
_SILVER = (0.72, 0.74, 0.78)
SLOT = (0.262, 0.322)
"""Lowest and highest point of the laser slot above the floor, in metres."""


def base_parts(trim: tuple[float, float, float]) -> tuple[Part, ...]:
    """Return the parts of the mobile base: shell, laser slot, lid, laser, wheels.

    Args:
        trim: colour of the ring that tells one robot from the other.
    """
    low, high = SLOT
    return (
        Part(shape="cylinder", size=(FOOTPRINT_RADIUS, low - 0.03, 0), position=(0, 0, (low + 0.03) / 2),
             color=_SHELL, solid=True),
        Part(shape="cylinder", size=(PROFILE_RADIUS, high - low, 0), position=(0, 0, (low + high) / 2),
             color=(0.08, 0.08, 0.09), solid=True),
        Part(shape="cylinder", size=(FOOTPRINT_RADIUS, BASE_HEIGHT - high, 0),
             position=(0, 0, (high + BASE_HEIGHT) / 2), color=trim, solid=True),
        Part(shape="cylinder", size=(0.033, 0.05, 0), position=(0.235, 0, LIDAR.height),
             color=(0.05, 0.05, 0.05)),
        Part(shape="cylinder", size=(0.0605, 0.04, 0), position=(0, 0.187, 0.0605),
             rotation=(math.pi / 2, 0, 0), color=(0.03, 0.03, 0.03)),
        Part(shape="cylinder", size=(0.0605, 0.04, 0), position=(0, -0.187, 0.0605),
             rotation=(math.pi / 2, 0, 0), color=(0.03, 0.03, 0.03)),
        Part(shape="box", size=(0.02, 0.20, 0.05), position=(0.281, 0, 0.16), color=_SILVER),
    )  # fmt: skip
