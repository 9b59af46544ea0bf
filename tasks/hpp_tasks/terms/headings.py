"""Terms about where robots look."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.errors import ConfigError
from hpp_framework.geometry import wrap_angle
from hpp_framework.robot import RobotSpec
from hpp_framework.task_choice import robot_index
from hpp_framework.term import Term

NEAR = 0.3
"""Metres beyond the distance of two robots that face each other from which they turn to each other."""
LOOKING = 0.35
"""Radians within which a robot looks at another."""


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

        Skills care for places, not for headings. So a robot that is near the other one and looks elsewhere is
        sent towards it, which turns it round, and one that looks right waits.
        """
        here = poses[..., self.pair, :2]
        between = here - here.flip(-2)
        gap = between.norm(dim=-1, keepdim=True)
        sides = goals[..., None, :] + between / gap.clamp(min=1e-6) * (self.apart / 2)
        looks = (self.errors(poses) < LOOKING)[..., None]
        near = (gap < self.apart + NEAR).expand_as(sides)
        meant = torch.where(near, torch.where(looks, here, here.flip(-2)).expand_as(sides), sides)
        places = poses[..., :2].expand(*sides.shape[:-2], -1, -1).clone()
        places[..., self.pair, :] = meant
        return places


def facing(
    robots: Sequence[RobotSpec], *, ids: Sequence[str], first: str, second: str, apart: float = 1.0
) -> Facing:
    """Build the term ``facing``: two robots, by their ids, look at each other."""
    del robots
    pair = robot_index(first, ids, "the first robot"), robot_index(second, ids, "the second robot")
    return Facing(*pair, apart)
