"""A classical skill, by hand: to the free direction nearest to the goal's, slowly where it is narrow."""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core import geometry
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.skill import Skill
from hpp_framework.core.types import Observation

SIGHT = 1.5
"""How far a direction must be free, in metres."""
MARGIN = 0.1
"""Gap to obstacles, in metres."""
ARRIVED = 0.2
"""Distance from the goal at which the robot rests, in metres."""
EVERY = 6
"""Beams between the directions that it chooses from."""
ASKEW = 0.7
"""Angle to its direction, in radians, from which on the robot turns in place."""


class SampleSkill(Skill):
    """Looks a little ahead and remembers nothing.

    Args:
        robot: what it drives; any drive, any lidar.
    """

    def __init__(self, robot: RobotSpec) -> None:
        self.drive = robot.drive
        self.width = robot.footprint_radius + MARGIN
        beams = torch.from_numpy(robot.lidar.angles()).float() + robot.lidar.mount[2]
        self.directions = beams[::EVERY]
        apart = beams - self.directions[:, None]
        self.aside, self.ahead = apart.sin().abs(), apart.cos()

    def act(self, observation: Observation, goal: Float[Tensor, "b 2"]) -> Float[Tensor, "b 2"]:
        """Return commands [v in m/s, omega in rad/s]."""
        distance, bearing = geometry.polar(observation.pose, goal.to(observation.pose)).unbind(-1)
        free = self._free(observation.scan)
        heading = self._heading(free, distance, bearing)
        # as fast as half its brakes could stop it in what is free straight ahead
        room = (self._towards(free, torch.zeros_like(bearing)) - self.width).clamp(min=0.0)
        speed = (self.drive.acceleration * torch.minimum(room, distance)).sqrt()
        speed = speed.clamp(max=self.drive.speed[1]) * (1 - heading.abs() / ASKEW).clamp(min=0.0)
        turn = (self.drive.turn_acceleration * heading.abs()).sqrt() * heading.sign()
        turn = turn.clamp(-self.drive.turn_rate, self.drive.turn_rate)
        return torch.where((distance < ARRIVED)[:, None], 0.0, torch.stack([speed, turn], -1))

    def _free(self, scan: Float[Tensor, "b k"]) -> Float[Tensor, "b d"]:
        """Return how far the robot, as wide as it is, can go in each direction, in metres."""
        in_the_way = (scan[:, None] * self.aside < self.width) & (self.ahead > 0)
        return torch.where(in_the_way, scan[:, None] * self.ahead, torch.inf).amin(-1)

    def _heading(
        self, free: Float[Tensor, "b d"], distance: Float[Tensor, "b"], bearing: Float[Tensor, "b"]
    ) -> Float[Tensor, "b"]:
        """Return the direction to go from straight ahead: the goal's if that is free or out of view."""
        off = geometry.wrap_angle(self.directions - bearing[:, None]).abs() / math.pi
        wanted = distance.clamp(max=SIGHT)
        # of directions that are all blocked, the freest
        blocked = (free < wanted[:, None]) * (2 - free.clamp(max=SIGHT) / SIGHT)
        best = self.directions[(off + blocked).argmin(1)]
        clear = self._towards(free, bearing) >= wanted
        out_of_view = bearing.abs() > self.directions.abs().max()
        return torch.where(clear | out_of_view, bearing, best)

    def _towards(self, free: Float[Tensor, "b d"], angle: Float[Tensor, "b"]) -> Float[Tensor, "b"]:
        """Return how free the direction nearest to an angle is."""
        nearest = (self.directions - angle[:, None]).abs().argmin(1)
        return free.gather(1, nearest[:, None])[:, 0]


def sample_skill(robot: RobotSpec) -> SampleSkill:
    """Build the skill for a robot."""
    return SampleSkill(robot)
