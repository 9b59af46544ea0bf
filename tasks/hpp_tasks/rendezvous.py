"""Rendezvous: all robots within a distance of the team's centre, at rest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.task import Task, Terminal, any_heading, relative_speed
from hpp_tasks.target_slots import target_slots

MARGIN = 0.25
"""Metres between touching discs in a ring and a rendezvous."""

SPARE = 0.17
"""Metres by which targets lie within the radius of a rendezvous of three and more."""

APART = 0.09
"""Metres from footprint to footprint on neighbouring targets."""

NEARLY = 2.0
"""Metres beyond the radius within which robots of three and more have nearly gathered."""

NEARLY_OF_TWO = 1.0
"""The same of two: while they are far apart, their middle says little about the path to it."""

CLEAR = 0.1
"""Metres that the middle of a gathering is kept from things that stand still, beyond the radius."""

REST_SPEED = 0.1
"""Largest relative speed of a sustained rendezvous, m/s."""


def rendezvous_radius(robots: Sequence[RobotSpec]) -> float:
    """Return d(n) = r / sin(pi / n) + 0.25 m: the largest footprints fit in a ring around the centre.

    The paper never gives d; see docs/paper.md.
    """
    if len(robots) < 2:
        return MARGIN
    return max(robot.footprint_radius for robot in robots) / math.sin(math.pi / len(robots)) + MARGIN


class Rendezvous(Task):
    """The paper's task and Eq. 1.

    Args:
        radius: the paper's d in metres, distance from the centre.
    """

    def __init__(self, radius: float) -> None:
        # narrower than in Task: a rendezvous always has a radius
        self.radius: float = radius  # pyright: ignore[reportIncompatibleVariableOverride]  # see above

    def reward(self, poses: Float[Tensor, "*b n 3"]) -> Float[Tensor, "*b"]:
        """Return Eq. 1: 0 within ``radius`` of the centre, else minus all distances, each pair twice."""
        x, y = poses[..., 0], poses[..., 1]
        one, other = torch.triu_indices(poses.shape[-2], poses.shape[-2], 1, device=poses.device)
        # components, not vectors: norms over an axis of two are slow
        apart = torch.hypot(x[..., one] - x[..., other], y[..., one] - y[..., other])
        return apart.sum(-1).mul_(-2.0).masked_fill_(self.success(poses), 0.0)

    def targets(
        self, goals: Float[Tensor, "*#b 2"], poses: Float[Tensor, "*#b n 3"]
    ) -> Float[Tensor, "*c n 3"] | None:
        """Return a target around the goal for each robot of three and more; two on one path meet anyway."""
        count = poses.shape[-2]
        if count < 3:
            return None
        width = 2 * (self.radius - MARGIN) * math.sin(math.pi / count)
        return any_heading(target_slots(goals, poses, self.radius - SPARE, width + APART))

    def terminal(self, poses: Float[Tensor, "b n 3"]) -> Terminal | None:
        """Return the middles of teams that have nearly gathered."""
        count = poses.shape[-2]
        if count < 2:
            return None
        middle = poses[..., :2].mean(-2)
        nearly = NEARLY_OF_TWO if count == 2 else NEARLY
        near = (poses[..., :2] - middle[..., None, :]).norm(dim=-1).amax(-1) < self.radius + nearly
        return Terminal(near, middle, 0.0 if count == 2 else self.radius + CLEAR)

    def success(
        self, poses: Float[Tensor, "*b n 3"], velocities: Float[Tensor, "*b n 2"] | None = None
    ) -> Bool[Tensor, "*b"]:
        """Return whether all are within ``radius`` of the centre, and no two move against each other."""
        x, y = poses[..., 0], poses[..., 1]
        squared = (x - x.mean(-1, keepdim=True)).square() + (y - y.mean(-1, keepdim=True)).square()
        near = squared.amax(-1) < self.radius**2
        return near if velocities is None else near & (relative_speed(poses, velocities) < REST_SPEED)


class AccumulatedDistance(Rendezvous):
    """The reward the paper tried first and rejected (appendix A): the distance summed over a trajectory."""

    def trajectory_reward(self, poses: Float[Tensor, "*b t n 3"]) -> Float[Tensor, "*b"]:
        """Return the sum of Eq. 1 over the times of a trajectory."""
        return self.reward(poses).sum(-1)


def policy_folder() -> Path:
    """Return the folder of the policies that come with this package."""
    return Path(__file__).parent / "policies"


def rendezvous(robots: Sequence[RobotSpec]) -> Rendezvous:
    """Build the task for a team."""
    return Rendezvous(rendezvous_radius(robots))


def accumulated_distance(robots: Sequence[RobotSpec]) -> AccumulatedDistance:
    """Build the variant with the rejected reward for a team."""
    return AccumulatedDistance(rendezvous_radius(robots))
