"""The least time in which a robot can drive a journey."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from jaxtyping import Float

from hpp_framework.core.robot import DriveLimits
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.envs.problem import PointToPoint
from hpp_framework.evaluation.ways import Ways

Array = npt.NDArray[np.float64]

HALVINGS = 60
"""Of the interval that a least time is sought in."""


def time_bounds(
    ways: Ways,
    poses: Float[np.ndarray, "b 3"],
    goals: Float[np.ndarray, "b 2"],
    drive: DriveLimits,
    problem: PointToPoint,
) -> Float[np.ndarray, "b"]:
    """Return a time in seconds that no drive from rest beats, from start to rest at the goal.

    The longer of two bounds. First, a way of length ``least`` takes a trapezoidal speed profile from rest up
    to the top speed and down to the speed that counts as rest.

    Second, turning. Let a robot that cannot back up start with the goal at a bearing beyond 90 degrees. Its
    distance rho to the goal and its bearing alpha obey ``rho' = -v cos(alpha)`` and ``alpha' = -omega +
    v sin(alpha) / rho`` (Aicardi et al. 1995): as long as ``|alpha| > 90`` degrees no speed ``v >= 0`` brings
    it nearer, and what it drives only turns the goal further behind it. So it is no nearer at the time that
    turning by ``|alpha| - 90`` degrees takes, or when it first can have touched something and slid along it,
    if that comes earlier. From then on it needs what the straight distance takes, at best with the speed that
    accelerating from the beginning would have given it.

    The straight distance, because with obstacles this does not hold of the shortest way: where two ways are
    almost equally long, a robot that faces away from the one may take the other without turning.

    Both count the goal radius as reached, positions are looked at every control period, and the dwell at the
    goal is added.

    Args:
        ways: of the journeys.
        poses: start poses, at rest.
        goals: in metres.
        drive: limits of the robot.
        problem: what counts as arriving.
    """
    top = max(drive.speed[1], -drive.speed[0])
    offset = goals - poses[:, :2]
    bearing = np.arctan2(offset[:, 1], offset[:, 0]) - poses[:, 2]
    behind = np.abs((bearing + np.pi) % (2 * np.pi) - np.pi) - np.pi / 2
    turning = np.zeros(len(poses))
    if drive.speed[0] >= 0:
        untouched = np.sqrt(2 * ways.room / drive.acceleration)
        turning = np.minimum(_turn_time(np.maximum(behind, 0), drive), untouched)
    limits = (top, drive.acceleration, problem.rest_speed)
    driving = _least_time(ways.least, np.zeros(len(poses)), *limits)
    both = _least_time(ways.straight - problem.goal_radius, turning, *limits)
    periods = np.ceil(np.maximum(driving, both) / CONTROL_PERIOD - 1e-3)
    return (np.maximum(periods, 1) + problem.dwell - 1) * CONTROL_PERIOD


def _turn_time(angle: Array, drive: DriveLimits) -> Array:
    """Return the seconds that turning by an angle takes from rest, without having to stop."""
    ramp = drive.turn_rate**2 / (2 * drive.turn_acceleration)
    cruising = drive.turn_rate / drive.turn_acceleration + (angle - ramp) / drive.turn_rate
    return np.where(angle <= ramp, np.sqrt(2 * angle / drive.turn_acceleration), cruising)


def _least_time(distance: Array, uncounted: Array, top: float, acceleration: float, final: float) -> Array:
    """Return when a drive from rest can have covered a distance and be no faster than the final speed.

    What it covers before ``uncounted`` seconds does not count.
    """
    low = uncounted.copy()
    high = uncounted + distance.clip(0) / top + 2 * top / acceleration
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        enough = _covered(middle, uncounted, top, acceleration, final) >= distance
        low, high = np.where(enough, low, middle), np.where(enough, middle, high)
    return low


def _covered(end: Array, start: Array, top: float, acceleration: float, final: float) -> Array:
    """Return the integral from start to end of ``min(a t, top, final + a (end - t))``."""
    peak = np.minimum(top, (acceleration * end + final) / 2)
    # when the speed stops to rise, and when it begins to fall
    risen = np.minimum(peak / acceleration, end)
    falls = np.maximum(end - np.maximum(peak - final, 0) / acceleration, risen)

    def until(time: Array) -> Array:
        rising, level, falling = np.minimum(time, risen), np.minimum(time, falls) - risen, time - falls
        braking = np.maximum(falling, 0)
        return (
            acceleration * rising**2 / 2
            + peak * (np.maximum(level, 0) + braking)
            - acceleration * braking**2 / 2
        )

    return until(end) - until(start)
