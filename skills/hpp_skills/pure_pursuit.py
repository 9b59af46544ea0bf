"""Pure pursuit, the simplest skill: drives along the circle through the goal and avoids nothing."""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core import geometry
from hpp_framework.core.robot import DriveLimits, RobotSpec
from hpp_framework.core.skill import Skill
from hpp_framework.core.types import Observation


class PurePursuit(Skill):
    """Turns until the goal is ahead, drives there, and rests within 0.2 m of it."""

    def __init__(self, drive: DriveLimits) -> None:
        self.drive = drive

    def act(self, observation: Observation, goal: Float[Tensor, "b 2"]) -> Float[Tensor, "b 2"]:
        """Return commands [v in m/s, omega in rad/s] with curvature 2y / L^2 (Coulter, 1992)."""
        distance, bearing = geometry.polar(observation.pose, goal.to(observation.pose)).unbind(-1)
        # of the speeds that it can stop from in time, one that half the braking would do for
        speed = torch.sqrt(self.drive.acceleration * distance).clamp(max=self.drive.speed[1])
        on_the_circle = speed * 2 * bearing.sin() / distance.clamp(min=0.1)
        in_place = torch.sqrt(self.drive.turn_acceleration * bearing.abs()) * bearing.sign()
        ahead = bearing.abs() < math.pi / 4
        turn = torch.where(ahead, on_the_circle, in_place)
        turn = turn.clamp(-self.drive.turn_rate, self.drive.turn_rate)
        command = torch.stack([torch.where(ahead, speed, 0.0), turn], -1)
        return torch.where((distance < 0.2)[:, None], 0.0, command)


def load(robot: RobotSpec) -> PurePursuit:
    """Return the skill for a robot."""
    return PurePursuit(robot.drive)
