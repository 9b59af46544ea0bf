"""A robot by hand: a small base with two driven wheels, a castor, and a lidar in front.

Every number names its source. These are an example's: replace them, and where they come from.
"""

from __future__ import annotations

import math

from hpp_framework.core.robot import DriveLimits, Lidar, Part, RobotSpec

WHEEL_RADIUS = 0.08  # example; yours: the data sheet of the wheels, or the URDF
BASE_RADIUS = (
    0.22  # example; yours: the farthest point of the shell from the middle of the axle (drawing, URDF)
)
BASE_HEIGHT = 0.18  # example; yours: the top of the shell above the floor
MAST_RADIUS = 0.05  # example; yours: what other robots' lidars see of it at their height

DRIVE = DriveLimits(
    speed=(0.0, 0.8),  # example; yours: the driver's configuration. Backward only if it sees behind it
    turn_rate=2.5,  # example; yours: the driver's configuration
    acceleration=0.6,  # example; yours: measured, or the driver's configuration
    turn_acceleration=2.5,  # example; yours: likewise
)

LIDAR = Lidar(
    beams=222,  # example; yours: the data sheet, or every n-th of its beams
    field_of_view=math.radians(220.0),  # example; yours: the data sheet, less what the body hides
    mount=(0.15, 0.0, 0.0),  # example; yours: drawing or URDF, from the middle of the axle
    height=0.25,  # example; yours: of the scan plane above the floor
    min_range=0.05,  # example; yours: the data sheet
    max_range=12.0,  # example; yours: the data sheet
    noise_std=0.02,  # example; yours: the data sheet, or measured
)


def sample_rover() -> RobotSpec:
    """Return the robot."""
    return RobotSpec(
        name="sample-rover",
        drive=DRIVE,
        lidar=LIDAR,
        footprint_radius=BASE_RADIUS,
        profile_radius=MAST_RADIUS,
        height=0.29,  # example; yours: its highest point
        mass=14.0,  # example; yours: the data sheet, or scales
        body=body,
        sources=("an example's numbers: replace them",),
    )


def body() -> tuple[Part, ...]:
    """Return what it looks like: shell, wheels, mast and lidar."""
    wheels = (
        Part(
            shape="cylinder", size=(WHEEL_RADIUS, 0.03, 0.0), position=(0.0, side * 0.19, WHEEL_RADIUS),
            rotation=(math.pi / 2, 0.0, 0.0), color=(0.03, 0.03, 0.03),
        )
        for side in (-1, 1)
    )  # fmt: skip
    return (
        Part(
            shape="cylinder", size=(BASE_RADIUS, BASE_HEIGHT - 0.04, 0.0),
            position=(0.0, 0.0, (BASE_HEIGHT + 0.04) / 2), color=(0.10, 0.45, 0.25), solid=True,
        ),
        *wheels,
        Part(
            shape="cylinder", size=(MAST_RADIUS, 0.29 - BASE_HEIGHT, 0.0),
            position=(0.0, 0.0, (0.29 + BASE_HEIGHT) / 2), color=(0.35, 0.36, 0.38), solid=True,
        ),
        Part(
            shape="cylinder", size=(0.035, 0.27 - BASE_HEIGHT, 0.0),
            position=(0.15, 0.0, (0.27 + BASE_HEIGHT) / 2), color=(0.05, 0.05, 0.06),
        ),
    )  # fmt: skip
