"""The least time in which robots can be near one place, wherever that is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import torch
from jaxtyping import Float, Int

from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.world import World
from hpp_framework.evaluation.gathering import coarser, first_met, meeting_box
from hpp_framework.evaluation.reach import PERIODS, Reach
from hpp_framework.evaluation.standing import FINER, Part, finer, standing_room
from hpp_framework.evaluation.ways import ALLOWANCE, DOUBT, cut, is_open
from hpp_framework.worlds.geodesic import shortest_ways
from hpp_framework.worlds.occupancy import RESOLUTION, FreeSpace, free_space

Array = npt.NDArray[np.float64]

HALF_CELL = RESOLUTION / math.sqrt(2)
"""Metres from the centre of a cell to its farthest point."""
SLACK = HALF_CELL + 1e-3
"""Metres by which robots may be further from a cell's centre than from the true meeting place in it."""
FIRST_TRY = 3
"""Control periods beyond the least time in the open that are looked ahead first."""
GROWTH = 1.4
"""By which factor more are looked ahead next."""
SPARE = 0.5
"""Metres by which a way on the grid may swerve from the shortest one, at most."""
COARSER = 4
"""Cells of a free space along a cell that the time is guessed on."""
UNREACHED = 1e6


def first_meeting(
    world: World,
    starts: Float[np.ndarray, "n 3"],
    robots: Sequence[RobotSpec],
    radius: float,
    members: Sequence[int] | None = None,
) -> float:
    r"""Return the first control step before which robots cannot be near one place, wherever that is.

    There is a place ``c`` that every robot ``i`` has come within the radius of, so

    .. math:: T \ge \min_c \max_i t_i(c),

    where ``t_i(c)`` is the least time, in whole control periods, in which robot ``i`` gets there: the longer
    of the time for the shortest way around the obstacles, inflated by its footprint, and of the time for the
    straight distance with the turn that must come first; see :class:`~hpp_framework.evaluation.reach.Reach`.

    Speeds at the end are left free, although success mostly asks for little relative speed: robots may meet
    side by side on the same course, and whoever touches something stops at once.

    Args:
        world: the world.
        starts: start poses of the team, at rest.
        robots: the team.
        radius: metres.
        members: indices of the robots that meet; None for everybody.

    Returns:
        The step, at least 1; infinity if they cannot meet within a minute.
    """
    reaches = [Reach(robot.drive) for robot in robots]
    everybody = _Meeting(world, starts.astype(np.float64), robots, reaches, radius)
    return (everybody if members is None else everybody.of(members)).first_step()


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

    def of(self, members: Sequence[int]) -> _Meeting:
        """Return the search for some of the robots; what the others take of their room stays taken."""
        part = copy(self)
        part.poses = self.poses[list(members)]
        for name in ("robots", "reaches", "spaces", "rooms"):
            setattr(part, name, [getattr(self, name)[i] for i in members])
        return part

    def first_step(self) -> float:
        """Return the first control step at which the team can have met, infinity if it never can."""
        limit, guessed = self._in_the_open() + FIRST_TRY, False
        while limit <= PERIODS:
            low, is_open = self._straight_on(limit)
            if is_open:
                return max(low, 1)
            if low <= limit:
                # looking ahead too far is as dear as looking ahead once more
                limit = limit if guessed else max(self._guess(), limit)
                guessed = True
                found = self._around_obstacles(low, limit)
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

    def _straight_on(self, limit: int) -> tuple[int, bool]:
        """Return the first step at which the team can have met, were there no obstacles.

        Returns:
            The step, limit + 1 if it comes later, and whether certainly none is in the way.
        """
        places = self._places(limit)
        if min(places.shape) == 0:
            return limit + 1, False
        centres = places.centres(self.spaces[0])
        steps = [self._straight(i, centres, self.radius, limit) for i in range(len(self.robots))]
        straight = np.stack(steps).max(0)
        best = int(straight.argmin())
        return int(straight[best]), bool(straight[best] <= limit) and self._in_sight(centres[best])

    def _guess(self) -> int:
        """Return about when the team can have met, from a grid of few cells; 0 if that has no answer."""
        arrivals: list[Int[np.ndarray, "r c"]] = []
        for i, (robot, space) in enumerate(zip(self.robots, self.spaces, strict=True)):
            distance = space.distance[COARSER // 2 :: COARSER, COARSER // 2 :: COARSER]
            rough = FreeSpace(distance, space.origin, space.resolution * COARSER)
            lengths = self._lengths(i, rough, robot.footprint_radius + rough.resolution)
            whole = Part((0, 0), distance.shape)
            straight = self._straight(i, whole.centres(rough), 0.0, PERIODS)
            around = self.reaches[i].driving(lengths.ravel(), PERIODS)
            arrivals.append(np.maximum(straight, around).reshape(distance.shape))
        radius = self.radius / (RESOLUTION * COARSER)
        found = first_met(lambda step: meeting_box(arrivals, radius, step) is not None, 1, PERIODS)
        return found if found <= PERIODS else 0

    def _around_obstacles(self, low: int, limit: int) -> int:
        """Return the first step at which everybody can stand somewhere within the radius of one place.

        Where each robot can stand is known to the fine grid: walls may be just too thick to meet across. The
        coarse grid is quick, and never later.
        """
        around = self._places(limit).grown(math.ceil(self.radius / RESOLUTION) + 1, self.spaces[0])
        coarse, fine = self._cells(RESOLUTION), self._cells(RESOLUTION / FINER)
        arrivals = [self._arrivals(i, around, limit) for i in range(len(self.robots))]
        roughly, margin = coarser(arrivals), math.ceil(fine) + 1

        def have_met(step: int) -> bool:
            box = meeting_box(roughly, coarse, step)
            if box is None:
                return False
            rows, columns = (
                slice(max(FINER * cells.start - margin, 0), FINER * cells.stop + margin) for cells in box
            )
            return meeting_box([steps[rows, columns] for steps in arrivals], fine, step) is not None

        low = first_met(lambda step: meeting_box(roughly, coarse, step) is not None, low, limit)
        return first_met(have_met, low, limit)

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
        return self.reaches[robot].towards(self.poses[robot], points, radius, self.rooms[robot], limit)

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
        # one of the cells in doubt is taken off there
        radius = self.robots[robot].footprint_radius - (DOUBT - 1) * step
        needed = _on_the_way(cut(space, low, high), start, part.corners(space), far + SPARE)
        field = self._lengths(robot, needed, radius)
        least = part.of(field, low, UNREACHED) * (1 - share) - metres
        return self.reaches[robot].driving(least.ravel(), limit).reshape(part.shape)

    def _lengths(self, robot: int, space: FreeSpace, radius: float) -> Float[np.ndarray, "r c"]:
        """Return the length of the shortest way of a disc from where a robot starts to each cell, metres."""
        start = torch.from_numpy(self.poses[robot, None, :2]).float()
        lengths = shortest_ways([space], radius, start, torch.zeros(1, dtype=torch.long)).values
        return np.minimum(lengths.double().numpy().reshape(space.distance.shape), UNREACHED)

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


def _on_the_way(
    space: FreeSpace, start: Float[np.ndarray, "2"], corners: Float[np.ndarray, "2 2"], length: float
) -> FreeSpace:
    """Return a free space without the cells that lie on no way of a length into a rectangle.

    Args:
        space: the free space.
        start: of the ways, in metres.
        corners: of the rectangle: least and greatest (x, y), in metres.
        length: in metres.
    """
    rows, columns = space.distance.shape
    x = space.origin[0] + (np.arange(columns) + 0.5) * space.resolution
    y = space.origin[1] + (np.arange(rows)[:, None] + 0.5) * space.resolution
    (left, low), (right, high) = corners
    left_to_go = np.hypot((left - x).clip(0) + (x - right).clip(0), (low - y).clip(0) + (y - high).clip(0))
    needed = np.hypot(x - start[0], y - start[1]) + left_to_go <= length
    return replace(space, distance=np.where(needed, space.distance, 0))
