"""What a team's motion tells of each robot's goal: evidence for each candidate, robot by robot.

A robot that makes for a goal moves as its motion model said it would; the farther from it, the less likely
the goal. Evidence is kept per candidate goal, as log-likelihoods that fade, so that a robot may change its
goal and two paths round a wall stay two hypotheses.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.types import Trajectories

MOST_MISSED = 1.0
"""Squared metres that a robot can miss a prediction by and still count for more: no goal is ruled out."""


@dataclass(frozen=True)
class Evidence:
    """What the last plan left to learn from.

    Attributes:
        goals: its candidates, world coordinates, metres.
        imagined: the motion it foresaw for them.
        likelihood: faded log-likelihoods of each robot having each goal, at most 0.
    """

    goals: Float[Tensor, "b g 2"]
    imagined: Trajectories
    likelihood: Float[Tensor, "b g n"]


@dataclass(frozen=True)
class GoalInference:
    """Weighs goals by how well they explain motion since the last plan.

    Attributes:
        elapsed: seconds between plans.
        surprise: standard deviation of positions around a correct prediction, metres.
        forgetting: share of the evidence that survives from one plan to the next.
        reach: candidates farther than this from all earlier ones begin with the least evidence, metres.
    """

    elapsed: float
    surprise: float
    forgetting: float
    reach: float

    def weigh(
        self,
        before: Evidence | None,
        positions: Float[Tensor, "b n 2"],
        goals: Float[Tensor, "b g 2"],
        std: Float[Tensor, "b n"] | None = None,
    ) -> Float[Tensor, "b g n"]:
        """Return log-likelihoods of the candidates, the best of each robot 0.

        Args:
            before: what the last plan left; None at the start of an episode.
            positions: where all robots are now, metres.
            goals: candidates; they move with the team, so evidence goes to the nearest.
            std: standard deviation of the positions along each axis, metres; None for exact ones.
        """
        if before is None:
            return goals.new_zeros(*goals.shape[:2], positions.shape[1])
        index = int((before.imagined.times - self.elapsed).abs().argmin())
        missed = before.imagined.poses[:, :, index, :, :2] - positions[:, None]
        variance = self.surprise**2 if std is None else self.surprise**2 + std.square()[:, None]
        fit = -missed.square().sum(-1).clamp(max=MOST_MISSED) / (2 * variance)
        total = self.forgetting * before.likelihood + fit
        total = total - total.amax(1, keepdim=True)
        gap, nearest = torch.cdist(goals, before.goals).min(2)
        carried = total.gather(1, nearest[..., None].expand(-1, -1, total.shape[2]))
        return torch.where((gap < self.reach)[..., None], carried, total.amin(1, keepdim=True))
