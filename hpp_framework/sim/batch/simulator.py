"""The batch simulator: thousands of planar worlds at once, on CPU or CUDA (Warp)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import People, State
from hpp_framework.core.world import World
from hpp_framework.sim.batch import among_kernels, drive_kernels, lidar_kernels
from hpp_framework.sim.batch import kernels as batch_kernels
from hpp_framework.sim.batch.crowd import Crowd, anything_moves, settled
from hpp_framework.sim.batch.grid import build_geometry
from hpp_framework.sim.simulator import SUBSTEPS, Simulator
from hpp_framework.utils.errors import SimulatorError
from hpp_framework.utils.kernels import wp
from hpp_framework.utils.thread_pool import Job, ThreadPool
from hpp_framework.worlds.slicing import planar_map


class BatchSimulator(Simulator):
    """Disc robots among boxes, lines and discs, and among people who walk.

    The physics are those of :mod:`hpp_framework.sim.batch.drive_kernels`.

    Episodes are shared out to threads; results do not depend on how many there are.

    Args:
        robots: the team.
        device: ``"cpu"`` or ``"cuda"``.
        threads: that work side by side on the CPU, or None for one per core that this process may use.
    """

    def __init__(
        self, robots: Sequence[RobotSpec], *, device: str = "cpu", threads: int | None = None
    ) -> None:
        super().__init__(robots)
        if threads is not None and threads < 1:
            raise SimulatorError(f"threads must be at least 1, or None for one per core, got {threads}.")
        self.device = torch.device(device)
        self._warp_device = wp.device_from_torch(self.device)
        self._threads = ThreadPool(threads if self.device.type == "cpu" else 1)
        self._seen_from = sorted({robot.lidar.height for robot in robots})
        self._touched_below = sorted({robot.height for robot in robots})
        self._robots: Any = wp.array(
            [self._robot_struct(robot) for robot in robots],
            dtype=batch_kernels.Robot,
            device=self._warp_device,
        )
        self._rays = _rays(robots, self.beams, self._warp_device)
        self._geometry: Any = None
        self._crowd: Crowd | None = None

    def reset(self, worlds: Sequence[World], poses: Float[Tensor, "b n 3"]) -> State:
        """Start one episode per world; equal worlds share their geometry."""
        self.check_poses(worlds, poses)
        # most equal worlds are the same object, and comparing those is cheap
        objects = {id(world): world for world in worlds}
        place = {world: index for index, world in enumerate(dict.fromkeys(objects.values()))}
        index_of = {key: place[world] for key, world in objects.items()}
        self.load(tuple(place), episodes=len(worlds))
        whole_team = torch.ones(len(worlds), len(self.robots), dtype=torch.bool)
        world_index = torch.tensor([index_of[id(world)] for world in worlds], dtype=torch.int32)
        return self.place(world_index, whole_team, poses)

    def load(self, pool: Sequence[World], *, episodes: int) -> None:
        """Hold a pool of worlds and room for a number of episodes; follow with :meth:`place`.

        Args:
            pool: worlds that :meth:`place` refers to by index.
            episodes: how many run side by side.
        """
        pool = [settled(world) for world in pool]
        # people differ from episode to episode where rooms do not
        rooms = {world: index for index, world in enumerate(dict.fromkeys(w.at_rest() for w in pool))}
        self._room_of = torch.tensor([rooms[world.at_rest()] for world in pool], dtype=torch.int32)
        tallest = max(self._touched_below)
        self._geometry = build_geometry(
            [planar_map(room, lidar_heights=self._seen_from, body_height=tallest) for room in rooms],
            self._seen_from,
            self._touched_below,
            self._warp_device,
        )
        shape = (episodes, len(self.robots))

        def zeros(*trailing: int, dtype: torch.dtype = torch.float32) -> Tensor:
            return torch.zeros(*shape, *trailing, dtype=dtype, device=self.device)

        # scans are worked on in blocks, so each has room for whole ones
        self._blocks = zeros(self._rays.x.shape[1], batch_kernels.LANES)
        self._state = State(
            poses=zeros(3),
            velocities=zeros(2),
            scans=self._blocks.flatten(2)[..., : self.beams],
            touched_obstacle=zeros(dtype=torch.bool),
            touched_robot=zeros(dtype=torch.bool),
        )
        self._crowd = None
        if anything_moves(pool):
            self._crowd = Crowd(
                pool, tuple(rooms), self._room_of.tolist(), episodes=episodes, device=self.device,
            )  # fmt: skip
            touched_person = zeros(dtype=torch.bool)
            self._state = replace(self._state, touched_person=touched_person, people=self._crowd.people)
        self._world_index = torch.zeros(episodes, dtype=torch.int32, device=self.device)
        self._commands = zeros(SUBSTEPS, 2)
        self._gap = zeros()
        self._record(episodes)

    def place(
        self,
        world_index: Int[Tensor, "b"],
        robots: Bool[Tensor, "b n"],
        poses: Float[Tensor, "b n 3"],
        velocities: Float[Tensor, "b n 2"] | None = None,
        people: People | None = None,
    ) -> State:
        """Put the chosen robots at new poses, episodes into worlds of the pool, and cast all lidars.

        An episode of which all robots are chosen begins anew: its people are at their starts, its time is 0.

        Args:
            world_index: world of each episode, as an index into the pool.
            robots: which robots to move.
            poses: where to; rows that are not chosen are ignored.
            velocities: they have there, forward in m/s and turning in rad/s; None for rest.
            people: of episodes that begin anew, if not at their starts.
        """
        self._world_index.copy_(self._room_of[world_index.long().cpu()])
        chosen = robots.to(self.device)
        if self._crowd is not None:
            self._crowd.place(world_index, chosen.all(1), people)
        self._state.poses.copy_(
            torch.where(chosen[..., None], poses.to(self._state.poses), self._state.poses)
        )
        now = self._state.velocities
        wanted = torch.zeros_like(now) if velocities is None else velocities.to(now)
        now.copy_(torch.where(chosen[..., None], wanted, now))
        self._state.touched_obstacle.masked_fill_(chosen, value=False)
        self._state.touched_robot.masked_fill_(chosen, value=False)
        if self._state.touched_person is not None:
            self._state.touched_person.masked_fill_(chosen, value=False)
        # what is near has to be looked for again
        self._gap.zero_()
        self._threads.run(self._cast)
        return self.state()

    def step(self, commands: Float[Tensor, "b n *p 2"]) -> State:
        """Drive for one control period and cast all lidars."""
        self.advance(commands)
        return self.state()

    def advance(self, commands: Float[Tensor, "b n *p 2"]) -> State:
        """Do what :meth:`step` does, and return the simulator's own memory.

        Returns:
            Tensors that the next step overwrites; they must not be written to. There may be gaps between
            the rows of scans.
        """
        self.check_commands(commands, len(self._world_index))
        self._commands.copy_(commands if commands.dim() == 4 else commands[:, :, None])
        self._threads.run(self._drive_and_cast)
        return self._state

    def state(self) -> State:
        """Return a copy of the current state; it shares no memory with the simulator."""
        now = self._state
        return State(
            poses=now.poses.clone(),
            velocities=now.velocities.clone(),
            scans=now.scans.contiguous() if not now.scans.is_contiguous() else now.scans.clone(),
            touched_obstacle=now.touched_obstacle.clone(),
            touched_robot=now.touched_robot.clone(),
            touched_person=None if now.touched_person is None else now.touched_person.clone(),
            people=None if self._crowd is None else self._crowd.state(),
        )

    def close(self) -> None:
        """End the threads."""
        self._threads.close()

    def _record(self, episodes: int) -> None:
        """Prepare the launches of a step, slice by slice of the episodes."""
        robots = len(self.robots)
        wrap = wp.from_torch
        poses, index = wrap(self._state.poses), wrap(self._world_index)
        blocks = wrap(self._blocks.flatten(0, 1), dtype=batch_kernels.Lanes)
        touched: Any = wp.zeros((episodes, robots), dtype=wp.bool, device=self._warp_device)
        before: Any = wp.zeros((episodes, robots), dtype=wp.vec2, device=self._warp_device)
        drive_inputs = [
            wrap(self._commands), self._robots, self._geometry, index, CONTROL_PERIOD, SUBSTEPS,
            poses, wrap(self._state.velocities), wrap(self._state.touched_obstacle),
            wrap(self._state.touched_robot), touched, before, wrap(self._gap),
        ]  # fmt: skip
        cast_inputs = [poses, self._robots, self._rays, self._geometry, index, blocks]
        drive_kernel, among_inputs = drive_kernels.drive, list[Any]()
        if self._crowd is not None and self._state.touched_person is not None:
            drive_kernel = among_kernels.drive_among
            moves = [self._crowd.crowds, self._crowd.walk]
            drive_inputs += [wrap(self._state.touched_person), *moves]
            ranges = wrap(self._blocks.flatten(2).flatten(0, 1))
            among_inputs = [poses, self._robots, self._beams(), CONTROL_PERIOD / SUBSTEPS, *moves, ranges]
        self._cast: list[Job] = []
        self._drive_and_cast: list[Job] = []
        for start, stop in self._threads.slices(episodes):
            rows = (start * robots, (stop - start) * robots)
            drive = self._prepare(drive_kernel, stop - start, [start, *drive_inputs])
            cast = self._prepare(lidar_kernels.cast, rows[1], [rows[0], *cast_inputs])
            if among_inputs:
                among = self._prepare(among_kernels.cast_among, rows[1], [rows[0], *among_inputs])
                cast = partial(_in_turn, cast, among)
            self._cast.append(cast)
            self._drive_and_cast.append(partial(_in_turn, drive, cast))

    def _beams(self) -> Any:
        beams = among_kernels.Beams()
        x, y = (rays.numpy().reshape(len(self.robots), -1) for rays in (self._rays.x, self._rays.y))
        beams.x = wp.array(x, dtype=float, device=self._warp_device)
        beams.y = wp.array(y, dtype=float, device=self._warp_device)
        return beams

    def _prepare(self, kernel: Any, size: int, inputs: list[Any]) -> Job:
        launch: Any = wp.launch(kernel, dim=size, inputs=inputs, device=self._warp_device, record_cmd=True)
        if self.device.type == "cpu":
            return launch.launch
        return lambda: launch.launch(stream=wp.stream_from_torch(torch.cuda.current_stream(self.device)))

    def _robot_struct(self, robot: RobotSpec) -> Any:
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
        out.seen_layer = self._seen_from.index(robot.lidar.height)
        out.touched_layer = len(self._seen_from) + self._touched_below.index(robot.height)
        out.mount = wp.vec3(*robot.lidar.mount)
        out.lidar_height = robot.lidar.height
        out.min_range, out.max_range = robot.lidar.min_range, robot.lidar.max_range
        out.first_angle = float(angles[0])
        out.field_of_view = robot.lidar.field_of_view
        out.last_beam = wp.vec2(math.cos(robot.lidar.field_of_view), math.sin(robot.lidar.field_of_view))
        out.beams_per_radian = float(1.0 / (angles[1] - angles[0]))
        out.beams = robot.lidar.beams
        return out


def _in_turn(*jobs: Job) -> None:
    for job in jobs:
        job()


def _rays(robots: Sequence[RobotSpec], beams: int, device: Any) -> Any:
    """Return the directions of all beams in the frame of beam 0, and the windows."""
    lanes = int(batch_kernels.LANES)
    blocks = -(-beams // lanes)
    directions = np.zeros((2, len(robots), blocks * lanes), np.float32)
    for row, robot in enumerate(robots):
        angles = robot.lidar.angles()
        angles = angles - angles[0]
        directions[:, row, : len(angles)] = np.cos(angles), np.sin(angles)
    x, y = directions.reshape(2, len(robots), blocks, lanes)
    lane = np.arange(lanes)
    edge = np.arange(lanes + 1)
    windows = (lane >= edge[:, None, None]) & (lane < edge[:, None])
    rays = lidar_kernels.Rays()
    rays.x = wp.array(x, dtype=batch_kernels.Lanes, device=device)
    rays.y = wp.array(y, dtype=batch_kernels.Lanes, device=device)
    rays.windows = wp.array(windows.astype(np.float32), dtype=batch_kernels.Lanes, device=device)
    return rays
