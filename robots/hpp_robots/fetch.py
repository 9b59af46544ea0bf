"""Fetch: the mobile manipulator, arm tucked."""

from __future__ import annotations

import dataclasses
import math
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from hpp_framework.core.robot import Part, RobotSpec
from hpp_robots import base

Color = tuple[float, float, float]
Points = npt.NDArray[np.float64]

TRIM: Color = (0.86, 0.25, 0.03)
_WHITE: Color = (0.80, 0.80, 0.82)
_GREY: Color = (0.26, 0.27, 0.29)
_SILVER: Color = (0.55, 0.56, 0.60)
_DARK: Color = (0.03, 0.03, 0.035)
_LENS: Color = (0.10, 0.16, 0.28)

TORSO = (-0.086875, 0.0, 0.37743 + base.FLOOR_GAP)
"""``torso_lift_joint`` above the floor, torso down (URDF)."""
SHOULDER = (0.119525, 0.0, 0.34858)
"""``shoulder_pan_joint`` from the torso (URDF)."""
ARM = (
    ((0.0, 0.0, 0.0), "z"),  # shoulder_pan
    ((0.117, 0.0, 0.06), "y"),  # shoulder_lift
    ((0.219, 0.0, 0.0), "x"),  # upperarm_roll
    ((0.133, 0.0, 0.0), "y"),  # elbow_flex
    ((0.197, 0.0, 0.0), "x"),  # forearm_roll
    ((0.1245, 0.0, 0.0), "y"),  # wrist_flex
    ((0.1385, 0.0, 0.0), "x"),  # wrist_roll
    ((0.16645, 0.0, 0.0), "x"),  # gripper
)
"""Offset from the joint before and axis of each joint (URDF)."""
TUCKED = (1.32, 1.40, -0.2, 1.72, 0.0, 1.66, 0.0)
"""Joint angles in radians of a tucked posture; our own choice, for looks only (the arm touches nothing)."""
JOINT_RADII = (0.068, 0.060, 0.062, 0.054, 0.056, 0.048)
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


def fetch_real() -> RobotSpec:
    """Return Fetch under its own published drive limits."""
    return dataclasses.replace(
        fetch(),
        name="fetch-real",
        drive=base.FETCH_DRIVE,
        sources=(
            "fetch_ros melodic fetch.urdf",
            "fetch_robots bringup and robot_controllers: drive limits",
            "SICK TIM571 data sheet",
        ),
    )


def body() -> tuple[Part, ...]:
    """Return base, torso, head and the seven-joint arm, torso down and arm tucked, as the robot drives."""
    return (*base.base_parts(TRIM, base.LIGHT_SHELL), *_torso(), *_head(), *_arm())


def _torso() -> tuple[Part, ...]:
    """Return the fixed torso, the bellows and the lifted torso (``torso_lift_joint`` at x -0.0869)."""
    x = TORSO[0]
    return (
        *_rounded((0.24, 0.32), (x, 0.0), (base.BASE_HEIGHT, 0.56), _WHITE, solid=True),
        *_rounded((0.19, 0.25), (x, 0.0), (0.56, 0.66), _DARK),
        *_rounded((0.22, 0.28), (x, 0.0), (0.66, 0.93), _WHITE, solid=True),
        *_rounded((0.18, 0.22), (x + 0.01, 0.0), (0.93, 0.955), _GREY),
        # the shoulder's foot in front, and a strip in the robot's own colour
        Part(shape="box", size=(0.12, 0.13, 0.10), position=(x + 0.10, 0, 0.70), color=_GREY),
        Part(shape="box", size=(0.012, 0.05, 0.20), position=(x - 0.108, 0, 0.80), color=TRIM),
    )


def _head() -> tuple[Part, ...]:
    """Return neck and head (``head_pan_joint``, ``head_tilt_joint``, camera 0.055 m ahead of it)."""
    pan = TORSO[0] + 0.053125
    tilt, height = pan + 0.14253, 1.043
    return (
        Part(shape="cylinder", size=(0.055, 0.075, 0), position=(pan, 0, 0.985), color=_DARK),
        Part(shape="box", size=(0.13, 0.11, 0.05), position=(pan + 0.06, 0, height), color=_GREY),
        Part(shape="cylinder", size=(0.052, 0.25, 0), position=(tilt - 0.02, 0, height),
             rotation=(math.pi / 2, 0, 0), color=_WHITE),
        Part(shape="box", size=(0.06, 0.25, 0.085), position=(tilt + 0.012, 0, height), color=_WHITE),
        Part(shape="box", size=(0.012, 0.21, 0.05), position=(tilt + 0.042, 0, height + 0.005), color=_DARK),
        *(
            Part(shape="cylinder", size=(0.014, 0.008, 0), position=(tilt + 0.049, y, height + 0.005),
                 rotation=(0, math.pi / 2, 0), color=color)
            for y, color in ((-0.06, _LENS), (0.0, _LENS), (0.06, (0.5, 0.05, 0.03)))
        ),
    )  # fmt: skip


def _arm() -> tuple[Part, ...]:
    """Return the tucked arm: joints in the robot's colour, links between them, and the open gripper."""
    joints, hand = arm_frames()
    ahead, side = hand[:, 0], hand[:, 1]
    palm = joints[-1] - 0.03 * ahead
    links = ((0.062, _GREY), (0.058, _WHITE), (0.055, _GREY), (0.052, _WHITE), (0.05, _GREY), (0.046, _WHITE))
    return (
        Part(shape="cylinder", size=(0.075, 0.07, 0), position=_point(joints[0] + [0, 0, 0.03]), color=_GREY),
        *(
            _rod(start, end, radius, color)
            for (start, end), (radius, color) in zip(pairwise(joints[:-1]), links, strict=True)
        ),
        *(
            Part(
                shape="sphere",
                size=(radius, 0, 0),
                position=_point(joint),
                color=TRIM if joint_index % 2 else _GREY,
            )
            for joint_index, (joint, radius) in enumerate(zip(joints[1:-1], JOINT_RADII, strict=True))
        ),
        _rod(joints[-2], palm, 0.040, _GREY),
        _rod(palm - 0.06 * side, palm + 0.06 * side, 0.030, _DARK),
        *(
            _rod(palm + offset * side, palm + offset * side + 0.075 * ahead, 0.011, _SILVER)
            for offset in (-0.045, 0.045)
        ),
    )


def arm_frames() -> tuple[Points, Points]:
    """Return the arm's joint positions (8, 3), the gripper's last, and the gripper's axes (3, 3) as columns.

    Forward kinematics of the URDF's joints in the posture in which Fetch drives, torso down.
    """
    position, axes = np.array(TORSO) + SHOULDER, np.eye(3)
    places = [position]
    for (offset, axis), angle in zip(ARM, (*TUCKED, 0.0), strict=True):
        position = position + axes @ np.array(offset)
        places.append(position)
        axes = axes @ _turn(axis, angle)
    return np.array(places[1:]), axes


def _turn(axis: str, angle: float) -> Points:
    cos, sin = math.cos(angle), math.sin(angle)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    out = np.eye(3)
    out[i, i] = out[j, j] = cos
    out[i, j], out[j, i] = -sin, sin
    return out


def _rod(start: Points, end: Points, radius: float, color: Color) -> Part:
    """Return a cylinder between two points."""
    along = end - start
    length = float(np.linalg.norm(along))
    pitch, yaw = math.acos(along[2] / length), math.atan2(along[1], along[0])
    return Part(
        shape="cylinder",
        size=(radius, length, 0.0),
        position=_point((start + end) / 2),
        rotation=(0.0, pitch, yaw),
        color=color,
    )


def _rounded(
    size: tuple[float, float],
    center: tuple[float, float],
    span: tuple[float, float],
    color: Color,
    *,
    solid: bool = False,
) -> tuple[Part, ...]:
    """Return an upright block with round edges: ``size`` in x and y, ``span`` from low to high."""
    (length, width), (x, y), (low, high) = size, center, span
    radius = 0.3 * min(size)
    middle, height = (low + high) / 2, high - low
    return (
        Part(
            shape="box",
            size=(length - 2 * radius, width, height),
            position=(x, y, middle),
            color=color,
            solid=solid,
        ),
        Part(shape="box", size=(length, width - 2 * radius, height), position=(x, y, middle), color=color),
        *(
            Part(
                shape="cylinder",
                size=(radius, height, 0.0),
                position=(x + dx * (length / 2 - radius), y + dy * (width / 2 - radius), middle),
                color=color,
            )
            for dx in (-1, 1)
            for dy in (-1, 1)
        ),
    )


def _point(array: Points) -> tuple[float, float, float]:
    x, y, z = array.tolist()
    return x, y, z
