"""Terms about where in the world robots are."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.requirement import Gathering, Requirement
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.team import robot_index
from hpp_framework.core.term import Term
from hpp_framework.utils.errors import ConfigError


class Region(Term):
    """How far robots are from a disc.

    Args:
        robots: indices.
        centre: (x, y), world frame, metres.
        radius: metres.
    """

    def __init__(self, robots: Sequence[int], centre: tuple[float, float], radius: float) -> None:
        if radius < 0:
            raise ConfigError(f"the radius of a region must be 0 or more, got {radius}.")
        self.robots = list(robots)
        self.centre = centre
        self.radius = radius

    def errors(self, poses: Float[Tensor, "*b n 3"]) -> Float[Tensor, "*b k"]:
        """Return the distances beyond the radius, metres."""
        x, y = poses[..., self.robots, 0], poses[..., self.robots, 1]
        return (torch.hypot(x - self.centre[0], y - self.centre[1]) - self.radius).clamp(min=0)

    def requirement(self, limit: float) -> Requirement:
        """Return that all of the robots have come to the disc."""
        return Gathering(self.radius + limit, tuple(self.robots), self.centre)


class Coverage(Term):
    """How far points of an area are from the nearest robot, beyond what that robot covers.

    Args:
        points: of the area, world frame, metres.
        radius: that a robot covers, metres.
    """

    def __init__(self, points: Float[Tensor, "p 2"], radius: float) -> None:
        self.points = points
        self.radius = radius

    def errors(self, poses: Float[Tensor, "*b n 3"]) -> Float[Tensor, "*b p"]:
        """Return the distances of the points beyond the radius, metres."""
        x, y = poses[..., None, 0], poses[..., None, 1]
        points = self.points.to(poses)
        away = torch.hypot(x - points[:, :1], y - points[:, 1:]).amin(-1)
        return (away - self.radius).clamp(min=0)


def region(
    robots: Sequence[RobotSpec],
    *,
    ids: Sequence[str],
    x: float,
    y: float,
    radius: float = 0.0,
    only: str = "",
) -> Region:
    """Build the term ``region``; ``only`` names the one robot that it is about, otherwise all."""
    chosen = [robot_index(only, ids, "the robot")] if only else range(len(robots))
    return Region(chosen, (x, y), radius)


def coverage(
    robots: Sequence[RobotSpec],
    *,
    left: float,
    bottom: float,
    right: float,
    top: float,
    radius: float = 3.0,
    points: int = 5,
) -> Coverage:
    """Build the term ``coverage`` of a rectangle, looked at on a grid of ``points`` by ``points``.

    Raises:
        ConfigError: if the rectangle is empty or the grid has fewer than two points per side.
    """
    del robots
    if not (left < right and bottom < top) or points < 2:
        raise ConfigError(
            f"coverage needs left < right, bottom < top and points >= 2, got {left:g}, {right:g}, "
            f"{bottom:g}, {top:g} and {points}."
        )
    grid = torch.cartesian_prod(torch.linspace(left, right, points), torch.linspace(bottom, top, points))
    return Coverage(grid, radius)
