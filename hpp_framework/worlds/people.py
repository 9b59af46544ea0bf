"""Settles what a world leaves open about its people: where they start, where they walk, and how fast.

Evaluations and environments settle them for each episode, with a seed of the episode, so that all planners
and both simulators meet the same people::

    world = populate(world, robots, starts, rng)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import torch

from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.world import Person, World
from hpp_framework.utils.errors import ConfigError
from hpp_framework.worlds.occupancy import FreeSpace, free_space
from hpp_framework.worlds.paths import comfortable_paths

SPEED, SPEED_STD = 1.29, 0.19
"""Mean and spread of walking speeds in m/s (Moussaid et al. 2009, section 3a)."""
SLOWEST, FASTEST = 0.7, 1.9
"""Limits of drawn speeds in m/s: three standard deviations."""

PLACES = 6
"""Random places of an episode between which its people walk."""
STOPS = 3
"""Of them on the round of one person."""
MARGIN = 0.05
"""Gap between a person and an obstacle, at least, wherever it walks, in metres."""
COMFORT = 0.4
"""Gap to obstacles that paths and random places keep where there is room, in metres."""
ROBOT_GAP = 1.0
"""Gap between a person and a robot at the start, in metres."""
PERSON_GAP = 0.3
"""Gap between two people at the start, in metres."""
ATTEMPTS = 200
RESOLUTION = 0.1
STRIDE = 0.05
"""Metres between the points at which a straight line is checked for obstacles."""

Point = tuple[float, float]
Points = npt.NDArray[np.float64]


def populate(
    world: World,
    robots: Sequence[RobotSpec],
    starts: npt.NDArray[np.floating],
    rng: np.random.Generator,
    *,
    more: int = 0,
) -> World:
    """Return the world with people of whom nothing is left to chance.

    Args:
        world: the world; it comes back as it is if no person in it is open.
        robots: the team; people start 1 m away from it.
        starts: (n, 2) or (n, 3) poses of the robots; (0, 2) if they are unknown.
        rng: source of randomness.
        more: people to add who walk between random places.

    Raises:
        ConfigError: if there is no room for a person.
    """
    people = world.people + (Person(),) * more
    if all(person.settled for person in people):
        return world
    town = _Town(world, people, rng)
    settled: list[Person] = []
    places = np.asarray(starts, np.float64)[:, :2]
    near = np.array([robot.footprint_radius + ROBOT_GAP for robot in robots], np.float64)[: len(places)]
    for person in people:
        found = _settle(person, town, places, near, rng)
        settled.append(found)
        places = np.vstack([places, found.route[0]])
        near = np.append(near, found.radius + PERSON_GAP)
    return replace(world, people=tuple(settled))


def _settle(
    person: Person, town: _Town, taken: Points, near: npt.NDArray[np.float64], rng: np.random.Generator
) -> Person:
    """Return one person with a start, a route and a speed.

    Args:
        person: of whom something may be open.
        town: where it walks.
        taken: (k, 2) places that others start at.
        near: (k,) metres from them to the edge of this person, at least, where its start is open.
        rng: source of randomness.
    """
    speed = person.speed
    if speed is None:
        speed = float(np.clip(rng.normal(SPEED, SPEED_STD), SLOWEST, FASTEST))
    if person.waypoints and person.start is None:
        first, *rest = person.waypoints
        person = replace(person, start=first, waypoints=tuple(rest), speed=0.0 if not rest else speed)
    if person.waypoints or (person.start is not None and person.speed == 0):
        return replace(person, speed=speed if person.speed is None else person.speed)
    for attempt in range(ATTEMPTS):
        # under way first; where the paths are crowded, wherever there is room
        anywhere = attempt > ATTEMPTS // 2 and person.start is None
        route, loop = _route(replace(person, start=town.anywhere(rng)) if anywhere else person, town, rng)
        gaps = np.hypot(*(taken - route[0]).T)
        if person.start is not None or bool((gaps >= near + person.radius).all()):
            walks = len(route) > 1
            return replace(
                person, start=route[0], waypoints=tuple(route[1:]), goal=None, loop=loop,
                speed=speed if walks else 0.0,
            )  # fmt: skip
    raise ConfigError(
        f"{town.world.label}: 'people' finds no room for a person in {ATTEMPTS} tries. Use fewer people, or "
        "give each a 'start'."
    )


def _route(person: Person, town: _Town, rng: np.random.Generator) -> tuple[list[Point], bool]:
    """Return the places that a person walks along, its start first, and whether it walks round and round."""
    if person.goal is not None:
        start = person.start or town.draw(rng)
        return _joined([town.path(start, person.goal)]), False
    stops = [town.places[i] for i in rng.permutation(len(town.places))[:STOPS]]
    if person.start is not None:
        return _joined(_legs(town, [person.start, *stops])), True
    if person.speed == 0:
        return [town.draw(rng)], True
    points = _joined(_legs(town, stops))
    if len(points) < 2:
        return points, True
    return _entered(points, rng), True


def _legs(town: _Town, stops: Sequence[Point]) -> list[list[Point]]:
    """Return the paths from stop to stop and back to the first."""
    return [town.path(here, there) for here, there in pairwise([*stops, stops[0]])]


def _joined(legs: Sequence[Sequence[Point]]) -> list[Point]:
    """Return the points of paths that follow each other; of a round, the last is not the first again."""
    points = [legs[0][0]]
    for leg in legs:
        points += [point for point in leg[1:] if point != points[-1]]
    return points[:-1] if len(points) > 1 and points[-1] == points[0] else points


def _entered(points: list[Point], rng: np.random.Generator) -> list[Point]:
    """Return a round that begins at a random point of its length."""
    closed = np.array([*points, points[0]])
    lengths = np.hypot(*np.diff(closed, axis=0).T)
    along = rng.random() * lengths.sum()
    leg = min(int(np.searchsorted(np.cumsum(lengths), along)), len(points) - 1)
    share = (along - lengths[:leg].sum()) / max(lengths[leg], 1e-9)
    start = closed[leg] + share * (closed[leg + 1] - closed[leg])
    return [(float(start[0]), float(start[1])), *points[leg + 1 :], *points[: leg + 1]]


class _Town:
    """The free space of a world, random places in it, and the paths between places."""

    def __init__(self, world: World, people: Sequence[Person], rng: np.random.Generator) -> None:
        self.world = world
        self.radius = max(person.radius for person in people)
        self.space: FreeSpace = free_space(
            world, body_height=max(person.height for person in people), resolution=RESOLUTION
        )
        self._free = self.space.largest_region(self.radius + MARGIN)
        if not self._free.any():
            raise ConfigError(
                f"{world.label}: 'people' finds no place where a person of radius {self.radius:g} m fits. "
                "Use fewer obstacles, or no people."
            )
        self._fits = self._free
        roomy = self._free & (self.space.distance > self.radius + COMFORT)
        self._free = roomy if roomy.any() else self._free
        self.places = [self.draw(rng) for _ in range(PLACES)]
        self._paths: dict[tuple[Point, Point], list[Point]] = {}
        self._fields: dict[Point, npt.NDArray[np.float32]] = {}

    def draw(self, rng: np.random.Generator) -> Point:
        """Draw a free place with comfort around it."""
        x, y = self.space.sample(self._free, 1, rng)[0].tolist()
        return x, y

    def anywhere(self, rng: np.random.Generator) -> Point:
        """Draw a place where a person fits."""
        x, y = self.space.sample(self._fits, 1, rng)[0].tolist()
        return x, y

    def path(self, start: Point, end: Point) -> list[Point]:
        """Return the corners of a path, both ends included."""
        if (start, end) not in self._paths:
            straight = self._is_clear(start, end, self.radius + COMFORT)
            self._paths[start, end] = [start, end] if straight else self._around(start, end)
        return self._paths[start, end]

    def _around(self, start: Point, end: Point) -> list[Point]:
        points = self._descend(start, end)
        corners, index = [start], 0
        # as far as can be seen, over and over
        while index < len(points) - 1:
            following = self._farthest_seen(points, index, COMFORT)
            if following == index + 1:
                following = self._farthest_seen(points, index, 2 * MARGIN)
            corners.append(points[following])
            index = following
        return corners

    def _farthest_seen(self, points: Sequence[Point], index: int, gap: float) -> int:
        """Return the last of the points that is reached in a straight line, or else the next."""
        following = index + 1
        while following + 1 < len(points) and self._is_clear(
            points[index], points[following + 1], self.radius + gap
        ):
            following += 1
        return following

    def _descend(self, start: Point, end: Point) -> list[Point]:
        """Return every third cell on the way down to the end of the field of path lengths."""
        if end not in self._fields:
            goal = torch.tensor([end], dtype=torch.float32)
            paths = comfortable_paths([self.space], self.radius, COMFORT, goal, torch.zeros(1).long())
            self._fields[end] = np.pad(paths.values[0].numpy(), 1, constant_values=np.inf)
        field = self._fields[end]
        low, step = np.array(self.space.origin), self.space.resolution
        limits = np.array(self.space.distance.shape)[::-1] - 1
        column, row = np.clip(np.floor((np.array(start) - low) / step), 0, limits).astype(int).tolist()
        cells = [(column, row)]
        while True:
            around = field[row : row + 3, column : column + 3]
            down, across = divmod(int(around.argmin()), 3)
            if (down, across) == (1, 1):
                break
            row, column = row + down - 1, column + across - 1
            cells.append((column, row))
        middle = [
            (float(low[0] + (c + 0.5) * step), float(low[1] + (r + 0.5) * step)) for c, r in cells[3::3]
        ]
        return [start, *middle, end]

    def _is_clear(self, start: Point, end: Point, gap: float) -> bool:
        count = int(np.hypot(end[0] - start[0], end[1] - start[1]) / STRIDE) + 2
        points = np.linspace(start, end, count)
        return bool((self.space.at(points) >= gap).all())
