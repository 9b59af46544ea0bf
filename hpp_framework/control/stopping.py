"""Where robots that brake now come to rest: from 1 m/s a robot needs more than a metre to stop."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.geometry import wrap_angle
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import Observation

SPEED_STEPS = 3
"""Control steps over which observed motion is averaged."""


class StoppingPoints:
    """Predicts where all robots stop: at full deceleration, in the direction that the present turn leads to.

    An agent takes its own motion from odometry, and that of the others from their poses.

    Args:
        robots: the team, for its deceleration.
    """

    def __init__(self, robots: Sequence[RobotSpec]) -> None:
        self.deceleration = torch.tensor([robot.drive.acceleration for robot in robots])
        self.turn_deceleration = torch.tensor([robot.drive.turn_acceleration for robot in robots])

    def __call__(self, observation: Observation) -> Float[Tensor, "b n 2"]:
        """Return where each robot comes to rest, world frame, metres."""
        speed, turn = motion(observation)
        distance = speed.square() / (2 * self.deceleration.to(speed))
        return observation.team_poses[..., :2] + distance[..., None] * self.direction(observation, turn)

    def direction(self, observation: Observation, turn: Float[Tensor, "b n"]) -> Float[Tensor, "b n 2"]:
        """Return the unit vectors along which the robots stop, world frame.

        Args:
            observation: what the agent knows.
            turn: turn rates of all robots, rad/s, which end at full deceleration.
        """
        heading = observation.team_poses[..., 2]
        heading = heading + turn * turn.abs() / (2 * self.turn_deceleration.to(turn))
        return torch.stack([heading.cos(), heading.sin()], -1)


def motion(observation: Observation) -> tuple[Float[Tensor, "b n"], Float[Tensor, "b n"]]:
    """Return speed (m/s) and turn rate (rad/s) of all robots."""
    if observation.velocities is not None:
        return observation.velocities[..., 0], observation.velocities[..., 1]
    poses = observation.team_poses
    steps = min(SPEED_STEPS, observation.poses.shape[1] - 1)
    if steps == 0:
        speed, turn = torch.zeros_like(poses[..., 0]), torch.zeros_like(poses[..., 0])
    else:
        before = observation.poses[:, -1 - steps]
        elapsed = steps * CONTROL_PERIOD
        speed = (poses - before)[..., :2].norm(dim=-1) / elapsed
        turn = wrap_angle(poses[..., 2] - before[..., 2]) / elapsed
    own = torch.arange(poses.shape[1]) == observation.agent
    velocity = observation.velocity[:, None]
    return torch.where(own, velocity[..., 0], speed), torch.where(own, velocity[..., 1], turn)
