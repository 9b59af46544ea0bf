"""The least time in which a team can fulfil a task: no planner is faster."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Float

from hpp_framework.core.requirement import AllOf, AnyOf, Apart, Gathering, Requirement
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.task import Task
from hpp_framework.core.world import World
from hpp_framework.evaluation.path_bounds import half_diagonal, in_periods, least_lengths, least_time
from hpp_framework.worlds.occupancy import free_space

NEARBY = 6.0
"""Metres of path that are looked for first; most teams meet within them."""


def task_bounds(
    worlds: Sequence[World], starts: Float[np.ndarray, "b n 3"], robots: Sequence[RobotSpec], task: Task
) -> Float[np.ndarray, "b"]:
    r"""Return times in seconds that no team beats, from rest at the start to success.

    In every step of success the task's requirement holds, and success lasts ``task.sustain_steps`` steps.

    - A gathering has a place :math:`c` that each robot :math:`i` has come within the radius of. So it takes
      at least :math:`\min_c \max_i t_i(c)`, where :math:`t_i(c)` is the least time in which the robot drives
      the shortest path around the obstacles that ends within the radius of :math:`c`.
    - Two robots get apart no faster than both can drive.
    - All of several requirements take the longest of their times, any of them the shortest.

    Args:
        worlds: one per episode.
        starts: start poses, at rest.
        robots: the team.
        task: the objective.

    Returns:
        NaN if the task states no requirement; infinity where it cannot be met.
    """
    requirement = task.requirement()
    if requirement is None:
        return np.full(len(worlds), np.nan)
    seconds = [
        _Start(world, poses[:, :2].astype(np.float64), robots).least(requirement)
        for world, poses in zip(worlds, starts, strict=True)
    ]
    return in_periods(seconds, task.sustain_steps)


@dataclass(frozen=True)
class _Start:
    """The start of an episode."""

    world: World
    positions: Float[np.ndarray, "n 2"]
    robots: Sequence[RobotSpec]

    def least(self, requirement: Requirement) -> float:
        """Return the seconds until a requirement can hold, infinity if it cannot."""
        match requirement:
            case AllOf(parts):
                return max(map(self.least, parts), default=0.0)
            case AnyOf(parts):
                return min(map(self.least, parts), default=math.inf)
            case Apart(one, other, least):
                return self._apart(one, other, least)
            case Gathering():
                found = self._gathering(requirement, NEARBY)
                # no robot reaches the cells left out earlier than this
                later = min(float(least_time(0.9 * NEARBY, robot.drive)) for robot in self.robots)
                return found if found <= later else self._gathering(requirement, 0.0)

    def _apart(self, one: int, other: int, least: float) -> float:
        missing = least - float(np.linalg.norm(self.positions[one] - self.positions[other]))
        drives = [self.robots[one].drive, self.robots[other].drive]
        top = max(max(drive.speed[1], -drive.speed[0]) for drive in drives)
        both = replace(drives[0], speed=(0.0, top), acceleration=max(drive.acceleration for drive in drives))
        return float(least_time(max(missing, 0.0) / 2, both))

    def _gathering(self, gathering: Gathering, farthest: float) -> float:
        """Return the least time of a gathering with paths up to a length, infinity if they are too short."""
        members = range(len(self.robots)) if gathering.robots is None else gathering.robots
        arrivals = [self._arrivals(robot, gathering.radius, farthest) for robot in members]
        latest = np.maximum.reduce(arrivals)
        if gathering.point is None:
            return float(latest.min())
        space = free_space(self.world, body_height=self.robots[0].height)
        return float(latest.flat[space.distance_from(np.array(gathering.point)).argmin()])

    def _arrivals(self, robot: int, radius: float, farthest: float) -> Float[np.ndarray, "r c"]:
        """Return the least time in which a robot comes within a radius of any point of each cell."""
        spec = self.robots[robot]
        space = free_space(self.world, body_height=spec.height)
        lengths = least_lengths(space, spec.footprint_radius, self.positions[robot], farthest=farthest)
        # both the robot and the point may be anywhere in their cells
        cells = (radius + 2 * half_diagonal(space)) / space.resolution
        x = np.arange(-math.floor(cells), math.floor(cells) + 1)
        disc = (np.hypot(x, x[:, None]) <= cells).astype(np.uint8)
        nearest = cv2.erode(lengths.astype(np.float32), disc, borderType=cv2.BORDER_REPLICATE)
        return least_time(nearest, spec.drive)
