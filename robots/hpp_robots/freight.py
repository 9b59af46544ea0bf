"""Freight: the low round transport base."""

from __future__ import annotations

import dataclasses

from hpp_framework.core.robot import Part, RobotSpec
from hpp_robots import base

TRIM = (0.04, 0.28, 0.66)
_RAIL = (0.45, 0.47, 0.50)
_GROOVE = (0.06, 0.06, 0.07)


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


def freight_real() -> RobotSpec:
    """Return Freight under its own published drive limits."""
    return dataclasses.replace(
        freight(),
        name="freight-real",
        drive=base.FREIGHT_DRIVE,
        sources=(
            "fetch_ros melodic freight.urdf",
            "fetch_robots bringup and robot_controllers: drive limits",
            "SICK TIM571 data sheet",
        ),
    )


def body() -> tuple[Part, ...]:
    """Return the base, the rails of its cargo top and the emergency stop."""
    top = base.BASE_HEIGHT
    return (
        *base.base_parts(TRIM, TRIM),
        Part(
            shape="cylinder", size=(0.205, 0.008, 0), position=(0, 0, top + 0.004), color=(0.80, 0.82, 0.85)
        ),
        # two aluminium rails with a groove each
        *(
            Part(shape="box", size=(0.32, 0.035, 0.012), position=(0, side * 0.09, top + 0.012), color=_RAIL)
            for side in (-1, 1)
        ),
        *(
            Part(
                shape="box", size=(0.322, 0.008, 0.013), position=(0, side * 0.09, top + 0.012), color=_GROOVE
            )
            for side in (-1, 1)
        ),
        Part(
            shape="cylinder",
            size=(0.032, 0.014, 0),
            position=(-0.215, 0, top + 0.006),
            color=(0.75, 0.62, 0.06),
        ),
        Part(
            shape="cylinder",
            size=(0.022, 0.030, 0),
            position=(-0.215, 0, top + 0.022),
            color=(0.75, 0.04, 0.03),
        ),
    )
