"""The shortest ways of a footprint between two places, and what no way is shorter than."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt
import torch
from jaxtyping import Float, Int

from hpp_framework.worlds.geodesic import shortest_ways
from hpp_framework.worlds.occupancy import FreeSpace

Array = npt.NDArray[np.float64]

DOUBT = 2.0
"""Cells by which a free space may call an obstacle nearer than it is: half a cell taken off on purpose, 0.71
to where in its cell the obstacle is, 0.71 to where in its own the robot is."""
ALLOWANCE = (0.1, 0.02)
"""Metres, and share of the length, by which a way on the grid may come out too long."""
DETOUR = 0.3
"""Metres by which a way must be longer than the straight line to be worth a bound of its own."""
FIRST_TRY = (1.2, 1.5)
"""Length that a way is first expected to have at most: share of the straight line, and metres on top."""


@dataclass(frozen=True)
class Ways:
    """Ways from starts to goals; every array has one entry a journey, in metres.

    Attributes:
        straight: distance from start to goal.
        shortest: length of the shortest way of the footprint to the goal.
        least: what any way to within the goal radius is long, at least.
        room: gap between the footprint at the start and the nearest obstacle, at least.
    """

    straight: Float[np.ndarray, "b"]
    shortest: Float[np.ndarray, "b"]
    least: Float[np.ndarray, "b"]
    room: Float[np.ndarray, "b"]

    @staticmethod
    def concatenate(parts: Sequence[Ways]) -> Ways:
        """Return the ways of all parts, one after the other."""
        return Ways(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Ways)))


def journey_ways(
    spaces: Sequence[FreeSpace],
    radius: float,
    starts: Float[np.ndarray, "b 2"],
    goals: Float[np.ndarray, "b 2"],
    *,
    goal_radius: float,
) -> Ways:
    """Return the ways from starts to goals around obstacles inflated by the footprint.

    Where the straight line is free it is the way. Elsewhere the way is found on the grid: for the footprint's
    own radius, ``shortest``, and with obstacles drawn :data:`DOUBT` cells smaller and less :data:`ALLOWANCE`,
    ``least``, which no true way is shorter than.

    Args:
        spaces: free space of each journey's world, all of one resolution.
        radius: of the footprint, in metres.
        starts: in metres.
        goals: in metres.
        goal_radius: distance at which a goal is reached, in metres.
    """
    straight = np.linalg.norm(goals - starts, axis=1)
    shortest, least = straight.copy(), straight - goal_radius
    journeys = zip(spaces, starts, goals, strict=True)
    around = np.flatnonzero(np.array([not is_open(space, radius, *ends) for space, *ends in journeys]))
    if len(around):
        found = _to_goals([spaces[i] for i in around.tolist()], radius, starts[around], goals[around])
        shortest[around] = _longer(straight[around], found)
    around = np.flatnonzero(shortest > straight + DETOUR)
    if len(around):
        rooms = [spaces[i] for i in around.tolist()]
        found = _to_discs(rooms, radius, starts[around], goals[around], goal_radius)
        least[around] = _longer(least[around], found)
    room = np.array(
        [float(space.at(start[None])[0]) - radius for space, start in zip(spaces, starts, strict=True)]
    )
    return Ways(straight, shortest, least, np.maximum(room - spaces[0].resolution, 0))


def _longer(length: Array, other: Array) -> Array:
    """Return the longer lengths; a grid that finds no way says nothing."""
    return np.maximum(length, np.where(np.isfinite(other), other, 0))


def is_open(
    space: FreeSpace, radius: float, start: Float[np.ndarray, "2"], goal: Float[np.ndarray, "2"]
) -> bool:
    """Return whether a disc certainly fits everywhere on the straight line from start to goal."""
    count = int(np.ceil(np.linalg.norm(goal - start) / (space.resolution / 2))) + 1
    return bool((space.at(np.linspace(start, goal, count)) > radius).all())


def _to_goals(spaces: Sequence[FreeSpace], radius: float, starts: Array, goals: Array) -> Array:
    """Return the length of the shortest ways, infinite where the grid has none."""
    return _nearest(spaces, radius, starts, goals, np.zeros((1, 2)))


def _to_discs(
    spaces: Sequence[FreeSpace], radius: float, starts: Array, goals: Array, goal_radius: float
) -> Array:
    """Return what ways from starts to the nearest point of the discs around goals are long, at least.

    A point of the disc may lie behind a thin wall from the goal; arriving there counts all the same.
    """
    step = spaces[0].resolution
    axis = np.arange(-goal_radius, goal_radius + step / 2, step)
    grid = np.stack(np.meshgrid(axis, axis), -1).reshape(-1, 2)
    disc = grid[np.hypot(grid[:, 0], grid[:, 1]) <= goal_radius]
    # one of the cells in doubt is taken off there
    found = _nearest(spaces, radius - (DOUBT - 1) * step, starts, goals, disc)
    metres, share = ALLOWANCE
    return found * (1 - share) - metres


def _nearest(
    spaces: Sequence[FreeSpace], radius: float, starts: Array, goals: Array, disc: Float[np.ndarray, "p 2"]
) -> Array:
    """Return the length of the shortest way to any point of a disc around each goal.

    Ways of a length stay in the ellipse around their ends. So a part of the grid is tried first, and all of
    it where the way turns out longer than that part allows for.
    """
    length = np.linalg.norm(goals - starts, axis=1) * FIRST_TRY[0] + FIRST_TRY[1]
    ellipses = zip(spaces, starts, goals, length.tolist(), strict=True)
    found = _solve([_around(*ellipse) for ellipse in ellipses], radius, starts, goals, disc)
    longer = np.flatnonzero(found > length - 1)
    if len(longer):
        rooms = [spaces[i] for i in longer.tolist()]
        found[longer] = _solve(rooms, radius, starts[longer], goals[longer], disc)
    return found


def _solve(spaces: Sequence[FreeSpace], radius: float, starts: Array, goals: Array, disc: Array) -> Array:
    index = torch.arange(len(spaces))
    ways = shortest_ways(spaces, radius, torch.from_numpy(starts).float(), index)
    points = torch.from_numpy(goals[:, None] + disc).float().flatten(0, 1)
    found = ways.at(index.repeat_interleave(len(disc)), points)
    return found.reshape(len(spaces), -1).amin(1).double().numpy()


def _around(space: FreeSpace, start: Array, goal: Array, length: float) -> FreeSpace:
    """Return the part of a free space that holds every way of a length, and half a metre around it."""
    offset = goal - start
    along = offset / np.linalg.norm(offset)
    narrow = length**2 - float(offset @ offset)
    half = np.sqrt((length * along) ** 2 + narrow * along[::-1] ** 2) / 2 + 0.5
    middle = (start + goal) / 2 - np.array(space.origin)
    rows, columns = space.distance.shape
    low = np.floor((middle - half) / space.resolution).astype(int).clip(0)
    high = np.ceil((middle + half) / space.resolution).astype(int).clip(max=(columns, rows))
    return cut(space, low, high)


def cut(space: FreeSpace, low: Int[np.ndarray, "2"], high: Int[np.ndarray, "2"]) -> FreeSpace:
    """Return a part of a free space.

    Args:
        space: the whole.
        low: first column and row of the part.
        high: column and row behind its last.
    """
    corner = np.array(space.origin) + low * space.resolution
    return FreeSpace(
        distance=space.distance[low[1] : high[1], low[0] : high[0]],
        origin=(float(corner[0]), float(corner[1])),
        resolution=space.resolution,
    )
