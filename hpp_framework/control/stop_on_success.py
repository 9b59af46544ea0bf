"""Stop on success: a robot stops where braking now leaves the team in success.

"The process stops when the agents are close to each other" (section 4.2 of the paper).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.config.settings import altered
from hpp_framework.control.stopping import StoppingPoints
from hpp_framework.core.control import ControlContext, ControlLayer
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.task import Task
from hpp_framework.core.types import Observation
from hpp_framework.utils.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class StopOnSuccessConfig:
    """How far beyond a goal skills are sent.

    Attributes:
        beyond: metres beyond a goal that all robots share; about the distance over which skills slow down.
            Since this layer stops the robot, slowing down before the goal would only cost time. 0 for none.
        arrived: metres from such a goal at which a robot is sent no farther: it waits there.
    """

    beyond: float = 1.0
    arrived: float = 0.6

    def __post_init__(self) -> None:
        if not self.beyond >= 0 or not self.arrived >= 0:
            raise ConfigError(f"stop-on-success needs beyond >= 0 and arrived >= 0, got {self}.")


class StopOnSuccess(ControlLayer):
    """Stops a robot, judged from observed poses, their recent change and odometry.

    Tasks in which robots are to keep moving are left alone.

    Args:
        task: the shared objective.
        robots: the team, for its deceleration.
        config: how far skills are sent.
    """

    def __init__(
        self, task: Task, robots: Sequence[RobotSpec], config: StopOnSuccessConfig | None = None
    ) -> None:
        self.task = task
        self.stopping = StoppingPoints(robots)
        self.config = config or StopOnSuccessConfig()

    def redirect(
        self, observation: Observation, goal: Float[Tensor, "b 2"], waypoint: Float[Tensor, "b 2"]
    ) -> Float[Tensor, "b 2"]:
        """Return a point straight on beyond a goal that all share; a robot's own target stays."""
        if not self.task.halts or not self.config.beyond:
            return waypoint
        towards = waypoint - observation.pose[:, :2]
        distance = towards.norm(dim=-1, keepdim=True)
        ahead = waypoint + (self.config.beyond * towards / distance).where(
            distance > self.config.arrived, 0.0
        )
        return torch.where((waypoint != goal).any(-1, keepdim=True), waypoint, ahead)

    def filter(
        self, observation: Observation, waypoint: Float[Tensor, "b 2"], command: Float[Tensor, "b 2"]
    ) -> Float[Tensor, "b 2"]:
        """Return no motion where the robot stops."""
        del waypoint
        if not self.task.halts:
            return command
        return command.masked_fill(self.stops(observation)[:, None], 0.0)

    def stops(self, observation: Observation) -> Bool[Tensor, "b"]:
        """Return whether to stop now."""
        poses = observation.team_poses
        halt = self.stopping(observation)
        return self.task.success(poses) | self.task.success(torch.cat([halt, poses[..., 2:]], -1))


def stop_on_success(context: ControlContext) -> StopOnSuccess:
    """Build the layer."""
    config = altered(StopOnSuccessConfig(), context.settings, "layer 'stop-on-success'")
    return StopOnSuccess(context.task, context.robots, config)
