"""Dead reckoning: other robots go on as they were last heard to, until the next message comes."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.config.settings import altered
from hpp_framework.core import geometry
from hpp_framework.core.estimator import Estimate, Estimator, EstimatorContext, Reading
from hpp_framework.core.robot import Lidar
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.perception.estimators.raw import cleaned
from hpp_framework.utils.validation import NonNegative, Several, validated


@validated
class DeadReckoningConfig:
    """How other robots are moved on.

    Attributes:
        heard: poses of another robot that came last, from which its motion is read.
        ahead: seconds by which its last pose is moved on, at most: robots turn and stop.
    """

    heard: Several = 3
    ahead: NonNegative = 1.0


class DeadReckoning(Estimator):
    """Moves late poses on; the robot's own pose is the newest that came.

    Args:
        agent: index of the robot in its team.
        lidar: of the robot.
        config: how others are moved on.
    """

    def __init__(self, agent: int, lidar: Lidar, config: DeadReckoningConfig | None = None) -> None:
        self.agent = agent
        self.lidar = lidar
        self.config = config or DeadReckoningConfig()

    def reset(self, reading: Reading) -> Estimate:
        """Begin as if no robot had moved before."""
        count = self.config.heard
        self._clock = 0.0
        self._poses = reading.poses[:, None].repeat(1, count, 1, 1)
        before = torch.arange(1.0 - count, 1.0)[:, None].to(reading.ages) * CONTROL_PERIOD
        self._stamps = before - reading.ages[:, None]
        return self._estimate(reading)

    def update(self, reading: Reading, command: Float[Tensor, "b 2"]) -> Estimate:
        """Return the team as it would be now."""
        del command
        self._clock += CONTROL_PERIOD
        fresh = reading.fresh[:, None]
        poses = torch.cat([self._poses[:, 1:], reading.poses[:, None]], 1)
        stamps = torch.cat([self._stamps[:, 1:], self._clock - reading.ages[:, None]], 1)
        self._poses = torch.where(fresh[..., None], poses, self._poses)
        self._stamps = torch.where(fresh, stamps, self._stamps)
        return self._estimate(reading)

    def restart(self, reading: Reading, robots: Bool[Tensor, "b n"]) -> Estimate:
        """Let some robots be as if they had not moved."""
        self._poses = torch.where(robots[:, None, :, None], reading.poses[:, None], self._poses)
        return self._estimate(reading)

    def _estimate(self, reading: Reading) -> Estimate:
        last, before = self._poses[:, -1], self._poses[:, 0]
        change = last - before
        change = torch.cat([change[..., :2], geometry.wrap_angle(change[..., 2:])], -1)
        passed = (self._stamps[:, -1] - self._stamps[:, 0]).clamp(min=CONTROL_PERIOD)
        age = (self._clock - self._stamps[:, -1]).clamp(0, self.config.ahead)
        reckoned = last + change * (age / passed)[..., None]
        mine = torch.arange(reading.poses.shape[1], device=last.device) == self.agent
        late = (age > 0) & ~mine
        poses = torch.where(late[..., None], reckoned, reading.poses)
        return Estimate(poses, reading.velocity, cleaned(reading.scan, self.lidar), ages=reading.ages)


def dead_reckoning(context: EstimatorContext) -> DeadReckoning:
    """Build the estimator."""
    config = altered(DeadReckoningConfig(), context.settings, "estimator 'dead-reckoning'")
    return DeadReckoning(context.agent, context.robots[context.agent].lidar, config)
