"""Options: skills that say where they may be started, when they are over, and how long they may take.

After Sutton, Precup and Singh (1999), "Between MDPs and semi-MDPs": an initiation set, a policy, a
termination condition; and a budget of control steps besides. The loop that runs one, for all episodes at
once::

    option = make_option("p2p", robot)
    if option.may_start(observation, goal).all():
        while not option.is_over(observation, goal, steps).all():
            command = option.skill.act(observation, goal)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework import geometry
from hpp_framework.errors import ConfigError
from hpp_framework.registry import hub
from hpp_framework.robot import RobotSpec
from hpp_framework.sensing import lidar_poses, seen_points
from hpp_framework.skill import Skill
from hpp_framework.types import Observation

Condition = Callable[[Observation, Tensor], Tensor]
"""Says of an observation and goals (b, 2) in world coordinates in which episodes (b,) something holds."""

BUDGET = 50
"""Control steps an option may take unless told otherwise: 10 s."""


def anywhere(observation: Observation, goal: Float[Tensor, "b 2"]) -> Bool[Tensor, "b"]:
    """Hold always: the initiation set of a skill that finds its way."""
    del goal
    return torch.ones(len(observation.pose), dtype=torch.bool, device=observation.pose.device)


def arrived(radius: float = 0.3) -> Condition:
    """Return the condition that the robot is within ``radius`` metres of its goal."""

    def holds(observation: Observation, goal: Float[Tensor, "b 2"]) -> Bool[Tensor, "b"]:
        return (observation.pose[:, :2] - goal).norm(dim=-1) <= radius

    return holds


def clear_way(robot: RobotSpec, margin: float = 0.1) -> Condition:
    """Return the condition that the goal lies in view, and nothing that was seen on the straight way there.

    Other robots do not count: they move on.

    The initiation set of a skill that avoids nothing, and of one whose motion model knows no obstacles.

    Args:
        robot: whose lidar and footprint.
        margin: gap in metres that the footprint keeps on the way.
    """
    half = robot.footprint_radius + margin

    def holds(observation: Observation, goal: Float[Tensor, "b 2"]) -> Bool[Tensor, "b"]:
        distance, bearing = geometry.polar(observation.pose, goal).unbind(-1)
        eye = lidar_poses(robot.lidar, observation.pose)
        in_view = geometry.polar(eye, goal)[:, 1].abs() <= robot.lidar.field_of_view / 2
        ends, real = seen_points(observation, robot.lidar)
        reach, direction = geometry.polar(observation.pose[:, None], ends).unbind(-1)
        turned = direction - bearing[:, None]
        ahead, aside = reach * turned.cos(), reach * turned.sin()
        blocked = real & (ahead > 0) & (ahead < distance[:, None]) & (aside.abs() < half)
        return in_view & ~blocked.any(-1)

    return holds


@dataclass(frozen=True, kw_only=True)
class Option:
    """A skill with an initiation set, a termination condition and a time budget.

    Attributes:
        name: for messages and records.
        skill: that drives.
        starts: where it may be started.
        ends: where it is over.
        budget: control steps after which it is over anyway.
    """

    name: str
    skill: Skill
    starts: Condition = anywhere
    ends: Condition = arrived()
    budget: int = BUDGET

    def __post_init__(self) -> None:
        if self.budget < 1:
            raise ConfigError(f"option '{self.name}': budget must be at least 1 step, got {self.budget}.")

    def may_start(self, observation: Observation, goal: Float[Tensor, "b 2"]) -> Bool[Tensor, "b"]:
        """Return in which episodes it may be started for these goals."""
        return self.starts(observation, goal)

    def is_over(
        self, observation: Observation, goal: Float[Tensor, "b 2"], steps: int | Tensor
    ) -> Bool[Tensor, "b"]:
        """Return in which episodes it is over.

        Args:
            observation: of the robot.
            goal: that it was started for, world coordinates.
            steps: control steps since then; one number or one an episode.
        """
        over = self.ends(observation, goal)
        return over | (torch.as_tensor(steps, device=over.device) >= self.budget)


MakeOption = Callable[[RobotSpec], Option]
"""Builds an option for a robot."""


def make_option(given: str | MakeOption, robot: RobotSpec, budget: int = BUDGET) -> Option:
    """Build an option for a robot.

    Args:
        given: a registered skill, which may then be started anywhere and is over at the goal; or a function
            that builds an option, whose own budget counts.
        robot: that it drives.
        budget: of a registered skill, control steps.

    Raises:
        UnknownNameError: if there is no such skill.
    """
    if callable(given):
        return given(robot)
    return Option(name=given, skill=hub().skills.create(given, robot), budget=budget)
