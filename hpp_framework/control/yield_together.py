"""Yield together: robots that meet come to rest where that just fulfils the task.

Robots stop as soon as braking fulfils it (:mod:`hpp_framework.control.stop_on_success`), and drive on as
before until then. They decide once a control step, so two that drive at each other at 1 m/s may drive 0.4 m
farther than they need, and take two steps more to stand. Here each drives on, for one step, at the least
speed that does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.config.settings import altered
from hpp_framework.control.stopping import StoppingPoints, motion
from hpp_framework.control.terminal_approach import ends_together, slowed
from hpp_framework.core.control import ControlContext, ControlLayer
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.task import Task
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import Observation
from hpp_framework.utils.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class YieldTogetherConfig:
    """How finely speeds are weighed.

    Attributes:
        choices: changes of speed that are weighed, from full deceleration to full acceleration.
        short: metres by which a robot may stop short of the prediction, so that it need not drive on once it
            has stopped.
    """

    choices: int = 17
    short: float = 0.02

    def __post_init__(self) -> None:
        if self.choices < 2 or not self.short >= 0:
            raise ConfigError(f"yield-together needs choices >= 2 and short >= 0, got {self}.")


class YieldTogether(ControlLayer):
    """Limits a robot's speed to what the task still asks for, counting on all others to do the same.

    All are taken to change their speeds in one proportion of what they can, the least after which braking
    fulfils the task. So robots need not agree which of them yields; a misjudgement is seen one step later.

    Args:
        robots: the team.
        agent: index of the robot.
        task: says what is fulfilled.
        config: how finely speeds are weighed.
    """

    def __init__(
        self, robots: Sequence[RobotSpec], agent: int, task: Task, config: YieldTogetherConfig | None = None
    ) -> None:
        self.config = config or YieldTogetherConfig()
        self.task = task
        self.agent = agent
        self.stopping = StoppingPoints(robots)
        self.top = torch.tensor([robot.drive.speed[1] for robot in robots])
        self.share = torch.linspace(-1, 1, self.config.choices)[:, None]
        self.useful = task.halts and ends_together(task, len(robots))

    def filter(
        self, observation: Observation, waypoint: Float[Tensor, "b 2"], command: Float[Tensor, "b 2"]
    ) -> Float[Tensor, "b 2"]:
        """Return the command, no faster than is enough."""
        del waypoint
        return slowed(command, self.enough(observation)) if self.useful else command

    def enough(self, observation: Observation) -> Float[Tensor, "b"]:
        """Return the speed in m/s that is enough; infinite where none within one step's reach is."""
        poses = observation.team_poses
        mean, turn = motion(observation)
        deceleration = self.stopping.deceleration.to(poses)
        speed = speeds_now(observation, mean, deceleration)[:, None]
        changed = (speed + self.share.to(poses) * deceleration * CONTROL_PERIOD).clamp(min=0)
        changed = changed.minimum(self.top.to(poses))
        while_changing = torch.where(
            changed > 0, (speed + changed) / 2 * CONTROL_PERIOD, speed.square() / (2 * deceleration)
        )
        distance = while_changing + changed.square() / (2 * deceleration) - self.config.short
        halts = (
            poses[:, None, :, :2] + distance[..., None] * self.stopping.direction(observation, turn)[:, None]
        )
        met = self.task.success(torch.cat([halts, poses[:, None, :, 2:].expand_as(halts[..., :1])], -1))
        least = met.to(torch.uint8).argmax(1)  # the first of those that are enough
        enough = changed[torch.arange(len(poses)), least, self.agent]
        return torch.where(met.any(1), enough, torch.inf)


def speeds_now(
    observation: Observation, mean: Float[Tensor, "b n"], acceleration: Float[Tensor, "n"]
) -> Float[Tensor, "b n"]:
    """Return all present speeds, m/s: the own one by odometry, the others' extrapolated from their poses.

    A mean over the last poses lags behind a robot that speeds up. The change of two means tells by how much;
    as poses are noisy, it counts up to what a robot can do.

    Args:
        observation: what the agent knows.
        mean: what :func:`~hpp_framework.control.stopping.motion` says of speeds, m/s.
        acceleration: of each robot, m/s^2.
    """
    places = observation.poses[..., :2]
    half = (places.shape[1] - 1) // 2
    if half == 0:
        return mean
    elapsed = half * CONTROL_PERIOD
    late = (places[:, -1] - places[:, -1 - half]).norm(dim=-1) / elapsed
    early = (places[:, -1 - half] - places[:, -1 - 2 * half]).norm(dim=-1) / elapsed
    most = acceleration.to(places) * elapsed / 2
    carried_on = (late + ((late - early) / 2).maximum(-most).minimum(most)).clamp(min=0)
    mine = torch.arange(places.shape[2], device=places.device) == observation.agent
    return torch.where(mine, mean, carried_on)


def yield_together(context: ControlContext) -> YieldTogether:
    """Build the layer."""
    config = altered(YieldTogetherConfig(), context.settings, "layer 'yield-together'")
    return YieldTogether(context.robots, context.agent, context.task, config)
