"""Separation: robots slow down early enough to stop before they touch each other.

A safety filter knows what stands; teammates move, and where they go is not quite known. Each robot counts on
all others to brake as it would itself: for one control period they may go on, or speed up, and they may turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.config.settings import altered
from hpp_framework.control import separation_kernels as kernels
from hpp_framework.control.stopping import motion
from hpp_framework.core.control import ControlContext, ControlLayer
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import Observation
from hpp_framework.utils.kernels import vectors, wp
from hpp_framework.utils.validation import NonNegative, validated


@validated
class SeparationConfig:
    """How careful robots are of each other.

    Attributes:
        gap: metres to keep between footprints.
        sureness: standard deviations of what is estimated of a teammate that are counted on.
        stands: m/s below which a teammate is taken to stand.
    """

    gap: NonNegative = 0.15
    sureness: NonNegative = 1.5
    stands: NonNegative = 0.1


class Separation(ControlLayer):
    """Slows a robot down before teammates; never turns it.

    Args:
        robots: the team.
        agent: index of the robot.
        config: how careful it is.
    """

    def __init__(
        self, robots: Sequence[RobotSpec], agent: int, config: SeparationConfig | None = None
    ) -> None:
        self.config = config or SeparationConfig()
        self.agent = agent
        radii = torch.tensor([robot.footprint_radius for robot in robots])
        self._keep = radii + radii[agent] + self.config.gap
        self._deceleration = torch.tensor([robot.drive.acceleration for robot in robots])
        self._top = torch.tensor([robot.drive.speed[1] for robot in robots])
        drive, own = robots[agent].drive, kernels.Self()
        own.acceleration, own.turn_acceleration = drive.acceleration, drive.turn_acceleration
        own.turn_rate, own.period = drive.turn_rate, CONTROL_PERIOD
        own.speed_min, own.speed_max = drive.speed
        self._own = own

    def filter(
        self, observation: Observation, waypoint: Float[Tensor, "b 2"], command: Float[Tensor, "b 2"]
    ) -> Float[Tensor, "b 2"]:
        """Return the command, no faster than teammates allow."""
        del waypoint
        size, count = observation.team_poses.shape[:2]
        if count == 1:
            return command
        slowed = torch.empty_like(command)
        device = wp.device_from_torch(command.device)
        wp.launch(
            kernels.slow_down,
            dim=size,
            inputs=[
                self.agent, vectors(command), vectors(observation.velocity), vectors(observation.team_poses),
                wp.from_torch(self._motions(observation), dtype=wp.vec4),
                wp.from_torch(self._keep.to(command).expand(size, count).contiguous()),
                wp.from_torch(self._deceleration.to(command)), self._own,
                wp.empty((size, count), dtype=cast("Any", kernels.Other), device=device), vectors(slowed),
            ],
            device=device,
        )  # fmt: skip
        return slowed

    def _motions(self, observation: Observation) -> Float[Tensor, "b n 4"]:
        """Return speed (m/s), turn rate (rad/s), and what heading (rad) and position (m) may be off."""
        speed, turn = motion(observation)
        # it may speed up before it brakes
        most = speed + self._deceleration.to(speed) * CONTROL_PERIOD
        off, apart = torch.zeros_like(speed), torch.zeros_like(speed)
        if observation.std is not None:
            apart, off, pace = (self.config.sureness * observation.std).unbind(-1)
            most = most + pace
        most = most.minimum(self._top.to(speed)).maximum(speed)
        return torch.stack([torch.where(speed > self.config.stands, most, 0.0), turn, off, apart], -1)


def separation(context: ControlContext) -> Separation:
    """Build the layer."""
    config = altered(SeparationConfig(), context.settings, "layer 'separation'")
    return Separation(context.robots, context.agent, config)
