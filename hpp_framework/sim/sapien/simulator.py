"""The SAPIEN simulator: the same worlds and robots in PhysX, as reference and for pictures.

Physics needs no graphics driver. Pictures do: see :mod:`hpp_framework.sim.sapien.render`.
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

from hpp_framework.core.robot import DriveLimits, RobotSpec
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import People, State
from hpp_framework.core.world import World
from hpp_framework.sim.batch.crowd import Walkers, anything_moves, settled
from hpp_framework.sim.sapien.camera import SceneCamera, team_view
from hpp_framework.sim.sapien.render import rendering_problem
from hpp_framework.sim.sapien.scene import ROUNDNESS, PhysicsScene, pose_of
from hpp_framework.sim.simulator import SUBSTEPS, Simulator
from hpp_framework.utils.errors import SimulatorError

SUBSTEP = CONTROL_PERIOD / SUBSTEPS
TICK = 0.01
"""Seconds of a physics tick."""

TICKS = round(SUBSTEP / TICK)

DRIVING = 0.05
"""m/s from which a robot that touches a person counts."""

FloatArray = npt.NDArray[np.float32]


class SapienSimulator(Simulator):
    """Robots as locked-axis bodies in one PhysX scene an episode; lidar by ray casts.

    Args:
        robots: the team.
        render: (width, height) of :meth:`picture` in pixels, or None for physics only.

    Raises:
        SimulatorError: if pictures are asked for and SAPIEN cannot draw on this machine.
    """

    def __init__(self, robots: Sequence[RobotSpec], *, render: tuple[int, int] | None = None) -> None:
        super().__init__(robots)
        problem = rendering_problem() if render is not None else None
        if problem is not None:
            raise SimulatorError(problem)
        self._render = render
        self._rays = [_Rays(robot) for robot in self.robots]
        self._episodes: list[_Episode] = []
        self._starts = torch.zeros(0)
        self._cameras: dict[int, SceneCamera] = {}

    def reset(self, worlds: Sequence[World], poses: Float[Tensor, "b n 3"]) -> State:
        """Build a scene a world and put the robots at rest at the given poses."""
        self.check_poses(worlds, poses)
        self._episodes = [_Episode(settled(world), self.robots) for world in worlds]
        for episode, start in zip(self._episodes, poses.tolist(), strict=True):
            episode.place(start)
        self._starts = poses.detach().clone()
        self._cameras.clear()
        return self.state()

    def step(self, commands: Float[Tensor, "b n *p 2"]) -> State:
        """Drive for one control period (4 substeps of 5 physics ticks) and cast all lidars."""
        if not self._episodes:
            raise SimulatorError("step() before reset(): reset the simulator with worlds and poses first.")
        self.check_commands(commands, len(self._episodes))
        parts = commands if commands.dim() == 4 else commands[:, :, None].expand(-1, -1, SUBSTEPS, -1)
        for episode, wanted in zip(self._episodes, parts.transpose(1, 2).tolist(), strict=True):
            episode.drive(wanted)
        return self.state()

    def state(self) -> State:
        """Return the current state with fresh scans; it shares no memory with the simulator."""
        scans = np.stack([self._scan(episode) for episode in self._episodes])
        return State(
            poses=torch.tensor([episode.poses() for episode in self._episodes]),
            velocities=torch.tensor([episode.velocities for episode in self._episodes]),
            scans=torch.from_numpy(scans),
            touched_obstacle=torch.tensor([episode.touched_obstacle for episode in self._episodes]),
            touched_robot=torch.tensor([episode.touched_robot for episode in self._episodes]),
            **self._moving_state(),
        )

    def _moving_state(self) -> dict[str, Any]:
        if not any(episode.walkers for episode in self._episodes):
            return {}
        touched = torch.tensor([episode.touched_person for episode in self._episodes])
        return {"touched_person": touched, "people": _side_by_side([e.people() for e in self._episodes])}

    def picture(self, episode: int = 0) -> npt.NDArray[np.uint8]:
        """Return a picture (height, width, 3), red green blue, of one episode, in the view of its start.

        Raises:
            SimulatorError: if the simulator was built without ``render``, or there is no such episode.
        """
        if self._render is None:
            raise SimulatorError("no pictures: build the simulator with render=(width, height).")
        if not 0 <= episode < len(self._episodes):
            raise SimulatorError(f"there is no episode {episode}; {len(self._episodes)} are running.")
        current = self._episodes[episode]
        if episode not in self._cameras:
            view = team_view(current.world, self._starts[episode], size=self._render)
            self._cameras[episode] = SceneCamera(current.world, self.robots, view, size=self._render)
        people = current.people()
        return self._cameras[episode].picture(
            np.array(current.poses()),
            people=None if people is None else people.poses[0].numpy(),
            time=current.seconds(),
        )

    def close(self) -> None:
        """Drop all scenes."""
        self._episodes = []
        self._cameras.clear()

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
        self.walkers = Walkers(world, robots) if anything_moves([world]) else None
        self._put(self._moved(), at_once=True)
        self._forget_touches()

    def people(self) -> People | None:
        """Return the people of this episode, None if nothing moves but robots."""
        return None if self.walkers is None else self.walkers.people

    def seconds(self) -> float:
        """Return the time since the beginning."""
        return 0.0 if self.walkers is None else self.walkers.seconds()

    def place(self, poses: Sequence[Sequence[float]]) -> None:
        for body, (x, y, theta) in zip(self.physics.bodies, poses, strict=True):
            body.entity.set_pose(pose_of(x, y, theta))

    def poses(self) -> list[tuple[float, float, float]]:
        return [_planar(body.entity.pose) for body in self.physics.bodies]

    def drive(self, parts: Sequence[Sequence[Sequence[float]]]) -> None:
        self._forget_touches()
        for substep, commands in enumerate(parts):
            start = self._moved()
            if self.walkers is not None:
                poses, velocities = (np.array(each, np.float32) for each in (self.poses(), self.velocities))
                self.walkers.walk(poses, velocities, is_first=substep == 0)
            self._substep(commands, start, self._moved())

    def _moved(self) -> FloatArray:
        """Return where (m, 3) people and then moving obstacles are."""
        if self.walkers is None:
            return np.zeros((0, 3), np.float32)
        now = self.walkers.seconds()
        obstacles = [[*each.at(now), 0.0] for each in self.world.moving]
        people = self.walkers.people.poses[0].numpy()
        return np.concatenate([people, np.array(obstacles, np.float32).reshape(-1, 3)])

    def _put(self, places: FloatArray, *, at_once: bool = False) -> None:
        """Move people and moving obstacles to places, during the next tick or at once."""
        for body, (x, y, theta) in zip(
            [*self.physics.people, *self.physics.moving], places.tolist(), strict=True
        ):
            pose = pose_of(x, y, theta)
            if at_once:
                body.entity.set_pose(pose)
            else:
                body.set_kinematic_target(pose)

    def _forget_touches(self) -> None:
        self.touched_obstacle = [False for _ in self.robots]
        self.touched_robot = [False for _ in self.robots]
        self.touched_person = [False for _ in self.robots]

    def _substep(self, commands: Sequence[Sequence[float]], start: FloatArray, end: FloatArray) -> None:
        before = self.poses()
        old = self.velocities
        limits = [robot.drive for robot in self.robots]
        self.velocities = [_accelerate(*each) for each in zip(limits, old, commands, strict=True)]
        touched = [False for _ in self.robots]
        for tick in range(TICKS):
            share = (tick + 0.5) / TICKS
            for body, first, last in zip(self.physics.bodies, old, self.velocities, strict=True):
                _push(body, [_mix(a, b, share) for a, b in zip(first, last, strict=True)])
            self._put((start + (end - start) * ((tick + 1) / TICKS)).astype(np.float32))
            self.physics.scene.step()
            for index, (obstacle, robot, person) in enumerate(self.physics.touching()):
                self.touched_obstacle[index] |= obstacle
                self.touched_robot[index] |= robot
                # robots that stand are walked into
                self.touched_person[index] |= person and abs(self.velocities[index][0]) > DRIVING
                touched[index] |= obstacle or robot or person
        for index, (place, reached) in enumerate(zip(before, self.poses(), strict=True)):
            if touched[index]:
                _slow_down(self.velocities[index], place, reached)


def _side_by_side(people: Sequence[People | None]) -> People:
    """Return the people of several episodes as one, padded with NaN."""
    known = [each for each in people if each is not None]
    most = max(each.poses.shape[1] for each in known)
    absent = known[0].episodes(slice(0)).poses

    def joined(name: str) -> Tensor:
        rows: list[Tensor] = []
        for each in people:
            width = getattr(known[0], name).shape[-1]
            row = absent.new_full((1, most, width), torch.nan)
            if each is not None:
                row[:, : each.poses.shape[1]] = getattr(each, name)
            rows.append(row)
        return torch.cat(rows)

    times = [torch.zeros(1, dtype=torch.int64) if each is None else each.time for each in people]
    return People(joined("poses"), joined("velocities"), joined("progress"), torch.cat(times))


def _accelerate(drive: DriveLimits, velocity: Sequence[float], command: Sequence[float]) -> list[float]:
    """Return the speed and turn rate wanted at the end of a substep, within the drive's limits."""
    step_v, step_w = drive.acceleration * SUBSTEP, drive.turn_acceleration * SUBSTEP
    v_goal = _limit(command[0], *drive.speed)
    w_goal = _limit(command[1], -drive.turn_rate, drive.turn_rate)
    return [
        velocity[0] + _limit(v_goal - velocity[0], -step_v, step_v),
        velocity[1] + _limit(w_goal - velocity[1], -step_w, step_w),
    ]


def _push(body: Any, velocity: Sequence[float]) -> None:
    """Set a body's velocity for one tick, along the heading halfway through it."""
    v, w = velocity
    heading = _planar(body.entity.pose)[2] + w * TICK / 2
    body.set_linear_velocity([v * math.cos(heading), v * math.sin(heading), 0.0])
    body.set_angular_velocity([0.0, 0.0, w])


def _slow_down(velocity: list[float], start: Sequence[float], end: Sequence[float]) -> None:
    """Keep of the speed what contact left of it along the heading; contact never speeds a robot up."""
    ahead = (end[0] - start[0]) * math.cos(end[2]) + (end[1] - start[1]) * math.sin(end[2])
    velocity[0] = _limit(ahead / SUBSTEP, min(velocity[0], 0.0), max(velocity[0], 0.0))


def _mix(start: float, end: float, share: float) -> float:
    return start + (end - start) * share


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
    """Return how far (k,) each ray runs until it has left a disc about the origin; 0 if it misses."""
    along = directions @ eye
    root = along**2 - (eye @ eye - radius**2)
    leaves = -along + np.sqrt(np.maximum(root, 0.0))
    return np.where((root > 0) & (leaves > 0), leaves, 0.0).astype(np.float32)
