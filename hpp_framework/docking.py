"""Docking: the last metres into a gathering, where a skill made for obstacles would circle.

To a skill that drives by lidar, teammates that have arrived are obstacles around its goal: it swerves, drives
round them and never arrives. What is known of them is better than a scan: where they are, and how wide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.geometry import polar, to_frame
from hpp_framework.guard import Guard
from hpp_framework.robot import RobotSpec
from hpp_framework.sensing import seen_points
from hpp_framework.sim.simulator import CONTROL_PERIOD
from hpp_framework.types import Observation

NEAR = 1.5
"""Metres from its spot within which a robot docks."""
EXACT = 0.03
"""Metres at which it is there."""
GAP = 0.06
"""Metres that it keeps from teammates."""
TURN = 2.5
"""Radians a second for a radian that the spot lies aside."""
STRAIGHT = 0.5
"""Radians aside from which on it turns on the spot."""
CAREFUL = 0.5
"""Share of the deceleration that it counts on."""
CHANGED = 0.05
"""m/s and rad/s by which a guard changes a command that it objects to."""


class Docking:
    """Takes over from the skill near a spot: turns to it, drives straight, and waits for who is in the way.

    Where something else than a teammate is in the way, the skill goes on: that is what it is made for.

    Args:
        robots: the team.
        agent: index of the robot.
        guard: tells what is in the way.
    """

    def __init__(self, robots: Sequence[RobotSpec], agent: int, guard: Guard) -> None:
        self.robot = robots[agent]
        self.guard = guard
        self.others = [index for index in range(len(robots)) if index != agent]
        radii = torch.tensor([robots[index].footprint_radius for index in self.others])
        self.apart = radii + self.robot.footprint_radius + GAP

    def __call__(
        self, observation: Observation, spot: Float[Tensor, "b 2"], command: Float[Tensor, "b 2"]
    ) -> Float[Tensor, "b 2"]:
        """Return the command that docks where the robot is near its spot, else the given one.

        Args:
            observation: what the agent knows.
            spot: where to, world frame, metres.
            command: of the skill.
        """
        near = (observation.pose[:, :2] - spot).norm(dim=-1) < NEAR
        if not bool(near.any()):
            return command
        wanted = self.straight(observation, spot)
        allowed = self.guard(observation, wanted)
        free = ((allowed - wanted).abs() < CHANGED).all(-1) & ~self._blocked(observation, spot)
        return torch.where((near & free)[:, None], wanted, command)

    def straight(self, observation: Observation, spot: Float[Tensor, "b 2"]) -> Float[Tensor, "b 2"]:
        """Return the command [v, omega] towards a spot, as slow as teammates ahead ask for."""
        drive = self.robot.drive
        distance, aside = polar(observation.pose, spot).unbind(-1)
        there = distance < EXACT
        turn = (TURN * aside).clamp(-drive.turn_rate, drive.turn_rate)
        speed = self._stoppable(distance.minimum(self._room(observation))).clamp(max=drive.speed[1])
        speed = speed * (1 - aside.abs() / STRAIGHT).clamp(min=0)
        return torch.stack([speed, turn], -1).masked_fill(there[:, None], 0.0)

    def _blocked(self, observation: Observation, spot: Float[Tensor, "b 2"]) -> Bool[Tensor, "b"]:
        """Return whether the scan shows something on the straight way to the spot that is no teammate."""
        # what is seen now counts, not what stood there before
        points, still = seen_points(replace(observation, keyframes=None), self.robot.lidar)
        distance, bearing = polar(observation.pose, spot).unbind(-1)
        towards = torch.cat([observation.pose[:, :2], (observation.pose[:, 2] + bearing)[:, None]], -1)
        ahead, aside = to_frame(towards[:, None], points).unbind(-1)
        reach = self.robot.footprint_radius + GAP
        on_way = (ahead > 0) & (ahead < distance[:, None] + reach) & (aside.abs() < reach)
        return (on_way & still).any(-1)

    def _room(self, observation: Observation) -> Float[Tensor, "b"]:
        """Return how far the robot can drive on before it is too near a teammate, metres."""
        others = observation.team_poses[:, self.others, :2]
        ahead, aside = to_frame(observation.pose[:, None], others).unbind(-1)
        apart = self.apart.to(ahead)
        blocks = (ahead > 0) & (aside.abs() < apart)
        room = ahead - (apart.square() - aside.square()).clamp(min=0).sqrt()
        return torch.where(blocks, room.clamp(min=0), torch.inf).amin(-1)

    def _stoppable(self, room: Float[Tensor, "b"]) -> Float[Tensor, "b"]:
        """Return the speed from which the robot stops within a distance, one control period from now."""
        deceleration = CAREFUL * self.robot.drive.acceleration
        lost = deceleration * CONTROL_PERIOD
        return (lost**2 + 2 * deceleration * room).sqrt() - lost
