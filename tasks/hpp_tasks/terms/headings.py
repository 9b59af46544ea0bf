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


class Facing(Term):
    """The angle between where two robots look and where the other one is.

    Args:
        first: index.
        second: index.
    """

    def __init__(self, first: int, second: int) -> None:
        if first == second:
            raise ConfigError("a robot cannot face itself; name two.")
        self.pair = [first, second]

    def errors(self, poses: Float[Tensor, "*b n 3"]) -> Float[Tensor, "*b 2"]:
        """Return the angles of the first and the second, radians; unknown headings count as right."""
        own, other = poses[..., self.pair, :], poses[..., self.pair[::-1], :]
        bearing = torch.atan2(other[..., 1] - own[..., 1], other[..., 0] - own[..., 0])
        return wrap_angle(bearing - own[..., 2]).abs().nan_to_num(0.0)


def facing(robots: Sequence[RobotSpec], *, ids: Sequence[str], first: str, second: str) -> Facing:
    """Build the term ``facing``: two robots, by their ids, look at each other."""
    del robots
    return Facing(robot_index(first, ids, "the first robot"), robot_index(second, ids, "the second robot"))
