"""Lower bounds: lengths that no path of a robot, and times that no drive, falls short of."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import torch
from jaxtyping import Float

from hpp_framework.core.robot import DriveLimits
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.worlds.occupancy import FreeSpace
from hpp_framework.worlds.paths import PathFields, shortest_paths

MARGIN = 1.5
"""Cells by which obstacles are drawn smaller than for shortest paths, 3 cells in all.

A free space may call them 1.92 cells nearer than they are: half a cell taken off on purpose, and half a
diagonal each for where in its cell the obstacle and the robot is. One more cell keeps passages wide enough
for fast marching, which measures too much where they are one cell wide.
"""
SHARE = 0.01
"""Share of its length by which fast marching may find a path too long. The tests check both constants."""


def least_lengths(
    space: FreeSpace, radius: float, start: Float[np.ndarray, "2"], *, farthest: float = 0.0
) -> Float[np.ndarray, "r c"]:
    """Return lengths in metres that no path from a start to anywhere in a cell is shorter than.

    Infinite where no path leads.

    Args:
        space: free space of the world.
        radius: of the robot's footprint, metres.
        start: world coordinates, metres.
        farthest: longest path that is looked for, metres; longer ones are infinite. 0 looks for all.
    """
    field = _field(space, radius - MARGIN * space.resolution, start, farthest)
    around = field.values[0].double().numpy() * (1 - SHARE)
    # the end may be anywhere in its cell
    return np.maximum(np.maximum(space.distance_from(start), around) - half_diagonal(space), 0.0)


def path_lengths(
    space: FreeSpace,
    radius: float,
    start: Float[np.ndarray, "2"],
    goal: Float[np.ndarray, "2"],
    goal_radius: float,
) -> tuple[float, float]:
    """Return the length of the shortest path to a goal, and a lower bound of that to the disc around it.

    A point of the disc may lie behind a thin wall from the goal; arriving there counts all the same.

    Args:
        space: free space of the world.
        radius: of the robot's footprint, metres.
        start: world coordinates, metres.
        goal: world coordinates, metres.
        goal_radius: of the disc, metres.
    """
    straight = float(np.linalg.norm(goal - start))
    shortest, least = straight, max(straight - goal_radius, 0.0)
    if is_open(space, radius, start, goal):
        return shortest, least
    reached = space.distance_from(goal) <= goal_radius + half_diagonal(space)
    # most paths are not much longer than the straight line, and near cells are found quickly
    for farthest in (1.2 * straight + 1.5, 0.0):
        point = torch.from_numpy(goal[None]).float()
        found = float(_field(space, radius, start, farthest).at(torch.zeros(1, dtype=torch.long), point))
        nearest = float(least_lengths(space, radius, start, farthest=farthest)[reached].min())
        if math.isfinite(found) and math.isfinite(nearest):
            return max(shortest, found), max(least, nearest)
    # a grid that finds no path proves nothing
    return shortest, least


def is_open(
    space: FreeSpace, radius: float, start: Float[np.ndarray, "2"], goal: Float[np.ndarray, "2"]
) -> bool:
    """Return whether a disc certainly fits everywhere on the straight line from start to goal."""
    count = int(np.ceil(np.linalg.norm(goal - start) / (space.resolution / 2))) + 1
    return bool((space.at(np.linspace(start, goal, count)) > radius).all())


def least_time(
    length: npt.ArrayLike, drive: DriveLimits, final_speed: float = math.inf
) -> Float[np.ndarray, "*p"]:
    """Return the seconds that a path takes from rest at least: a trapezoidal speed profile.

    The speed rises at full acceleration to the top speed or to a lower peak, and falls to the final speed.

    Args:
        length: of the path, metres.
        drive: limits of the robot.
        final_speed: highest speed at the end, m/s.
    """
    length = np.asarray(length, np.float64)
    top, acceleration = max(drive.speed[1], -drive.speed[0]), drive.acceleration
    final = min(final_speed, top)
    peak = np.sqrt(np.minimum(2 * acceleration * length, acceleration * length + final**2 / 2)).clip(max=top)
    braking = np.maximum(peak - final, 0.0)
    ramps = (peak**2 + braking * (peak + final)) / (2 * acceleration)
    return np.asarray((peak + braking) / acceleration + (length - ramps) / np.maximum(peak, 1e-9))


def in_periods(seconds: npt.ArrayLike, dwell: int) -> Float[np.ndarray, "*p"]:
    """Return when a state reached after some seconds has lasted for a number of control steps, seconds.

    States are looked at once per control period, from the first on.
    """
    reached = np.maximum(np.ceil(np.asarray(seconds) / CONTROL_PERIOD - 1e-3), 1)
    return np.asarray((reached + dwell - 1) * CONTROL_PERIOD)


def half_diagonal(space: FreeSpace) -> float:
    """Return the distance in metres from the centre of a cell to its corners."""
    return space.resolution / math.sqrt(2)


def _field(space: FreeSpace, radius: float, start: Float[np.ndarray, "2"], farthest: float) -> PathFields:
    index = torch.zeros(1, dtype=torch.long)
    return shortest_paths([space], radius, torch.from_numpy(start[None]).float(), index, farthest=farthest)
