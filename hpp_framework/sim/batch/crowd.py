"""People and moving obstacles on the host: their data for the kernels, and people who walk for SAPIEN."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from jaxtyping import Bool, Int
from torch import Tensor

from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import People
from hpp_framework.core.world import MovingObstacle, Person, World
from hpp_framework.sim.batch import crowd_kernels
from hpp_framework.sim.batch import kernels as batch_kernels
from hpp_framework.sim.simulator import SUBSTEPS
from hpp_framework.utils.kernels import wp
from hpp_framework.utils.seeding import numpy_rng
from hpp_framework.worlds.occupancy import free_space
from hpp_framework.worlds.people import RESOLUTION, populate


def anything_moves(pool: Sequence[World]) -> bool:
    """Return whether there are people or moving obstacles in any of the worlds."""
    return any(world.people or world.moving for world in pool)


def settled(world: World) -> World:
    """Return a world with people about whom nothing is open, the same each time.

    Evaluations settle them for each episode before; this is for worlds that are simulated as they are.
    """
    if all(person.settled for person in world.people):
        return world
    return populate(world, (), np.zeros((0, 2)), numpy_rng(0, "people", world.name))


class Crowd:
    """The people of many episodes, in memory that kernels work on.

    Args:
        pool: worlds whose people are settled.
        rooms: the different worlds of the pool, without what moves.
        room_of: for each world of the pool, its index among the rooms.
        episodes: how many run side by side.
        device: of the tensors.

    Attributes:
        people: of all episodes, the kernels' own memory.
        crowds: what kernels know of the pool.
        walk: what kernels know of the episodes.
    """

    def __init__(
        self,
        pool: Sequence[World],
        rooms: Sequence[World],
        room_of: Sequence[int],
        *,
        episodes: int,
        device: torch.device,
    ) -> None:
        self._device = wp.device_from_torch(device)
        most = max(len(world.people) for world in pool)
        self.crowds = _crowds(pool, self._device)
        walked = {room for room, world in zip(room_of, pool, strict=True) if world.people}
        tallest = max((person.height for world in pool for person in world.people), default=0.0)
        _add_fields(self.crowds, rooms, walked, tallest, self._device)
        self._starts = _starts(pool, most).to(device)
        self._ways = _ways(pool, most).to(device)

        def zeros(*trailing: int) -> Tensor:
            return torch.full((episodes, most, *trailing), torch.nan, device=device)

        self.people = People(
            zeros(3), zeros(2), zeros(3), torch.zeros(episodes, dtype=torch.int64, device=device)
        )
        self._world = torch.zeros(episodes, dtype=torch.int32, device=device)
        self.walk = self._wrapped((episodes, most))

    def _wrapped(self, shape: tuple[int, int]) -> Any:
        walk = crowd_kernels.Walk()
        walk.world, walk.time = wp.from_torch(self._world), wp.from_torch(self.people.time)
        walk.near = wp.zeros(shape[0], dtype=int, device=self._device)
        walk.forces = wp.zeros(shape, dtype=wp.vec2, device=self._device)
        walk.is_near = wp.zeros(shape, dtype=wp.bool, device=self._device)
        # arrays without elements cannot be wrapped
        if shape[1]:
            walk.poses = wp.from_torch(self.people.poses, dtype=wp.vec3)
            walk.velocities = wp.from_torch(self.people.velocities, dtype=wp.vec2)
            walk.progress = wp.from_torch(self.people.progress, dtype=wp.vec3)
        return walk

    def place(
        self, world_index: Int[Tensor, "b"], fresh: Bool[Tensor, "b"], people: People | None = None
    ) -> None:
        """Let the people of some episodes begin anew.

        Args:
            world_index: world of each episode, as an index into the pool.
            fresh: which episodes begin.
            people: as they are then; None for their starts.
        """
        self._world.copy_(world_index)
        fresh = fresh.to(self.people.poses.device)
        chosen = self._world.long()
        start = self._starts[chosen]
        # NaN where there is no person
        still = 0 * start[..., :2]
        told = people or People(start, still, self._ways[chosen], torch.zeros_like(self.people.time))
        for name in ("poses", "velocities", "progress", "time"):
            now = getattr(self.people, name)
            wanted = getattr(told, name).to(now)
            if now.dim() > 1:
                # told of more worlds than these, whose people may be more
                wanted = wanted[:, : now.shape[1]]
            now.copy_(torch.where(fresh.reshape(-1, *[1] * (now.dim() - 1)), wanted, now))

    def state(self) -> People:
        """Return a copy of the people; it shares no memory."""
        now = self.people
        return People(now.poses.clone(), now.velocities.clone(), now.progress.clone(), now.time.clone())


class Walkers:
    """The people of one episode, for a simulator that moves robots itself.

    They walk by the kernels of the batch simulator::

        walkers = Walkers(world, robots)
        for substep in range(SUBSTEPS):
            walkers.walk(poses, velocities, is_first=substep == 0)
            move_bodies(walkers.people)

    Args:
        world: whose people are settled.
        robots: the team.
    """

    def __init__(self, world: World, robots: Sequence[RobotSpec]) -> None:
        self._crowd = Crowd([world], [world.at_rest()], [0], episodes=1, device=torch.device("cpu"))
        self._crowd.place(torch.zeros(1, dtype=torch.int32), torch.ones(1, dtype=torch.bool))
        structs: list[Any] = []
        for robot in robots:
            structs.append(batch_kernels.Robot())
            structs[-1].radius = robot.footprint_radius
            structs[-1].speed_min, structs[-1].speed_max = robot.drive.speed
        self._robots: Any = wp.array(structs, dtype=batch_kernels.Robot, device="cpu")

    @property
    def people(self) -> People:
        """The people now, with a leading dimension of one."""
        return self._crowd.state()

    def seconds(self) -> float:
        """Return the time since the beginning."""
        return int(self._crowd.people.time[0]) * CONTROL_PERIOD / SUBSTEPS

    def walk(
        self, poses: npt.NDArray[np.float32], velocities: npt.NDArray[np.float32], *, is_first: bool
    ) -> None:
        """Let the people walk for one substep.

        Args:
            poses: (n, 3) of the robots.
            velocities: (n, 2) of the robots.
            is_first: whether the substep begins a control period.
        """
        robots = [
            wp.array(np.ascontiguousarray(each[None], np.float32), device="cpu")
            for each in (poses, velocities)
        ]
        wp.launch(
            crowd_kernels.walk_alone, dim=1, device="cpu",
            inputs=[
                int(is_first), CONTROL_PERIOD, SUBSTEPS, self._robots, *robots,
                self._crowd.crowds, self._crowd.walk,
            ],
        )  # fmt: skip


def _crowds(pool: Sequence[World], device: Any) -> Any:
    people = [person for world in pool for person in world.people]
    moving = [obstacle for world in pool for obstacle in world.moving]
    points = [point for person in people for point in person.route]
    keys = [key for obstacle in moving for key in obstacle.path]
    first_points = np.cumsum([0, *(len(person.route) for person in people)])
    first_keys = np.cumsum([0, *(len(obstacle.path) for obstacle in moving)])
    crowds = crowd_kernels.Crowds()

    def array(values: Sequence[Any], dtype: Any) -> Any:
        return wp.array(list(values), dtype=dtype, device=device)

    crowds.first_walker = array(np.cumsum([0, *(len(world.people) for world in pool)]).tolist(), int)
    crowds.first_mover = array(np.cumsum([0, *(len(world.moving) for world in pool)]).tolist(), int)
    walkers = [_walker(p, int(first)) for p, first in zip(people, first_points, strict=False)]
    movers = [_mover(each, int(first)) for each, first in zip(moving, first_keys, strict=False)]
    # a kernel is never given an empty array
    crowds.walkers = array(walkers or [crowd_kernels.Walker()], crowd_kernels.Walker)
    crowds.movers = array(movers or [crowd_kernels.Mover()], crowd_kernels.Mover)
    crowds.points = array(points or [(0.0, 0.0)], wp.vec2)
    crowds.keys = array(keys or [(0.0, 0.0, 0.0)], wp.vec3)
    return crowds


def _add_fields(
    crowds: Any, rooms: Sequence[World], walked: Collection[int], height: float, device: Any
) -> None:
    """Give the rooms where people walk the distances to their obstacles.

    Args:
        crowds: of the kernels.
        rooms: worlds without what moves.
        walked: indices of the rooms with people.
        height: of the tallest person, metres.
        device: Warp's.
    """
    fields: list[Any] = []
    distances = [np.zeros(4, np.float32)]
    first = 4
    for index, room in enumerate(rooms):
        field = crowd_kernels.Field()
        fields.append(field)
        if index in walked:
            space = free_space(room, body_height=height, resolution=RESOLUTION)
            field.origin, field.cells_per_metre = wp.vec2(*space.origin), 1 / space.resolution
            field.rows, field.columns = space.distance.shape
            field.first, first = first, first + space.distance.size
            distances.append(space.distance.ravel())
    crowds.fields = wp.array(fields, dtype=crowd_kernels.Field, device=device)
    crowds.distances = wp.array(np.concatenate(distances), dtype=float, device=device)


def _walker(person: Person, first_point: int) -> Any:
    out = crowd_kernels.Walker()
    out.radius, out.height, out.speed = person.radius, person.height, person.speed
    out.first_point, out.points = first_point, len(person.route)
    out.loop = int(person.loop)
    return out


def _mover(obstacle: MovingObstacle, first_key: int) -> Any:
    out = crowd_kernels.Mover()
    out.radius = obstacle.radius or 0.0
    length, width = obstacle.size or (0.0, 0.0)
    out.half = wp.vec2(length / 2, width / 2)
    out.along = wp.vec2(math.cos(obstacle.yaw), math.sin(obstacle.yaw))
    out.base, out.top = obstacle.base, obstacle.base + obstacle.height
    out.first_key, out.keys, out.loop = first_key, len(obstacle.path), int(obstacle.loop)
    return out


def _starts(pool: Sequence[World], most: int) -> Tensor:
    """Return the poses (w, p, 3) that people start with: on their route, looking along it."""
    out = torch.full((len(pool), most, 3), torch.nan)
    for w, world in enumerate(pool):
        for p, person in enumerate(world.people):
            (x, y), *rest = person.route
            heading = math.atan2(rest[0][1] - y, rest[0][0] - x) if rest else 0.0
            out[w, p] = torch.tensor([x, y, heading])
    return out


def _ways(pool: Sequence[World], most: int) -> Tensor:
    """Return the progress (w, p, 3) that people start with: on the way to their second place."""
    out = torch.full((len(pool), most, 3), torch.nan)
    for w, world in enumerate(pool):
        for p, person in enumerate(world.people):
            out[w, p] = torch.tensor([float(len(person.route) > 1), 1.0, 0.0])
    return out
