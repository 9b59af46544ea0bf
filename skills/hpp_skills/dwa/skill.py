"""The dynamic window approach (Fox, Burgard and Thrun, 1997) on the raw scan, for any robot."""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core import geometry
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.skill import Skill
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import Observation
from hpp_framework.utils.kernels import vectors, wp
from hpp_framework.utils.thread_pool import Job, ThreadPool
from hpp_skills.dwa import window_kernels
from hpp_skills.dwa.config import DwaConfig


class DynamicWindow(Skill):
    """Picks the best of the commands that can be reached in one control period and stopped from in time.

    Of each command the arc is imagined that it leads to. Its clearance is how far the footprint may drive
    along it before it meets a point of the scan. Commands that the robot could not brake from within that are
    out; of the others, the weighted sum of heading, progress, clearance and speed decides.

    Two things go past Fox et al., who steer for the goal and see all around. Where the path to the goal is
    blocked, the robot heads for the free direction nearest to it. And points that have left the field of view
    within the observation's history still count, if they are close. The robot drives forward only; whatever
    else it does not see counts as free. It has no map, so it may stay in dead
    ends and behind long walls across the path.

    Args:
        robot: whose drive limits, footprint and lidar count.
        config: sizes and weights.
        threads: that share out the batch on the CPU, or None for one per core that this process may use.
    """

    def __init__(
        self, robot: RobotSpec, config: DwaConfig | None = None, *, threads: int | None = None
    ) -> None:
        self.config = config or DwaConfig()
        self._window = _window(robot, self.config)
        self._threads = ThreadPool(threads)

    @torch.no_grad()
    def act(self, observation: Observation, goal: Float[Tensor, "b 2"]) -> Float[Tensor, "b 2"]:
        """Return commands [v in m/s, omega in rad/s]; both zero within ``goal_radius`` of the goal."""
        out = torch.empty_like(observation.velocity)
        self._threads.run(self._jobs(observation, goal.to(out), out))
        return out

    def _jobs(self, observation: Observation, goal: Tensor, out: Tensor) -> list[Job]:
        """Return the launches, slice by slice of the batch; ``out`` receives the commands."""
        size, _, beams = observation.scans.shape
        commands = self.config.speeds * self.config.turns + 1
        device = wp.device_from_torch(out.device)

        scans = wp.from_torch(observation.scans.contiguous())
        poses = vectors(observation.poses[:, :, observation.agent])
        velocities = vectors(observation.velocity)
        goals = vectors(geometry.to_frame(observation.pose, goal))
        points = wp.from_torch(out.new_empty(size, 2 * beams, 3), dtype=wp.vec3)
        counts = wp.from_torch(torch.empty(size, dtype=torch.int32, device=out.device))
        targets, scores = vectors(torch.empty_like(out)), wp.from_torch(out.new_empty(size, commands))
        window = self._window

        def drive(start: int, stop: int) -> None:
            count = stop - start
            for kernel, dim, inputs in (
                (
                    window_kernels.look,
                    count,
                    [scans, poses, velocities, goals, window, points, counts, targets],
                ),
                (
                    window_kernels.rate,
                    (count, commands),
                    [velocities, goals, targets, points, counts, window, scores],
                ),
                (window_kernels.choose, count, [velocities, goals, scores, window, wrapped]),
            ):
                wp.launch(kernel, dim=dim, inputs=[start, *inputs], device=device)

        wrapped = vectors(out)
        slices = self._threads.slices(size) if out.device.type == "cpu" else [(0, size)]
        return [partial(drive, start, stop) for start, stop in slices]


def _window(robot: RobotSpec, config: DwaConfig) -> Any:
    """Return the numbers that the kernels need."""
    out, drive, lidar = window_kernels.Window(), robot.drive, robot.lidar
    angles = lidar.angles()
    out.speed_max, out.turn_rate = drive.speed[1], drive.turn_rate
    out.acceleration, out.turn_acceleration = drive.acceleration, drive.turn_acceleration
    out.radius, out.mount = robot.footprint_radius, wp.vec3(*lidar.mount)
    out.first_angle, out.angle_step = float(angles[0]), float(angles[1] - angles[0])
    out.field_of_view, out.max_range = lidar.field_of_view, lidar.max_range
    out.period = CONTROL_PERIOD
    braking = drive.speed[1] * max(
        drive.speed[1] / drive.acceleration, drive.turn_rate / drive.turn_acceleration
    )
    out.horizon = max(drive.speed[1] * config.look_ahead, braking / 2, config.free_path)
    for name, value in asdict(config).items():
        setattr(out, name, value)
    return out


def load(robot: RobotSpec, config: DwaConfig | None = None) -> DynamicWindow:
    """Return the skill for a robot, with the tuned configuration unless given another."""
    return DynamicWindow(robot, config)
