"""Terms about where robots look."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.errors import ConfigError
from hpp_framework.geometry import wrap_angle
from hpp_framework.robot import RobotSpec
from hpp_framework.task_choice import robot_index
from hpp_framework.term import Term

LOOKING = 0.5
"""Radians within which a robot looks at another."""
ROOM = 1.6
"""Metres beyond the distance of two robots that face each other at which both can turn."""
SPARE = 0.4
"""Metres by which they may miss that."""
CLOSER = 0.7
"""Share of their distance that they come to when they drive towards each other."""
AGREED = 3.0
"""Metres from the middle between the two within which a goal means to meet right here."""


class Facing(Term):
    """The angle between where two robots look and where the other one is.

    Args:
        first: index.
        second: index.
        apart: at which distance the two are sent to face each other, metres.
    """

    def __init__(self, first: int, second: int, apart: float = 1.0) -> None:
        if first == second:
            raise ConfigError("a robot cannot face itself; name two.")
        self.pair = [first, second]
        self.apart = apart

    def errors(self, poses: Float[Tensor, "*b n 3"]) -> Float[Tensor, "*b 2"]:
        """Return the angles of the first and the second, radians; unknown headings count as right."""
        own, other = poses[..., self.pair, :], poses[..., self.pair[::-1], :]
        bearing = torch.atan2(other[..., 1] - own[..., 1], other[..., 0] - own[..., 0])
        return wrap_angle(bearing - own[..., 2]).abs().nan_to_num(0.0)

    def places(
        self, goals: Float[Tensor, "*#b 2"], poses: Float[Tensor, "*#b n 3"]
    ) -> Float[Tensor, "*c n 2"]:
        """Return places on both sides of the goal, each robot on its own; all others stay where they are.

        Skills care for places, not for headings, and do not turn towards what is in their way. So two first
        come to where both can turn, and then towards each other, farther than they have to; one that is too
        near to turn, or on its way out, leaves again.
        """
        here = poses[..., self.pair, :2]
        between = here - here.flip(-2)
        gap = between.norm(dim=-1, keepdim=True)
        outward = between / gap.clamp(min=1e-6)
        middle = here.mean(-2, keepdim=True)
        aside = self.errors(poses)[..., None]
        looks, room = aside < LOOKING, self.apart + ROOM
        crowded = gap < self.apart
        # one that looks waits for the other; two that look and still are not done are too near
        too_near = crowded & (~looks | looks.all(-2, keepdim=True))
        leaving = ~crowded & (aside > math.pi / 2) & (gap < room - SPARE)
        closer = torch.where(crowded, here, middle + outward * (CLOSER * self.apart / 2))
        near = torch.where(too_near | leaving, middle + outward * (room / 2), closer)
        goal = goals[..., None, :]
        close = (gap < room + SPARE) & ((goal - middle).norm(dim=-1, keepdim=True) < AGREED)
        meant = torch.where(close, near, goal + outward * (room / 2))
        places = poses[..., :2].expand(*meant.shape[:-2], -1, -1).clone()
        places[..., self.pair, :] = meant
        return places


def facing(
    robots: Sequence[RobotSpec], *, ids: Sequence[str], first: str, second: str, apart: float = 1.0
) -> Facing:
    """Build the term ``facing``: two robots, by their ids, look at each other."""
    del robots
    pair = robot_index(first, ids, "the first robot"), robot_index(second, ids, "the second robot")
    return Facing(*pair, apart)
