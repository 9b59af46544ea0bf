"""The SAPIEN simulator: the same worlds and robots in PhysX, as reference and for pictures.

Physics needs no graphics driver. Pictures do: see :mod:`hpp_framework.sim.sapien_render`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.errors import SimulatorError
from hpp_framework.robot import DriveLimits, RobotSpec
from hpp_framework.sim.sapien_scene import ROUNDNESS, PhysicsScene, pose_of
from hpp_framework.sim.simulator import CONTROL_PERIOD, Simulator
from hpp_framework.types import State
from hpp_framework.worlds.world import World

TICK = 0.01
"""Seconds of a physics tick."""

TICKS = round(CONTROL_PERIOD / TICK)

FloatArray = npt.NDArray[np.float32]


class SapienSimulator(Simulator):
    """Robots as locked-axis bodies in one PhysX scene an episode; lidar by ray casts.

    Args:
        robots: the team.
        render: (width, height) of :meth:`picture` in pixels, or None for physics only.
    """

    def __init__(self, robots: Sequence[RobotSpec], *, render: tuple[int, int] | None = None) -> None:
        super().__init__(robots)
        self._render = render
        self._rays = [_Rays(robot) for robot in self.robots]
        self._episodes: list[_Episode] = []

    def reset(self, worlds: Sequence[World], poses: Float[Tensor, "b n 3"]) -> State:
        """Build a scene a world and put the robots at rest at the given poses."""
        self.check_poses(worlds, poses)
        self._episodes = [_Episode(world, self.robots) for world in worlds]
        for episode, start in zip(self._episodes, poses.tolist(), strict=True):
            episode.place(start)
        return self.state()

    def step(self, commands: Float[Tensor, "b n 2"]) -> State:
        """Drive for one control period (20 physics ticks) and cast all lidars."""
        if not self._episodes:
            raise SimulatorError("step() before reset(): reset the simulator with worlds and poses first.")
        self.check_commands(commands, len(self._episodes))
        for episode, wanted in zip(self._episodes, commands.tolist(), strict=True):
            episode.drive(wanted)
        return self.state()

    def state(self) -> State:
        """Return the current state with fresh scans; it shares no memory with the simulator."""
        scans = np.stack([self._scan(episode) for episode in self._episodes])
        return State(
            poses=torch.tensor([episode.poses() for episode in self._episodes]),
            velocities=torch.tensor([episode.velocities for episode in self._episodes]),
            scans=torch.from_numpy(scans),
            collided=torch.tensor([episode.collided for episode in self._episodes]),
        )

    def close(self) -> None:
        """Drop all scenes."""
        self._episodes = []

    def _scan(self, episode: _Episode) -> FloatArray:
        out = np.empty((len(self.robots), self.beams), np.float32)
        for robot, rays, pose, row in zip(self.robots, self._rays, episode.poses(), out, strict=True):
            row[:] = robot.lidar.max_range
            row[: robot.lidar.beams] = rays.cast(episode.physics, pose)
        return out


class _Episode:
    """One scene with its robots' speeds, which PhysX may only reduce."""

    def __init__(self, world: World, robots: Sequence[RobotSpec]) -> None:
        self.world = world
        self.robots = robots
        self.physics = PhysicsScene(world, robots, TICK)
        self.velocities = [[0.0, 0.0] for _ in robots]
        self.collided = [False for _ in robots]

    def place(self, poses: Sequence[Sequence[float]]) -> None:
        for body, (x, y, theta) in zip(self.physics.bodies, poses, strict=True):
            body.entity.set_pose(pose_of(x, y, theta))

    def poses(self) -> list[tuple[float, float, float]]:
        return [_planar(body.entity.pose) for body in self.physics.bodies]

    def drive(self, commands: Sequence[Sequence[float]]) -> None:
        self.collided = [False for _ in self.robots]
        for _ in range(TICKS):
            for robot, body, velocity, command in zip(
                self.robots, self.physics.bodies, self.velocities, commands, strict=True
            ):
                _accelerate(robot.drive, body, velocity, command)
            self.physics.scene.step()
            for index, touching in enumerate(self.physics.touching()):
                if touching:
                    self.collided[index] = True
                    _slow_down(self.physics.bodies[index], self.velocities[index])


def _accelerate(drive: DriveLimits, body: Any, velocity: list[float], command: Sequence[float]) -> None:
    """Set a body's velocity for one tick: the mean of the old and the new speed along the mean heading."""
    v_old, w_old = velocity
    v_goal = _limit(command[0], *drive.speed)
    w_goal = _limit(command[1], -drive.turn_rate, drive.turn_rate)
    v = v_old + _limit(v_goal - v_old, -drive.acceleration * TICK, drive.acceleration * TICK)
    w = w_old + _limit(w_goal - w_old, -drive.turn_acceleration * TICK, drive.turn_acceleration * TICK)
    ahead, turn = (v_old + v) / 2, (w_old + w) / 2
    heading = _planar(body.entity.pose)[2] + turn * TICK / 2
    body.set_linear_velocity([ahead * math.cos(heading), ahead * math.sin(heading), 0.0])
    body.set_angular_velocity([0.0, 0.0, turn])
    velocity[:] = v, w


def _slow_down(body: Any, velocity: list[float]) -> None:
    """Keep of the speed what contact left of it along the heading; contact never speeds a robot up."""
    theta = _planar(body.entity.pose)[2]
    x, y, _ = body.get_linear_velocity().tolist()
    along = x * math.cos(theta) + y * math.sin(theta)
    velocity[0] = _limit(along, min(velocity[0], 0.0), max(velocity[0], 0.0))


def _limit(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


def _planar(pose: Any) -> tuple[float, float, float]:
    x, y, _ = pose.p.tolist()
    w, _, _, z = pose.q.tolist()
    return x, y, (2 * math.atan2(z, w) + math.pi) % (2 * math.pi) - math.pi


class _Rays:
    """The beams of one lidar in its robot's frame, each starting outside the robot's own profile."""

    def __init__(self, robot: RobotSpec) -> None:
        lidar = robot.lidar
        self._lidar = lidar
        angles = lidar.angles() + lidar.mount[2]
        directions = np.stack([np.cos(angles), np.sin(angles)], -1)
        eye = np.array(lidar.mount[:2])
        self._skip = _way_out(eye, directions, robot.profile_radius * ROUNDNESS * 1.001)
        self._starts = eye + directions * self._skip[:, None]
        self._directions = directions

    def cast(self, physics: PhysicsScene, pose: Sequence[float]) -> FloatArray:
        """Return the ranges (k,) seen from a robot's pose."""
        x, y, theta = pose
        turn = np.array([[math.cos(theta), math.sin(theta)], [-math.sin(theta), math.cos(theta)]])
        starts = np.full((len(self._skip), 3), self._lidar.height, np.float32)
        starts[:, :2] = self._starts @ turn + (x, y)
        directions = np.zeros_like(starts)
        directions[:, :2] = self._directions @ turn
        ranges = physics.distances(starts, directions, self._lidar.max_range) + self._skip
        return np.clip(ranges, self._lidar.min_range, self._lidar.max_range).astype(np.float32)


def _way_out(eye: npt.NDArray[np.float64], directions: npt.NDArray[np.float64], radius: float) -> FloatArray:
    """Return how far (k,) each ray runs until it has left a disc about the origin; 0 if it misses the disc."""
    along = directions @ eye
    root = along**2 - (eye @ eye - radius**2)
    leaves = -along + np.sqrt(np.maximum(root, 0.0))
    return np.where((root > 0) & (leaves > 0), leaves, 0.0).astype(np.float32)
