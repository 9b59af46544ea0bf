"""Planning on a shared lattice: all robots weigh the *same* goals, look far ahead, and learn from motion.

A lattice anchored in the world frame is a convention, like driving on the right: it needs no communication,
and it turns "nearly the same goal" into "the same goal". What robots do is evidence of what they want: goals
that explain how everybody (oneself included) has moved since the last plan gain weight. Everybody sees
everybody move, so the evidence is nearly the same for all, and the team drifts towards one goal instead of
each robot waiting for the others to come to it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.errors import ConfigError
from hpp_framework.planner import Belief, Imagination, MetaPlanner
from hpp_framework.predictor import Predictor
from hpp_framework.sim.simulator import CONTROL_PERIOD
from hpp_framework.task import Task
from hpp_framework.types import Observation


@dataclass(frozen=True, kw_only=True)
class LatticeConfig:
    """Parameters of the lattice planner.

    Attributes:
        predictor: registered motion model.
        horizon: prediction steps.
        plan_every: control steps between plans; the first predicted time must not come later.
        spacing: of the lattice points, metres.
        reach: about the largest distance of a candidate from the midpoint of the team, metres; the set is
            centred on the lattice point nearest to the midpoint.
        keep: a goal is kept while no candidate scores better by more than this (in units of reward).
        evidence: weight of the evidence against the reward; 0 switches inference off.
        surprise: standard deviation of positions around a correct prediction, metres.
        memory: share of the evidence that survives from one plan to the next.
        temperature: of the softmax that turns scores into the belief (in units of reward).
    """

    predictor: str = "far-sighted"
    horizon: int = 12
    plan_every: int = 5
    spacing: float = 0.8
    reach: float = 4.0
    keep: float = 0.1
    evidence: float = 0.1
    surprise: float = 0.15
    memory: float = 0.7
    temperature: float = 0.1

    def __post_init__(self) -> None:
        for name in ("horizon", "plan_every"):
            if getattr(self, name) < 1:
                raise ConfigError(f"lattice: {name} must be at least 1, got {getattr(self, name)}.")
        for name in ("spacing", "reach", "surprise", "temperature"):
            if not 0 < getattr(self, name) < math.inf:
                raise ConfigError(f"lattice: {name} must be positive, got {getattr(self, name)}.")
        for name in ("keep", "evidence"):
            if not 0 <= getattr(self, name) < math.inf:
                raise ConfigError(f"lattice: {name} must be 0 or more, got {getattr(self, name)}.")
        if not 0 <= self.memory <= 1:
            raise ConfigError(f"lattice: memory is a share between 0 and 1, got {self.memory}.")


@dataclass(frozen=True)
class LatticeBelief(Belief):
    """Adds the evidence for each candidate of ``imagination.goals``: decayed log-likelihoods, at most 0."""

    evidence: Float[Tensor, "b g"] | None = None


class LatticePlanner(MetaPlanner):
    """Scores a hexagonal world-frame lattice of goals by reward over a long horizon and by evidence.

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
        evidence = self._evidence(observation, belief, goals)
        scores = self.task.reward(imagined.poses).mean(-1) + self.config.evidence * evidence
        choice = scores.argmax(1)
        if belief is not None:
            wavering = scores.amax(1) <= scores[:, 0] + self.config.keep
            choice = torch.where(wavering, 0, choice)
        goal = goals[torch.arange(len(goals)), choice]
        weights = ((scores - scores.amax(1, keepdim=True)) / self.config.temperature).softmax(1)[..., None]
        mean = (weights * goals).sum(1)
        std = (weights * (goals - mean[:, None]).square()).sum(1).sqrt()
        return goal, LatticeBelief(goal, mean, std, Imagination(goals, scores, imagined), evidence)

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

    def _evidence(
        self, observation: Observation, belief: Belief | None, goals: Float[Tensor, "b g 2"]
    ) -> Float[Tensor, "b g"]:
        """Return how well each goal explains everybody's motion since the last plan, relative to the best."""
        if not isinstance(belief, LatticeBelief) or belief.imagination is None or belief.evidence is None:
            return goals.new_zeros(goals.shape[:2])
        elapsed = self.plan_every * CONTROL_PERIOD
        imagined = belief.imagination.trajectories
        index = int((imagined.times - elapsed).abs().argmin())
        missed = imagined.poses[:, :, index, :, :2] - observation.team_poses[:, None, :, :2]
        likelihood = -missed.square().sum(-1).clamp(max=1.0).sum(-1) / (2 * self.config.surprise**2)
        old = self.config.memory * belief.evidence + likelihood
        old = old - old.amax(1, keepdim=True)
        # candidates move with the team: carry the evidence over from the nearest old candidate
        gap = torch.cdist(goals, belief.imagination.goals)
        nearest = gap.argmin(2)
        known = gap.amin(2) < self.config.spacing
        carried = old.gather(1, nearest)
        return torch.where(known, carried, old.amin(1, keepdim=True))


def _offsets(spacing: float, reach: float) -> Float[Tensor, "g 2"]:
    rows = spacing * math.sqrt(3) / 2
    r = torch.arange(-math.ceil(reach / rows), math.ceil(reach / rows) + 1)
    c = torch.arange(-math.ceil(reach / spacing), math.ceil(reach / spacing) + 1)
    grid = torch.cartesian_prod(r, c).float()
    distance = torch.hypot(grid[:, 0] * rows, (grid[:, 1] + 0.5 * grid[:, 0].remainder(2)) * spacing)
    return grid[distance <= reach]
