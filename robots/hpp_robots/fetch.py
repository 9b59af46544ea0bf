"""Fetch: the mobile manipulator, arm tucked."""

from __future__ import annotations

import math

from hpp_framework.robot import Part, RobotSpec
from hpp_robots import base

TRIM = (0.93, 0.42, 0.10)
_WHITE = (0.90, 0.90, 0.92)
_GREY = (0.42, 0.44, 0.48)
_DARK = (0.13, 0.13, 0.15)
HEIGHT = 1.10
"""Torso down (URDF); 1.49 m with the torso up."""


def fetch() -> RobotSpec:
    """Return Fetch under the paper's drive limits."""
    return RobotSpec(
        name="fetch",
        drive=base.PAPER_DRIVE,
        lidar=base.LIDAR,
        footprint_radius=base.FOOTPRINT_RADIUS,
        profile_radius=base.PROFILE_RADIUS,
        height=HEIGHT,
        mass=121.3,  # URDF
        body=body,
        sources=("fetch_ros melodic fetch.urdf", "Wang et al. 2020, appendix C.1", "SICK TIM571 data sheet"),
    )


def body() -> tuple[Part, ...]:
    """Return base, torso column, head and the tucked seven-joint arm.

    Torso at x -0.0869 and shoulder, head at their URDF offsets with the torso down; the arm's links are
    folded over the base so that it stays within the footprint, as the robot drives.
    """
    torso_x = -0.0869
    return (
        *base.base_parts(TRIM),
        Part(shape="box", size=(0.20, 0.26, 0.40), position=(torso_x, 0, 0.56), color=_WHITE, solid=True),
        Part(shape="box", size=(0.14, 0.18, 0.14), position=(torso_x, 0, 0.82), color=_GREY, solid=True),
        Part(shape="cylinder", size=(0.05, 0.10, 0), position=(-0.034, 0, 0.93), color=_DARK),
        Part(shape="box", size=(0.14, 0.26, 0.10), position=(0.03, 0, 1.03), color=_WHITE, solid=True),
        Part(shape="box", size=(0.012, 0.20, 0.055), position=(0.105, 0, 1.03), color=_DARK),
        # arm: shoulder ahead of the torso, upper arm to the left, forearm folded back to the right
        Part(shape="cylinder", size=(0.065, 0.14, 0), position=(0.06, 0, 0.74), color=TRIM),
        Part(shape="cylinder", size=(0.055, 0.22, 0), position=(0.10, 0.11, 0.76),
             rotation=(math.pi / 2, 0, 0), color=_WHITE),
        Part(shape="sphere", size=(0.062, 0, 0), position=(0.12, 0.21, 0.76), color=TRIM),
        Part(shape="cylinder", size=(0.05, 0.24, 0), position=(0.16, 0.10, 0.69),
             rotation=(math.pi / 2, 0.25, 0), color=_WHITE),
        Part(shape="sphere", size=(0.056, 0, 0), position=(0.18, -0.03, 0.65), color=TRIM),
        Part(shape="cylinder", size=(0.045, 0.18, 0), position=(0.16, -0.12, 0.60),
             rotation=(math.pi / 2, -0.2, 0), color=_WHITE),
        Part(shape="sphere", size=(0.05, 0, 0), position=(0.13, -0.20, 0.57), color=TRIM),
        Part(shape="box", size=(0.10, 0.05, 0.05), position=(0.06, -0.21, 0.54), color=_GREY),
        Part(shape="box", size=(0.06, 0.012, 0.02), position=(-0.01, -0.19, 0.54), color=_DARK),
        Part(shape="box", size=(0.06, 0.012, 0.02), position=(-0.01, -0.23, 0.54), color=_DARK),
    )  # fmt: skip
