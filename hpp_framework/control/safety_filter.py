"""The safety filter keeps a robot off what it sees and what it saw a moment ago, whatever its skill wants.

A lidar at the front sees nothing at the robot's sides, where it brushes what it passes closely while turning.
"""

from __future__ import annotations

from typing import Annotated, Any

import torch
from jaxtyping import Float
from pydantic import Field
from torch import Tensor

from hpp_framework.config.settings import altered
from hpp_framework.control import safety_kernels
from hpp_framework.core.control import ControlContext, ControlLayer
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import Observation
from hpp_framework.perception.sensing import BODY, KEYFRAMES
from hpp_framework.utils.kernels import vectors, wp
from hpp_framework.utils.validation import NonNegative, validated

POINTS = 512
"""Points that are heeded, at most."""

Remembered = Annotated[int, Field(strict=True, ge=0, le=KEYFRAMES)]
"""A number of keyframes."""


@validated
class SafetyFilterConfig:
    """How careful a safety filter is.

    Attributes:
        margin: metres to keep from what is seen; what is hidden behind a thin leg's near side is as near. It
            grows by the distance that the robot drives in the jitter of its commands.
        memory: keyframes heeded beside the history, one per second.
        way_out: metres that must be free before a robot that stands before something drives off.
    """

    margin: NonNegative = 0.025
    memory: Remembered = 6
    way_out: NonNegative = 0.2


class SafetyFilter(ControlLayer):
    """Corrects commands after which a robot could no longer stop before it touches something.

    A command is predicted for one control period under the drive's limits, then a full stop along one of four
    arcs: turning on, straightening, turning hard to either side. If the footprint keeps off all points on one
    of them, the command is left as it is. Otherwise the nearest of the reachable commands, no faster than
    asked for, takes its place. A robot that is blocked and is told to drive turns to the nearest heading in
    which it can. Points come from the observation alone: the present scan, and what earlier ones
    saw that is out of view now. Other robots count as free: agents see those by their poses.

    Args:
        robot: whose drive limits, footprint and lidar count.
        config: how careful it is.
    """

    def __init__(self, robot: RobotSpec, config: SafetyFilterConfig | None = None) -> None:
        self.config = config or SafetyFilterConfig()
        self._limits = _limits(robot, self.config)
        angles = torch.from_numpy(robot.lidar.angles()).float()
        self._beams = torch.stack([angles.cos(), angles.sin()], -1)

    def filter(
        self, observation: Observation, waypoint: Float[Tensor, "b 2"], command: Float[Tensor, "b 2"]
    ) -> Float[Tensor, "b 2"]:
        """Return commands [v, omega] that the robot can stop after in time."""
        del waypoint
        return self.corrected(observation, command)

    def corrected(self, observation: Observation, command: Float[Tensor, "b 2"]) -> Float[Tensor, "b 2"]:
        """Return the nearest commands [v, omega] that the robot can stop after in time.

        Args:
            observation: what the agent knows.
            command: wanted.
        """
        poses, scans = observation.poses, observation.scans
        earlier, memory = observation.keyframes, self.config.memory
        if earlier is not None and memory:
            poses = torch.cat([earlier.poses[:, -memory:], poses], 1)
            scans = torch.cat([earlier.scans[:, -memory:], scans], 1)
        size, device = len(command), wp.device_from_torch(command.device)
        velocity = vectors(observation.velocity)
        points = wp.from_torch(command.new_empty(size, POINTS, 3), dtype=wp.vec3)
        counts = wp.from_torch(torch.empty(size, dtype=torch.int32, device=command.device))
        corrected = torch.empty_like(command)
        jitter = command.new_zeros(size) if observation.jitter is None else observation.jitter.contiguous()
        wp.launch(
            safety_kernels.gather,
            dim=size,
            inputs=[
                wp.from_torch(scans.contiguous()), vectors(self._beams.to(scans)), vectors(poses),
                observation.agent, velocity, wp.from_torch(jitter), self._limits, points, counts,
            ],
            device=device,
        )  # fmt: skip
        wp.launch(
            safety_kernels.correct,
            dim=size,
            inputs=[vectors(command), velocity, points, counts, self._limits, vectors(corrected)],
            device=device,
        )
        return corrected


def _limits(robot: RobotSpec, config: SafetyFilterConfig) -> Any:
    """Return the numbers that the kernels need."""
    out, drive, lidar = safety_kernels.Limits(), robot.drive, robot.lidar
    out.speed_min, out.speed_max = drive.speed
    out.turn_rate = drive.turn_rate
    out.acceleration, out.turn_acceleration = drive.acceleration, drive.turn_acceleration
    out.radius, out.mount = robot.footprint_radius, wp.vec3(*lidar.mount)
    out.half_view, out.max_range = lidar.field_of_view / 2, lidar.max_range
    out.body, out.period = BODY, CONTROL_PERIOD
    out.margin, out.way_out = config.margin, config.way_out
    return out


def safety_filter(context: ControlContext) -> SafetyFilter:
    """Build the layer."""
    config = altered(SafetyFilterConfig(), context.settings, "layer 'safety-filter'")
    return SafetyFilter(context.robot, config)
