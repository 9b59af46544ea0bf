"""The batch simulator: thousands of planar worlds at once, on CPU or CUDA (Warp)."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
import warp as wp
from jaxtyping import Bool, Float, Int
from torch import Tensor

from hpp_framework.robot import RobotSpec
from hpp_framework.sim import batch_kernels
from hpp_framework.sim.simulator import CONTROL_PERIOD, SUBSTEPS, Simulator
from hpp_framework.types import State
from hpp_framework.worlds.slicing import PlanarMap, planar_map
from hpp_framework.worlds.world import World

wp.config.log_level = wp.LOG_ERROR


def _initialise_warp() -> None:
    """Start Warp without the line that its native part prints on machines that have no CUDA."""
    sys.stderr.flush()
    kept = os.dup(2)
    silent = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(silent, 2)
        wp.init()
    finally:
        os.dup2(kept, 2)
        os.close(silent)
        os.close(kept)


_initialise_warp()


class BatchSimulator(Simulator):
    """Disc robots among segments and discs; see :mod:`hpp_framework.sim.batch_kernels` for the physics.

    Args:
        robots: the team.
        device: ``"cpu"`` or ``"cuda"``.
    """

    def __init__(self, robots: Sequence[RobotSpec], *, device: str = "cpu") -> None:
        super().__init__(robots)
        self.device = torch.device(device)
        self._warp_device = wp.device_from_torch(self.device)
        self._robots: Any = wp.array(
            [_robot_struct(robot) for robot in robots], dtype=batch_kernels.Robot, device=self._warp_device
        )
        self._directions: Any = wp.array(
            _directions(robots, self.beams), dtype=wp.vec2, device=self._warp_device
        )
        self._pool: tuple[World, ...] = ()
        self._geometry: Any = None

    def reset(self, worlds: Sequence[World], poses: Float[Tensor, "b n 3"]) -> State:
        """Start one episode a world; equal worlds share their geometry."""
        self.check_poses(worlds, poses)
        pool = tuple(dict.fromkeys(worlds))
        place = {world: index for index, world in enumerate(pool)}
        self.load(pool, episodes=len(worlds))
        everyone = torch.ones(len(worlds), len(self.robots), dtype=torch.bool)
        return self.place(
            torch.tensor([place[world] for world in worlds], dtype=torch.int32), everyone, poses
        )

    def load(self, pool: Sequence[World], *, episodes: int) -> None:
        """Hold a pool of worlds and room for a number of episodes; follow with :meth:`place`.

        Args:
            pool: worlds that :meth:`place` refers to by index.
            episodes: how many run side by side.
        """
        self._pool = tuple(pool)
        heights = [robot.lidar.height for robot in self.robots]
        tallest = max(robot.height for robot in self.robots)
        self._geometry = _pack(
            [planar_map(world, lidar_heights=heights, body_height=tallest) for world in pool],
            self._warp_device,
        )
        shape = (episodes, len(self.robots))

        def zeros(*trailing: int, dtype: torch.dtype = torch.float32) -> Tensor:
            return torch.zeros(*shape, *trailing, dtype=dtype, device=self.device)

        self._state = State(
            poses=zeros(3), velocities=zeros(2), scans=zeros(self.beams), collided=zeros(dtype=torch.bool)
        )
        self._world_index = torch.zeros(episodes, dtype=torch.int32, device=self.device)
        self._commands = zeros(2)
        wrap = wp.from_torch
        self._near: Any = wp.zeros(shape, dtype=int, device=self._warp_device)
        self._before: Any = wp.zeros(shape, dtype=wp.vec2, device=self._warp_device)
        self._arrays: list[Any] = [
            wrap(x)
            for x in (self._state.poses, self._state.velocities, self._state.scans, self._state.collided)
        ]
        self._warp_commands: Any = wrap(self._commands)
        self._warp_index: Any = wrap(self._world_index)

    def place(
        self,
        world_index: Int[Tensor, "b"],
        robots: Bool[Tensor, "b n"],
        poses: Float[Tensor, "b n 3"],
    ) -> State:
        """Put the chosen robots at rest at new poses, episodes into worlds of the pool, and cast all lidars.

        Args:
            world_index: world of each episode, as an index into the pool.
            robots: which robots to move.
            poses: where to; rows that are not chosen are ignored.
        """
        self._world_index.copy_(world_index)
        chosen = robots.to(self.device)
        self._state.poses.copy_(
            torch.where(chosen[..., None], poses.to(self._state.poses), self._state.poses)
        )
        self._state.velocities.masked_fill_(chosen[..., None], 0.0)
        self._state.collided.masked_fill_(chosen, value=False)
        self._cast()
        return self.state()

    def step(self, commands: Float[Tensor, "b n 2"]) -> State:
        """Drive for one control period and cast all lidars."""
        self.check_commands(commands, len(self._world_index))
        self._commands.copy_(commands)
        poses, velocities, _, collided = self._arrays
        wp.launch(
            batch_kernels.drive,
            dim=len(self._world_index),
            inputs=[
                self._warp_commands, self._robots, self._geometry, self._warp_index, CONTROL_PERIOD, SUBSTEPS,
                poses, velocities, collided, self._near, self._before,
            ],
            device=self._warp_device,
        )  # fmt: skip
        self._cast()
        return self.state()

    def state(self) -> State:
        """Return a copy of the current state; it shares no memory with the simulator."""
        now = self._state
        return State(
            poses=now.poses.clone(),
            velocities=now.velocities.clone(),
            scans=now.scans.clone(),
            collided=now.collided.clone(),
        )

    def _cast(self) -> None:
        poses, _, scans, _ = self._arrays
        wp.launch(
            batch_kernels.cast,
            dim=(len(self._world_index), len(self.robots)),
            inputs=[poses, self._robots, self._directions, self._geometry, self._warp_index, scans],
            device=self._warp_device,
        )


def _robot_struct(robot: RobotSpec) -> Any:
    out = batch_kernels.Robot()
    angles = robot.lidar.angles()
    out.speed_min, out.speed_max = robot.drive.speed
    out.turn_rate = robot.drive.turn_rate
    out.acceleration = robot.drive.acceleration
    out.turn_acceleration = robot.drive.turn_acceleration
    out.radius = robot.footprint_radius
    out.profile_radius = robot.profile_radius
    out.height = robot.height
    out.mass = robot.mass
    out.mount = wp.vec3(*robot.lidar.mount)
    out.lidar_height = robot.lidar.height
    out.min_range, out.max_range = robot.lidar.min_range, robot.lidar.max_range
    out.first_angle = float(angles[0])
    out.angle_step = float(angles[1] - angles[0])
    out.beams = robot.lidar.beams
    return out


def _directions(robots: Sequence[RobotSpec], beams: int) -> np.ndarray:
    """Return unit vectors (robots, beams, 2) of the beams in the mount's frame."""
    out = np.zeros((len(robots), beams, 2), np.float32)
    for row, robot in zip(out, robots, strict=True):
        angles = robot.lidar.angles()
        row[: len(angles)] = np.stack([np.cos(angles), np.sin(angles)], -1)
    return out


def _pack(maps: Sequence[PlanarMap], device: Any) -> Any:
    geometry = batch_kernels.Geometry()

    def array(parts: list[np.ndarray], width: int, dtype: Any) -> Any:
        shape = (-1, width) if width > 1 else (-1,)
        return wp.array(np.concatenate(parts).reshape(shape), dtype=dtype, device=device)

    def starts(lengths: list[int]) -> Any:
        return wp.array(np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32), dtype=int, device=device)

    geometry.segments = array([m.segments for m in maps], 4, wp.vec4)
    geometry.segment_heights = array([m.segment_heights for m in maps], 2, wp.vec2)
    geometry.segment_flags = array([m.segment_flags for m in maps], 1, int)
    geometry.segment_start = starts([len(m.segments) for m in maps])
    geometry.discs = array([m.discs for m in maps], 3, wp.vec3)
    geometry.disc_heights = array([m.disc_heights for m in maps], 2, wp.vec2)
    geometry.disc_start = starts([len(m.discs) for m in maps])
    return geometry
