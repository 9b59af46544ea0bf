"""Terms about where robots look."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.geometry import wrap_angle
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.task import Terminal
from hpp_framework.core.team import robot_index
from hpp_framework.core.term import Term
from hpp_framework.utils.errors import ConfigError

ROOM = 1.6
"""Metres beyond the distance of two robots that face each other at which they are sent to meet, and from
which on they turn to each other: so far apart, both can turn."""


class Facing(Term):
    """The angle between where two robots look and where the other one is.

    Args:
        first: index.
        second: index.
        apart: at which distance the two are sent to face each other, metres.
        slack: by which they may stand nearer or farther, metres.
    """

    def __init__(self, first: int, second: int, apart: float = 1.0, slack: float = 0.1) -> None:
        if first == second:
            raise ConfigError("a robot cannot face itself; name two.")
        self.pair = [first, second]
        self.apart = apart
        self.slack = slack

    def errors(self, poses: Float[Tensor, "*b n 3"]) -> Float[Tensor, "*b 2"]:
        """Return the angles of the first and the second, radians; unknown headings count as right."""
        own, other = poses[..., self.pair, :], poses[..., self.pair[::-1], :]
        bearing = torch.atan2(other[..., 1] - own[..., 1], other[..., 0] - own[..., 0])
        return wrap_angle(bearing - own[..., 2]).abs().nan_to_num(0.0)

    def targets(
        self, goals: Float[Tensor, "*#b 2"], poses: Float[Tensor, "*#b n 3"]
    ) -> Float[Tensor, "*c n 3"]:
        """Return places on both sides of the goal, each robot on its own; all others stay where they are.

        Skills care for places, not for headings. So two that are far apart are sent to where they can turn to
        each other, and two that are near look at each other from about where they are.
        """
        here = poses[..., self.pair, :2]
        between = here - here.flip(-2)
        gap = between.norm(dim=-1, keepdim=True)
        outward = between / gap.clamp(min=1e-6)
        near = gap < self.apart + ROOM
        stay = gap.clamp(self.apart - self.slack, self.apart + self.slack) / 2
        look = torch.atan2(-outward[..., 1:], -outward[..., :1]).where(near, torch.nan)
        away = torch.where(near, stay, (self.apart + ROOM) / 2)
        meant = goals[..., None, :] + outward * away
        targets = poses.expand(*meant.shape[:-2], -1, -1).clone()
        targets[..., self.pair, :] = torch.cat([meant, look.expand_as(meant[..., :1])], -1)
        return targets

    def terminal(self, poses: Float[Tensor, "b n 3"]) -> Terminal:
        """Return the middle between the two where they are near each other."""
        here = poses[:, self.pair, :2]
        gap = (here[:, 0] - here[:, 1]).norm(dim=-1)
        return Terminal(gap < self.apart + ROOM, here.mean(1), self.apart / 2)


def facing(
    robots: Sequence[RobotSpec], *, ids: Sequence[str], first: str, second: str, apart: float = 1.0
) -> Facing:
    """Build the term ``facing``: two robots, by their ids, look at each other."""
    del robots
    pair = robot_index(first, ids, "the first robot"), robot_index(second, ids, "the second robot")
    return Facing(*pair, apart)
