"""Planning on a shared lattice: all robots weigh the *same* goals, look far ahead, and do not waver.

A lattice anchored in the world frame is a convention, like driving on the right: it needs no communication,
and it turns "nearly the same goal" into "the same goal".
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.planner import Belief, Imagination, MetaPlanner
from hpp_framework.predictor import Predictor
from hpp_framework.task import Task
from hpp_framework.types import Observation


@dataclass(frozen=True, kw_only=True)
class LatticeConfig:
    """Parameters of the lattice planner.

    Attributes:
        predictor: registered motion model.
        horizon: prediction steps.
        plan_every: control steps between plans.
        spacing: of the lattice points, metres.
        reach: largest distance of a candidate from the midpoint of the team, metres.
        keep: a goal is kept while no candidate scores better by more than this (in units of reward).
        temperature: of the softmax that turns scores into the belief (in units of reward).
    """

    predictor: str = "far-sighted"
    horizon: int = 12
    plan_every: int = 5
    spacing: float = 0.8
    reach: float = 4.5
    keep: float = 0.4
    temperature: float = 0.1


class LatticePlanner(MetaPlanner):
    """Scores a hexagonal world-frame lattice of goals by the mean reward over a long imagined horizon.

    Args:
        predictor: the agent's motion models.
        task: the shared objective.
        config: parameters.
    """

    def __init__(self, predictor: Predictor, task: Task, config: LatticeConfig) -> None:
        self.predictor = predictor
        self.task = task
        self.config = config
        self.plan_every = config.plan_every

    @torch.no_grad()
    def plan(
        self, observation: Observation, belief: Belief | None, rng: torch.Generator
    ) -> tuple[Float[Tensor, "b 2"], Belief]:
        """Return the best lattice point, or the present goal while it is nearly as good."""
        del rng
        goals = self.candidates(observation)
        if belief is not None:
            goals = torch.cat([belief.goal[:, None], goals], 1)
        imagined = self.predictor.rollout(observation, goals, self.config.horizon)
        scores = self.task.reward(imagined.poses).mean(-1)
        choice = scores.argmax(1)
        if belief is not None:
            wavering = scores.amax(1) <= scores[:, 0] + self.config.keep
            choice = torch.where(wavering, 0, choice)
        goal = goals[torch.arange(len(goals)), choice]
        weights = ((scores - scores.amax(1, keepdim=True)) / self.config.temperature).softmax(1)[..., None]
        mean = (weights * goals).sum(1)
        std = (weights * (goals - mean[:, None]).square()).sum(1).sqrt()
        return goal, Belief(goal, mean, std, Imagination(goals, scores, imagined))

    def candidates(self, observation: Observation) -> Float[Tensor, "b g 2"]:
        """Return the lattice points nearest to the team's midpoint; the same set whoever looks."""
        spacing, rows = self.config.spacing, self.config.spacing * math.sqrt(3) / 2
        middle = observation.team_poses[..., :2].mean(1)
        row = (middle[:, 1] / rows).round()
        column = (middle[:, 0] / spacing).round()
        offsets = _offsets(spacing, self.config.reach).to(middle)
        r, c = row[:, None] + offsets[:, 0], column[:, None] + offsets[:, 1]
        shift = 0.5 * (r.remainder(2))
        return torch.stack([(c + shift) * spacing, r * rows], -1)


def _offsets(spacing: float, reach: float) -> Float[Tensor, "g 2"]:
    rows = spacing * math.sqrt(3) / 2
    r = torch.arange(-math.ceil(reach / rows), math.ceil(reach / rows) + 1)
    c = torch.arange(-math.ceil(reach / spacing), math.ceil(reach / spacing) + 1)
    grid = torch.cartesian_prod(r, c).float()
    distance = torch.hypot(grid[:, 0] * rows, (grid[:, 1] + 0.5 * grid[:, 0].remainder(2)) * spacing)
    return grid[distance <= reach]
