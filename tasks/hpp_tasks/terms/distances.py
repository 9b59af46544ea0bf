"""Terms about how far robots are from each other."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.requirement import AllOf, Apart, Gathering, Requirement
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.task import any_heading
from hpp_framework.core.team import robot_index
from hpp_framework.core.term import Term
from hpp_framework.utils.errors import ConfigError
from hpp_tasks.terms.shapes import in_order, ring

ROOM = 0.5
"""Metres by which neighbours on a ring are farther apart than they must be."""


def pair_distances(poses: Float[Tensor, "*b n 3"]) -> Float[Tensor, "*b k"]:
    """Return the distance of each pair of robots, metres, in the order of :func:`pairs`."""
    one, other = torch.triu_indices(poses.shape[-2], poses.shape[-2], 1, device=poses.device)
    x, y = poses[..., 0], poses[..., 1]
    # components, not vectors: norms over an axis of two are slow
    return torch.hypot(x[..., one] - x[..., other], y[..., one] - y[..., other])


def pairs(count: int) -> list[tuple[int, int]]:
    """Return the pairs of so many robots."""
    return [(one, other) for one in range(count) for other in range(one + 1, count)]


class Spread(Term):
    """The distance of each pair: what Eq. 1 sums, there with weight 2."""

    def errors(self, poses: Float[Tensor, "*b n 3"]) -> Float[Tensor, "*b k"]:
        """Return the distances of all pairs, metres."""
        return pair_distances(poses)


class Gather(Term):
    """How far each robot is from the team's centre, beyond a radius.

    Args:
        radius: metres.
    """

    def __init__(self, radius: float) -> None:
        self.radius = radius

    def errors(self, poses: Float[Tensor, "*b n 3"]) -> Float[Tensor, "*b n"]:
        """Return the distances beyond the radius, metres."""
        x, y = poses[..., 0], poses[..., 1]
        away = torch.hypot(x - x.mean(-1, keepdim=True), y - y.mean(-1, keepdim=True))
        return (away - self.radius).clamp(min=0)

    def requirement(self, limit: float) -> Requirement:
        """Return that there is a place that all have come near to."""
        return Gathering(self.radius + limit)


class Between(Term):
    """By how much the distances of chosen pairs are below one value or above another.

    Args:
        chosen: pairs of indices.
        least: metres, one entry per pair.
        most: metres.
    """

    def __init__(
        self, chosen: Sequence[tuple[int, int]], least: Sequence[float], most: float = math.inf
    ) -> None:
        self.chosen = tuple(chosen)
        self.least = tuple(least)
        self.most = most
        if not all(0 <= low <= most for low in least):
            raise ConfigError(f"least must lie between 0 and most ({most:g} m), got {max(least):g} m.")
        self._one, self._other = (torch.tensor([pair[i] for pair in chosen]).long() for i in (0, 1))
        self._least = torch.tensor(self.least)

    def errors(self, poses: Float[Tensor, "*b n 3"]) -> Float[Tensor, "*b k"]:
        """Return how much too near or too far the robots of each pair are, metres."""
        x, y = poses[..., 0], poses[..., 1]
        one, other = self._one, self._other
        apart = torch.hypot(x[..., one] - x[..., other], y[..., one] - y[..., other])
        return (self._least - apart).clamp(min=0) + (apart - self.most).clamp(min=0)

    def requirement(self, limit: float) -> Requirement:
        """Return what the distances must be."""
        parts: list[Requirement] = [
            Apart(*pair, low - limit)
            for pair, low in zip(self.chosen, self.least, strict=True)
            if low > limit
        ]
        if self.most < math.inf:
            # both are within half the distance of the middle between them
            parts += [Gathering((self.most + limit) / 2, pair) for pair in self.chosen]
        return AllOf(tuple(parts))


class Spaced(Between):
    """The same of all pairs; robots are sent to a ring around a shared goal on which all have room.

    Args:
        least: metres, one entry per pair in the order of :func:`pairs`.
        most: metres.
        count: robots.
    """

    def __init__(self, least: Sequence[float], most: float, count: int) -> None:
        super().__init__(pairs(count), least, most)
        widest = max(least, default=0.0) + ROOM
        self.ring = ring(count, widest if widest <= most else (max(least, default=0.0) + most) / 2)

    def targets(
        self, goals: Float[Tensor, "*#b 2"], poses: Float[Tensor, "*#b n 3"]
    ) -> Float[Tensor, "*c n 3"]:
        """Return places on the ring, in the order in which robots stand around their middle.

        The ring is turned so that they drive the least distance.
        """
        off = poses[..., :2] - poses[..., :2].mean(-2, keepdim=True)
        return any_heading(goals[..., None, :] + in_order(self.ring, off))


def spread(robots: Sequence[RobotSpec]) -> Spread:
    """Build the term ``spread``."""
    del robots
    return Spread()


def gather(robots: Sequence[RobotSpec], *, radius: float) -> Gather:
    """Build the term ``gather``."""
    del robots
    return Gather(radius)


def spacing(robots: Sequence[RobotSpec], *, least: float = 0.0, most: float = math.inf) -> Spaced:
    """Build the term ``spacing``: the distance between the centres of every two robots."""
    return Spaced([least] * len(pairs(len(robots))), most, len(robots))


def clearance(robots: Sequence[RobotSpec], *, least: float = 0.3) -> Spaced:
    """Build the term ``clearance``: the gap between the footprints of every two robots."""
    radii = [robot.footprint_radius for robot in robots]
    every = [least + radii[one] + radii[other] for one, other in pairs(len(robots))]
    return Spaced(every, math.inf, len(robots))


def distance(
    robots: Sequence[RobotSpec],
    *,
    ids: Sequence[str],
    first: str,
    second: str,
    least: float = 0.0,
    most: float = math.inf,
) -> Between:
    """Build the term ``distance``: between two robots, by their ids."""
    del robots
    pair = robot_index(first, ids, "the first robot"), robot_index(second, ids, "the second robot")
    if pair[0] == pair[1]:
        raise ConfigError(f"the two robots of a distance must differ, got '{first}' twice.")
    return Between([pair], [least], most)
