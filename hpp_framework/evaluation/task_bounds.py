"""The least time in which a team can fulfil a task: no planner, however clever, is faster."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hpp_framework.core.requirement import AllOf, AnyOf, Apart, Displaced, Gathering, Requirement, Visit
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.task import Task
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.world import World
from hpp_framework.evaluation.meeting import first_meeting
from hpp_framework.evaluation.reach import PERIODS, Reach
from hpp_framework.evaluation.ways import journey_ways
from hpp_framework.worlds.occupancy import free_space

Step = float
"""A control step, or infinity."""


def task_bounds(
    worlds: Sequence[World], starts: Float[np.ndarray, "b n 3"], robots: Sequence[RobotSpec], task: Task
) -> Float[np.ndarray, "b"]:
    r"""Return times in seconds that no team beats, from rest at the start to success.

    In every step of success the task's requirement holds, and success lasts ``task.sustain_steps`` steps. So
    the time is at least that of the first step at which the requirement can hold, and of the other steps.

    - A gathering has a least time of its own, see :func:`~hpp_framework.evaluation.meeting.first_meeting`.
    - A visit takes its robot at least as long as the shortest way around the obstacles, and as the straight
      distance with the turn that must come first.
    - The distance of two robots, and where one lies from the other, changes by no more than both can drive.
    - All of several requirements take the longest of their times, any of them the shortest.

    Args:
        worlds: one an episode.
        starts: start poses, at rest.
        robots: the team.
        task: what is to be fulfilled.

    Returns:
        NaN if nothing is known that the task requires; infinity where it takes more than a minute.
    """
    requirement = task.requirement()
    if requirement is None:
        return np.full(len(worlds), np.nan)
    steps = [
        _Start(world, poses, robots).first(requirement)
        for world, poses in zip(worlds, starts.astype(np.float64), strict=True)
    ]
    return (np.maximum(steps, 1) + task.sustain_steps - 1) * CONTROL_PERIOD


@dataclass(frozen=True)
class _Start:
    """Where an episode begins."""

    world: World
    poses: Float[np.ndarray, "n 3"]
    robots: Sequence[RobotSpec]

    def first(self, requirement: Requirement) -> Step:
        """Return the first control step at which a requirement can hold, infinity if it cannot."""
        match requirement:
            case AllOf(parts):
                return max(map(self.first, parts), default=0)
            case AnyOf(parts):
                return min(map(self.first, parts), default=math.inf)
            case Gathering(radius, members):
                return first_meeting(self.world, self.poses, self.robots, radius, members)
            case Visit():
                return self._visit(requirement)
            case Apart(one, other, least, most):
                apart = float(np.linalg.norm(self._between(one, other)))
                return self._driven(one, other, max(least - apart, apart - most))
            case Displaced(one, other, vector, slack):
                missing = float(np.linalg.norm(self._between(one, other) - np.array(vector)))
                return self._driven(one, other, missing - slack)

    def _between(self, one: int, other: int) -> Float[np.ndarray, "2"]:
        return self.poses[one, :2] - self.poses[other, :2]

    def _driven(self, one: int, other: int, metres: float) -> Step:
        """Return the first step at which two robots together can have driven so far."""
        reaches = [Reach(self.robots[i].drive) for i in (one, other)]
        return _first_step(lambda step: sum(each.distance(step) for each in reaches) >= metres - 1e-9)

    def _visit(self, visit: Visit) -> Step:
        robot, point = self.robots[visit.robot], np.array(visit.point)
        pose, reach = self.poses[visit.robot], Reach(robot.drive)
        space = free_space(self.world, body_height=robot.height)
        ways = journey_ways(
            [space], robot.footprint_radius, pose[None, :2], point[None], goal_radius=visit.radius
        )
        room = min([float(ways.room[0]), *(self._gap(visit.robot, i) for i in range(len(self.robots)))])
        straight = reach.towards(pose, point[None], visit.radius, max(room, 0.0), PERIODS)
        step = max(int(straight[0]), int(reach.driving(ways.least, PERIODS)[0]))
        return step if step <= PERIODS else math.inf

    def _gap(self, one: int, other: int) -> float:
        """Return the metres that each of two robots can drive before they can touch."""
        if one == other:
            return math.inf
        radii = self.robots[one].footprint_radius + self.robots[other].footprint_radius
        return (float(np.linalg.norm(self._between(one, other))) - radii) / 2


def _first_step(reached: Callable[[int], bool]) -> Step:
    return next((step for step in range(PERIODS + 1) if reached(step)), math.inf)
