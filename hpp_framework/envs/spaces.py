"""Spaces of observations and actions, shared by all environments. Metres, radians, m/s, rad/s; float32."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from gymnasium import spaces
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core import geometry
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.types import Observation
from hpp_framework.core.world import World
from hpp_framework.utils.errors import ConfigError, SimulatorError

FloatArray = npt.NDArray[np.float32]

MAX_GOAL_DISTANCE = 60.0
"""Farther goals are observed at this distance, in metres."""

MAX_POSITION = 1000.0
"""Largest coordinate of an observed position, in metres; worlds must lie within."""


def scan_space(robot: RobotSpec) -> spaces.Box:
    """Return the space of one scan: ranges (beams,) in metres."""
    lidar = robot.lidar
    return spaces.Box(lidar.min_range, lidar.max_range, (lidar.beams,), np.float32)


def goal_space() -> spaces.Box:
    """Return the space of a goal in polar coordinates: distance in metres and bearing in radians."""
    return _box((0.0, -math.pi), (MAX_GOAL_DISTANCE, math.pi))


def command_space(robot: RobotSpec) -> spaces.Box:
    """Return the space of commands and of odometry: forward speed (m/s) and turn rate (rad/s)."""
    (low, high), turn = robot.drive.speed, robot.drive.turn_rate
    return _box((low, -turn), (high, turn))


def poses_space(count: int) -> spaces.Box:
    """Return the space of a team's poses (count, 3): x, y in metres and heading in radians, world frame."""
    high = np.tile(np.array([MAX_POSITION, MAX_POSITION, math.pi], np.float32), (count, 1))
    return spaces.Box(-high, high, dtype=np.float32)


def unit_space(numbers: int = 2) -> spaces.Box:
    """Return [-1, 1]^numbers, the form of action that learning libraries expect."""
    return _box((-1.0,) * numbers, (1.0,) * numbers)


def from_unit(action: npt.NDArray[Any], space: spaces.Box) -> npt.NDArray[Any]:
    """Map actions (..., 2) in [-1, 1] linearly onto a space; values beyond are cut off, NaN stays NaN."""
    middle, half = (space.high + space.low) / 2, (space.high - space.low) / 2
    return middle + half * np.clip(action, -1.0, 1.0)


def check_action(action: object, whose: str, meaning: str, count: int = 2) -> FloatArray:
    """Return an action as an array (count,) of float32.

    Args:
        action: what the user gave.
        whose: names the agent in messages.
        meaning: names the numbers in messages, e.g. ``"[v in m/s, omega in rad/s]"``.
        count: of the numbers, two or three.

    Raises:
        SimulatorError: if it is not as many finite numbers.
    """
    numbers = to_numbers(action)
    if numbers.shape != (count,):
        word = {2: "two", 3: "three"}[count]
        raise SimulatorError(f"the action of {whose} must be {word} numbers {meaning}, got {action!r}.")
    if not np.isfinite(numbers).all():
        raise SimulatorError(
            f"the action of {whose} is not finite: {numbers.tolist()}. Actions are {meaning}."
        )
    return numbers


def to_numbers(given: object) -> FloatArray:
    """Return what a user gave as an array of float32, an empty one if it is no array of numbers."""
    try:
        return np.asarray(given, np.float32)
    except (TypeError, ValueError):
        return np.zeros(0, np.float32)


def check_bounds(world: World) -> None:
    """Raise :class:`ConfigError` if positions in a world do not fit into :func:`poses_space`."""
    if max(abs(number) for number in world.bounds) > MAX_POSITION:
        raise ConfigError(
            f"world '{world.name}': environments observe positions up to {MAX_POSITION} m from the origin, "
            f"but its bounds are {list(world.bounds)}. Move or scale the world."
        )


def team_poses(observation: Observation) -> Float[Tensor, "b n 3"]:
    """Return the newest observed poses, headings wrapped: noise may have carried one past pi."""
    poses = observation.team_poses
    heading = poses[..., 2:]
    # wrapping rounds, so headings that need none are left as they are
    return torch.cat(
        [poses[..., :2], torch.where(heading.abs() > math.pi, geometry.wrap_angle(heading), heading)], -1
    )


def to_arrays(parts: Mapping[str, Tensor], space: spaces.Space[Any]) -> dict[str, FloatArray]:
    """Return batch entry 0 of each part as a new array, cut off at the limits of its entry in a ``Dict``."""
    assert isinstance(space, spaces.Dict)
    return {name: _within(part[0], space[name]) for name, part in parts.items()}


def _within(part: Tensor, box: spaces.Space[Any]) -> FloatArray:
    assert isinstance(box, spaces.Box)
    return np.clip(part.detach().cpu().numpy(), box.low, box.high).astype(np.float32)


def _box(low: tuple[float, ...], high: tuple[float, ...]) -> spaces.Box:
    return spaces.Box(np.array(low, np.float32), np.array(high, np.float32), dtype=np.float32)
