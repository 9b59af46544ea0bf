"""Control layers: what stands between a skill and the wheels.

A stack of layers wraps a skill as Gymnasium's wrappers wrap an environment. After each plan the layers may
move the waypoint, in each control step they may replace the command; both in the order of the stack::

    for layer in layers:
        waypoint = layer.redirect(observation, goal, waypoint)  # once after each plan
    for layer in layers:
        command = layer.filter(observation, waypoint, command)  # every control step

Which layers an agent has is part of the experiment, the same for every planner that is compared. A layer
reads observations; it never asks which planner it serves.
"""

from __future__ import annotations

from abc import ABC
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.task import Task
from hpp_framework.core.types import Observation


class ControlLayer(ABC):  # noqa: B024  # both hooks have a default: a layer overrides the one that it needs
    """One layer of a robot's control stack; stateless, batched over episodes."""

    def redirect(
        self, observation: Observation, goal: Float[Tensor, "b 2"], waypoint: Float[Tensor, "b 2"]
    ) -> Float[Tensor, "b 2"]:
        """Return where the skill is sent, world frame, metres. Called once after each plan.

        Args:
            observation: what the agent knows.
            goal: that the planner chose for the whole team.
            waypoint: where the skill is sent so far: the goal, the robot's own target, or on the path there.
        """
        del observation, goal
        return waypoint

    def filter(
        self, observation: Observation, waypoint: Float[Tensor, "b 2"], command: Float[Tensor, "b 2"]
    ) -> Float[Tensor, "b 2"]:
        """Return the command [v in m/s, omega in rad/s] to send instead. Called every control step.

        Args:
            observation: what the agent knows.
            waypoint: where the skill is sent, world frame, metres.
            command: of the skill, or of the layer before.
        """
        del observation, waypoint
        return command


class ControlStack(ControlLayer):
    """Layers one after another, from the skill outwards.

    Args:
        layers: in their order; none leaves waypoints and commands as they are.
    """

    def __init__(self, layers: Sequence[ControlLayer] = ()) -> None:
        self.layers = tuple(layers)

    def redirect(
        self, observation: Observation, goal: Float[Tensor, "b 2"], waypoint: Float[Tensor, "b 2"]
    ) -> Float[Tensor, "b 2"]:
        """Return what all layers make of a waypoint."""
        for layer in self.layers:
            waypoint = layer.redirect(observation, goal, waypoint)
        return waypoint

    def filter(
        self, observation: Observation, waypoint: Float[Tensor, "b 2"], command: Float[Tensor, "b 2"]
    ) -> Float[Tensor, "b 2"]:
        """Return what all layers make of a command."""
        for layer in self.layers:
            command = layer.filter(observation, waypoint, command)
        return command


@dataclass(frozen=True, kw_only=True)
class ControlContext:
    """What the factory of a layer is told.

    Attributes:
        robots: the team, in team order.
        agent: index of the robot that is controlled.
        task: the shared objective.
        settings: that differ from the layer's own, by dotted name, e.g. ``{"near": 1.2}``.
    """

    robots: Sequence[RobotSpec]
    agent: int
    task: Task
    settings: Mapping[str, Any] = field(default_factory=lambda: dict[str, Any]())

    @property
    def robot(self) -> RobotSpec:
        """The robot that is controlled."""
        return self.robots[self.agent]
