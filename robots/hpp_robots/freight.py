"""Freight: the low round transport base."""

from __future__ import annotations

from hpp_framework.robot import Part, RobotSpec
from hpp_robots import base

TRIM = (0.10, 0.42, 0.78)


def freight() -> RobotSpec:
    """Return Freight under the paper's drive limits."""
    return RobotSpec(
        name="freight",
        drive=base.PAPER_DRIVE,
        lidar=base.LIDAR,
        footprint_radius=base.FOOTPRINT_RADIUS,
        profile_radius=base.PROFILE_RADIUS,
        height=base.BASE_HEIGHT,
        mass=78.85,  # URDF
        body=body,
        sources=(
            "fetch_ros melodic freight.urdf",
            "Wang et al. 2020, appendix C.1",
            "SICK TIM571 data sheet",
        ),
    )


def body() -> tuple[Part, ...]:
    """Return the base, its flat cargo plate and the emergency stop."""
    top = base.BASE_HEIGHT
    return (
        *base.base_parts(TRIM),
        Part(shape="cylinder", size=(0.20, 0.012, 0), position=(0, 0, top + 0.006), color=(0.85, 0.86, 0.88)),
        Part(
            shape="cylinder",
            size=(0.022, 0.03, 0),
            position=(-0.24, 0, top + 0.012),
            color=(0.85, 0.08, 0.05),
        ),
    )
