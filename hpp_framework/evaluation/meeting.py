"""The least time in which a team can be at a rendezvous, wherever that is."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt
import torch
from jaxtyping import Bool, Float, Int

from hpp_framework.evaluation.reach import PERIODS, Reach
from hpp_framework.evaluation.standing import FINER, Part, finer, standing_room
from hpp_framework.evaluation.ways import ALLOWANCE, DOUBT, cut, is_open
from hpp_framework.robot import RobotSpec
from hpp_framework.sim.simulator import CONTROL_PERIOD
from hpp_framework.task import Task
from hpp_framework.worlds.geodesic import shortest_ways
from hpp_framework.worlds.occupancy import RESOLUTION, free_space
from hpp_framework.worlds.world import World

Array = npt.NDArray[np.float64]

HALF_CELL = RESOLUTION / math.sqrt(2)
"""Metres from the centre of a cell to its farthest point."""
SLACK = HALF_CELL + 1e-3
"""Metres by which robots may be further from a cell's centre than from the true meeting place in it."""
FIRST_TRY = 3
"""Control periods beyond the least time in the open that are looked ahead first."""
GROWTH = 1.4
"""By which factor more are looked ahead next."""
UNREACHED = 1e6


def meeting_bounds(
    worlds: Sequence[World], starts: Float[np.ndarray, "b n 3"], robots: Sequence[RobotSpec], task: Task
) -> Float[np.ndarray, "b"]:
    r"""Return times in seconds that no team beats, from rest at the start to success.

    Success means that for ``task.sustain_steps`` control steps everybody is within ``task.radius`` of the
    team's centre. So there is a place ``c`` that every robot ``i`` has come within the radius ``d`` of, and

    .. math:: T \ge \min_c \max_i t_i(c) + (\text{sustain\_steps} - 1) \cdot 0.2\,\text{s},

    where ``t_i(c)`` is the least time, in whole control periods, in which robot ``i`` gets there: the longer
    of the time for the shortest way around the obstacles, inflated by its footprint, and of the time for the
    straight distance with the turn that must come first; see :class:`~hpp_framework.evaluation.reach.Reach`.

    Speeds at the end are left free, although success needs a relative speed below 0.1 m/s: robots may meet
    side by side on the same course, and whoever touches something stops at once.

    Args:
        worlds: one an episode.
        starts: start poses, at rest.
        robots: the team.
        task: its radius is what counts.

    Returns:
        NaN if the task has no radius; infinity where the robots cannot meet within a minute.
    """
    if task.radius is None:
        return np.full(len(worlds), np.nan)
    reaches = [Reach(robot.drive) for robot in robots]
    steps = [
        _Meeting(world, poses, robots, reaches, task.radius).first_step()
        for world, poses in zip(worlds, starts.astype(np.float64), strict=True)
    ]
    return (np.array(steps, np.float64) + task.sustain_steps - 1) * CONTROL_PERIOD


class _Meeting:
    """The search of one episode."""

    def __init__(
        self,
        world: World,
        poses: Float[np.ndarray, "n 3"],
        robots: Sequence[RobotSpec],
        reaches: Sequence[Reach],
        radius: float,
    ) -> None:
        self.world, self.poses, self.robots, self.reaches = world, poses, robots, reaches
        self.radius = radius + SLACK
        self.spaces = [free_space(world, body_height=robot.height) for robot in robots]
        self.rooms = self._rooms()

    def first_step(self) -> float:
        """Return the first control step at which the team can have met, infinity if it never can."""
        limit = self._in_the_open() + FIRST_TRY
        while limit <= PERIODS:
            places = self._places(limit)
            if min(places.shape) > 0:
                found = self._earliest(places, limit)
                if found <= limit:
                    return max(found, 1)
            limit = math.ceil(limit * GROWTH)
        return math.inf

    def _in_the_open(self) -> int:
        """Return the first step at which no two robots are too far apart to meet, were there nothing else."""
        xy = self.poses[:, :2]
        apart = np.linalg.norm(xy[:, None] - xy, axis=-1) - 2 * self.radius
        for step in range(PERIODS):
            driven = np.array([reach.distance(step) for reach in self.reaches])
            if (apart <= driven[:, None] + driven + 1e-9).all():
                return step
        return PERIODS

    def _places(self, limit: int) -> Part:
        """Return the cells that nobody is too far from to be near in time, whatever the way."""
        space = self.spaces[0]
        far = np.array([reach.distance(limit) for reach in self.reaches])[:, None] + self.radius
        cells = (self.poses[:, :2] - np.array(space.origin)) / space.resolution
        rows, columns = space.distance.shape
        low = np.floor((cells - far / space.resolution).max(0)).astype(int).clip(0)
        high = np.ceil((cells + far / space.resolution).min(0)).astype(int).clip(max=(columns, rows))
        width, length = (high - low).clip(0).tolist()
        return Part((int(low[0]), int(low[1])), (length, width))

    def _earliest(self, places: Part, limit: int) -> int:
        """Return the first step at which the team can have met at one of the places; limit + 1 if later."""
        centres = places.centres(self.spaces[0])
        straight = np.stack(
            [self._straight(i, centres, self.radius, limit) for i in range(len(self.robots))]
        ).max(0)
        best = int(straight.argmin())
        if straight[best] > limit or self._in_sight(centres[best]):
            return int(straight[best])
        return self._around_obstacles(places, int(straight[best]), limit)

    def _around_obstacles(self, places: Part, low: int, limit: int) -> int:
        """Return the first step at which everybody can stand somewhere within the radius of one place.

        Where each robot can stand is known to the fine grid: walls may be just too thick to meet across.
        """
        around = places.grown(math.ceil(self.radius / RESOLUTION) + 1, self.spaces[0])
        arrivals = [self._arrivals(i, around, limit) for i in range(len(self.robots))]
        # the coarse grid is quick, and never later
        low = _first(_coarser(arrivals), self._cells(RESOLUTION), low, limit)
        if low > limit or _have_met(arrivals, self._cells(RESOLUTION / FINER), low):
            return low
        return _first(arrivals, self._cells(RESOLUTION / FINER), low + 1, limit)

    def _cells(self, size: float) -> float:
        """Return the radius in cells of a size, with half a diagonal each for where robot and place are."""
        return (self.radius - SLACK) / size + math.sqrt(2) + 0.1

    def _arrivals(self, robot: int, part: Part, limit: int) -> Int[np.ndarray, "R C"]:
        """Return the first step at which a robot can be in each fine cell; limit + 1 if later or never."""
        space, spec = self.spaces[robot], self.robots[robot]
        straight = self._straight(robot, part.centres(space), HALF_CELL, limit).reshape(part.shape)
        steps = np.maximum(straight, self._around(robot, part, limit))
        room = standing_room(
            self.world, space, part, spec.height, spec.footprint_radius, DOUBT * space.resolution
        )
        return np.where(room, finer(steps), limit + 1)

    def _straight(
        self, robot: int, points: Float[np.ndarray, "p 2"], radius: float, limit: int
    ) -> Int[np.ndarray, "p"]:
        """Return the steps that turning and the straight distance to within a radius of points take."""
        offset = points - self.poses[robot, :2]
        distance = np.maximum(np.linalg.norm(offset, axis=1), 1e-9)
        bearing = np.arctan2(offset[:, 1], offset[:, 0]) - self.poses[robot, 2]
        deviation = np.abs((bearing + np.pi) % (2 * np.pi) - np.pi)
        width = np.arcsin(np.minimum(radius / distance, 1))
        width = np.where(distance <= radius, np.pi, width)
        return self.reaches[robot].approaching(
            distance - radius, np.maximum(deviation - width, 0), self.rooms[robot], limit
        )

    def _around(self, robot: int, part: Part, limit: int) -> Int[np.ndarray, "r c"]:
        """Return the steps that the shortest way to each cell takes."""
        space, step = self.spaces[robot], self.spaces[robot].resolution
        start = self.poses[robot, :2]
        # what cannot be driven to in time need not be looked at; the way may come out too long
        metres, share = ALLOWANCE
        far = self.reaches[robot].distance(limit) + metres + step
        cell = (start - np.array(space.origin)) / step
        rows, columns = space.distance.shape
        low = np.floor(cell - far / step).astype(int).clip(0)
        high = np.ceil(cell + far / step).astype(int).clip(max=(columns, rows))
        around = cut(space, low, high)
        # one of the cells in doubt is taken off there
        radius = self.robots[robot].footprint_radius - (DOUBT - 1) * step
        goal = torch.from_numpy(start[None]).float()
        lengths = shortest_ways([around], radius, goal, torch.zeros(1, dtype=torch.long)).values
        field = np.minimum(lengths.double().numpy().reshape(around.distance.shape), UNREACHED)
        least = part.of(field, low, UNREACHED) * (1 - share) - metres
        return self.reaches[robot].driving(least.ravel(), limit).reshape(part.shape)

    def _in_sight(self, place: Float[np.ndarray, "2"]) -> bool:
        """Return whether everybody certainly can drive straight to within the radius of a place."""
        for robot, space, pose in zip(self.robots, self.spaces, self.poses, strict=True):
            offset = place - pose[:2]
            distance = float(np.linalg.norm(offset))
            stop = pose[:2] + offset * max(0.0, 1 - self.radius / max(distance, 1e-9))
            if not is_open(space, robot.footprint_radius, pose[:2], stop):
                return False
        return True

    def _rooms(self) -> list[float]:
        """Return the metres that each robot can drive before it can touch anything."""
        rooms: list[float] = []
        for i, (robot, space) in enumerate(zip(self.robots, self.spaces, strict=True)):
            gap = float(space.at(self.poses[i, None, :2])[0]) - robot.footprint_radius - space.resolution
            for j, other in enumerate(self.robots):
                apart = float(np.linalg.norm(self.poses[i, :2] - self.poses[j, :2]))
                if i != j:
                    gap = min(gap, (apart - robot.footprint_radius - other.footprint_radius) / 2)
            rooms.append(max(gap, 0.0))
        return rooms


def _coarser(arrivals: Sequence[Int[np.ndarray, "R C"]]) -> list[Int[np.ndarray, "r c"]]:
    """Return the earliest arrivals by coarse cell."""
    rows, columns = (n // FINER for n in arrivals[0].shape)
    return [steps.reshape(rows, FINER, columns, FINER).min((1, 3)) for steps in arrivals]


def _first(arrivals: Sequence[Int[np.ndarray, "r c"]], radius: float, low: int, limit: int) -> int:
    """Return the first step from ``low`` on at which the team can have met, limit + 1 if none."""
    if low > limit or not _have_met(arrivals, radius, limit):
        return limit + 1
    high = limit
    while low < high:
        middle = (low + high) // 2
        if _have_met(arrivals, radius, middle):
            high = middle
        else:
            low = middle + 1
    return low


def _have_met(arrivals: Sequence[Int[np.ndarray, "r c"]], radius: float, step: int) -> bool:
    """Return whether there is a cell within a radius (in cells) of one where each robot can be.

    Args:
        arrivals: first step at which each robot can be in each cell.
        radius: in cells.
        step: at which they meet.
    """
    reached = [steps <= step for steps in arrivals]
    if not all(cells.any() for cells in reached):
        return False
    part = _around_all(reached, math.ceil(radius))
    together = np.ones(reached[0][part].shape, np.bool_)
    for cells in reached:
        away = (~cells[part]).astype(np.uint8)
        if away.all():
            return False
        together &= cv2.distanceTransform(away, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) <= radius
    return bool(together.any())


def _around_all(reached: Sequence[Bool[np.ndarray, "r c"]], radius: int) -> tuple[slice, slice]:
    """Return the rows and columns where what all robots reach comes within twice a radius."""
    parts: list[slice] = []
    for axis, size in enumerate(reached[0].shape):
        ends = [np.flatnonzero(cells.any(1 - axis))[[0, -1]] for cells in reached]
        low = max(int(first) for first, _ in ends) - 2 * radius
        high = min(int(last) for _, last in ends) + 2 * radius + 1
        parts.append(slice(max(low, 0), min(max(high, low, 1), size)))
    return parts[0], parts[1]
