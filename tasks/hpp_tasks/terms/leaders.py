"""Terms about one robot that the others cannot command: a leader, a stranger."""

from __future__ import annotations

import math
from collections.abc import Sequence

from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.requirement import AnyOf, Requirement
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.task import any_heading
from hpp_framework.core.team import robot_index
from hpp_framework.core.term import Term
from hpp_tasks.terms.distances import Between
from hpp_tasks.terms.shapes import circle, in_order


class Escort(Between):
    """By how much each follower is too near to a leader, or too far; nothing else is asked of the leader.

    The shared goal is where the leader goes. The others are sent to a circle around it, in the order in which
    they stand around the leader.

    Args:
        count: robots.
        leader: index.
        least: distance from the leader, metres.
        most: the same.
    """

    def __init__(self, count: int, leader: int, least: float, most: float) -> None:
        self.followers = [robot for robot in range(count) if robot != leader]
        super().__init__([(leader, each) for each in self.followers], [least] * len(self.followers), most)
        self.leader = leader
        self.circle = circle(len(self.followers), (least + most) / 2)

    def targets(
        self, goals: Float[Tensor, "*#b 2"], poses: Float[Tensor, "*#b n 3"]
    ) -> Float[Tensor, "*c n 3"]:
        """Return the goal itself for the leader, and places around it for the others."""
        around = poses[..., self.followers, :2] - poses[..., self.leader, None, :2]
        stations = goals[..., None, :] + in_order(self.circle, around)
        places = goals[..., None, :].expand(*stations.shape[:-2], poses.shape[-2], -1).clone()
        places[..., self.followers, :] = stations
        return any_heading(places)


class Caught(Term):
    """How far the nearest pursuer is from the one it pursues, beyond a distance.

    Args:
        pursuers: the distances of all.
    """

    def __init__(self, pursuers: Between) -> None:
        self.pursuers = pursuers

    def errors(self, poses: Float[Tensor, "*b n 3"]) -> Float[Tensor, "*b 1"]:
        """Return the distance of the nearest beyond what counts as caught, metres."""
        return self.pursuers.errors(poses).amin(-1, keepdim=True)

    def requirement(self, limit: float) -> Requirement:
        """Return that one of them has come near."""
        each = [Between([pair], [0.0], self.pursuers.most) for pair in self.pursuers.chosen]
        return AnyOf(tuple(one.requirement(limit) for one in each))


def pursuers(count: int, stranger: int, near: float) -> Between:
    """Return how far each pursuer is from a stranger, beyond a distance in metres."""
    others = [robot for robot in range(count) if robot != stranger]
    return Between([(stranger, each) for each in others], [0.0] * len(others), near)


def escort(
    robots: Sequence[RobotSpec],
    *,
    ids: Sequence[str],
    leader: str,
    least: float = 0.0,
    most: float = math.inf,
) -> Escort:
    """Build the term ``escort``: the distances of all others from a leader, by its id."""
    return Escort(len(robots), robot_index(leader, ids, "the leader"), least, most)


def caught(robots: Sequence[RobotSpec], *, ids: Sequence[str], stranger: str, near: float = 1.0) -> Caught:
    """Build the term ``caught``: the distance of the nearest robot from a stranger, by its id."""
    return Caught(pursuers(len(robots), robot_index(stranger, ids, "the stranger"), near))
