"""Planning on a shared lattice: all robots weigh the *same* goals, look far ahead, and learn from motion.

A lattice anchored in the world frame is a convention, like driving on the right: it needs no communication,
and it turns "nearly the same goal" into "the same goal". What the others do is evidence of what they want
(:mod:`hpp_framework.planning.hpp.inference`), and one's own goal is the best response to what they probably
want (:mod:`hpp_framework.planning.hpp.best_response`). Each of these can be switched off.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.planner import Belief, Decision, Imagination, MetaPlanner
from hpp_framework.core.predictor import Predictor
from hpp_framework.core.robot import Lidar
from hpp_framework.core.task import Task
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import Observation, Trajectories
from hpp_framework.perception.occlusion import occluded
from hpp_framework.planning.hpp.best_response import as_one_gaussian, likeliest, moments, pair_rewards
from hpp_framework.planning.hpp.inference import Evidence, GoalInference
from hpp_framework.planning.targets import imagine_task, own_target
from hpp_framework.plugins.builtin import DEFAULT_PREDICTOR
from hpp_framework.utils.seeding import EpisodeRng
from hpp_framework.utils.validation import Count, NonNegative, Positive, Share, validated

PAIRS = 192
"""Goals of the others times robots that a plan of a larger team weighs, at most."""


@validated
class LatticeConfig:
    """Parameters of the lattice planner.

    Rewards are those of a team of two: what a larger one gets is divided by :meth:`Task.unit`.

    Attributes:
        predictor: registered motion model.
        horizon: prediction steps.
        plan_every: control steps between plans; the first predicted time must not come later.
        spacing: of the lattice points, metres.
        reach: about the largest distance of a candidate from the midpoint of the team, metres; the set is
            centred on the lattice point nearest to the midpoint.
        shared: whether the lattice is anchored in the world; else each robot has its own, anchored in itself.
        hysteresis: a goal is kept while no candidate scores better by more than this (in units of reward).
        terminal: share of the score that is the reward at the horizon; the rest is its mean over time.
        uncertainty_penalty: how much a metre of the predictions' standard deviation costs (in units of
            reward); 0 ignores uncertainty, as do predictors that state none.
        occlusion_penalty: what a goal costs that lies right behind something seen (in units of reward); 0
            ignores it.
        occlusion_depth: how far behind, metres.
        patience: seconds of an episode over which that cost grows to its full size; 0 asks for it from the
            start.
        likelihood_weight: weight of the evidence of motion against the reward; 0 switches inference off.
        surprise: standard deviation of positions around a correct prediction, metres.
        forgetting_factor: share of the evidence that survives from one plan to the next.
        respond: whether to score a goal of one's own against the goals that the others probably have, instead
            of as a goal of all.
        hypotheses: likeliest goals of the others that a response weighs.
        mixture: whether the belief over the others' goals may have several peaks; else it is one Gaussian.
        temperature: of the softmax that turns scores into a belief (in units of reward).
    """

    RENAMED: ClassVar[Mapping[str, str]] = {
        "keep": "hysteresis", "doubt": "uncertainty_penalty", "shadow": "occlusion_penalty",
        "shadow_depth": "occlusion_depth", "evidence": "likelihood_weight", "memory": "forgetting_factor",
    }  # fmt: skip

    predictor: str = DEFAULT_PREDICTOR
    horizon: Count = 15
    plan_every: Count = 5
    spacing: Positive = 0.8
    reach: Positive = 4.0
    shared: bool = True
    hysteresis: NonNegative = 0.0
    terminal: Share = 0.4
    uncertainty_penalty: NonNegative = 0.3
    occlusion_penalty: NonNegative = 0.5
    occlusion_depth: Positive = 2.5
    patience: NonNegative = 10.0
    likelihood_weight: NonNegative = 0.3
    surprise: Positive = 0.15
    forgetting_factor: Share = 0.7
    respond: bool = True
    hypotheses: Count = 24
    mixture: bool = True
    temperature: Positive = 0.6


def lattice_config(robots: int) -> LatticeConfig:
    """Return the best settings known for a team of so many robots; see docs/decisions/planning.md.

    Of more than two, motion tells less of what each wants, since they wait for each other and make room. A
    plan that any of them can upset needs to be surer. And a larger team starts, and meets, farther from its
    middle. A reward takes time in proportion to the pairs of robots; so that a plan does not, fewer goals of
    the others are weighed from nine robots on.
    """
    if robots < 3:
        return LatticeConfig()
    hypotheses = min(LatticeConfig.hypotheses, max(PAIRS // robots, 1))
    return LatticeConfig(uncertainty_penalty=2.0, surprise=0.4, reach=5.2, hypotheses=hypotheses)


@dataclass(frozen=True)
class LatticeBelief(Belief):
    """Adds what the next plan can learn from, and how many plans there were before it."""

    evidence: Evidence | None = None
    plans: int = 0


class LatticePlanner(MetaPlanner):
    """Scores a hexagonal lattice of goals by reward over a long horizon, given what the others probably do.

    Args:
        predictor: the agent's motion models.
        task: the shared objective.
        config: parameters.
        lidar: of the agent, to tell what is occluded; None ignores occlusion.
    """

    def __init__(
        self, predictor: Predictor, task: Task, config: LatticeConfig, lidar: Lidar | None = None
    ) -> None:
        self.lidar = lidar
        self.predictor = predictor
        self.task = task
        self.config = config
        self.plan_every = config.plan_every
        self.inference = GoalInference(
            elapsed=config.plan_every * CONTROL_PERIOD,
            surprise=config.surprise,
            forgetting=config.forgetting_factor,
            reach=config.spacing,
        )

    @torch.no_grad()
    def plan(self, observation: Observation, belief: Belief | None, rng: EpisodeRng) -> Decision:
        """Return the own place of the best lattice point, or of the present goal while nearly as good."""
        del rng
        goals = self.candidates(observation)
        if belief is not None:
            goals = torch.cat([belief.goal[:, None], goals], 1)
        imagined = imagine_task(self.predictor, self.task, observation, self.config.horizon)(goals)
        before = belief if isinstance(belief, LatticeBelief) else None
        plans = before.plans if before else 0
        likelihood = self.inference.weigh(
            before.evidence if before else None, observation.team_poses[..., :2], goals,
            None if observation.std is None else observation.std[..., 0],
        )  # fmt: skip
        costs = self._costs(observation, goals, imagined, plans)
        scores = self._scores(imagined, likelihood, goals, costs, observation.agent)
        choice = scores.argmax(1)
        if belief is not None:
            wavering = scores.amax(1) <= scores[:, 0] + self.config.hysteresis
            choice = torch.where(wavering, 0, choice)
        goal = goals[torch.arange(len(goals)), choice]
        mean, std = moments(scores / self.config.temperature, goals)
        evidence = Evidence(goals, imagined, likelihood)
        own = own_target(self.task, goal, observation.team_poses, observation.agent)
        imagination = Imagination(goals, scores, imagined)
        return Decision(own, LatticeBelief(goal, mean, std, imagination, evidence, plans + 1))

    def _scores(
        self,
        imagined: Trajectories,
        likelihood: Float[Tensor, "b g n"],
        goals: Float[Tensor, "b g 2"],
        costs: Float[Tensor, "b g"],
        agent: int,
    ) -> Float[Tensor, "b g"]:
        config, robots = self.config, likelihood.shape[-1]
        unit = self.task.unit(robots)
        hoped = self._over_time(self.task.reward(imagined.poses)) / unit - costs
        if not config.respond:
            return hoped + config.likelihood_weight * likelihood.sum(-1)
        theirs = torch.arange(robots) != agent
        logits = (hoped + config.likelihood_weight * likelihood[..., theirs].sum(-1)) / config.temperature
        if not config.mixture:
            logits = as_one_gaussian(logits, goals)
        others, chosen = likeliest(logits, config.hypotheses)
        answers = self._over_time(pair_rewards(self.task, imagined, agent, others, chosen))
        # a goal of its own moves one robot: 2 / n of the pairs that the unit counts
        return answers / unit - costs * 2 / robots

    def _over_time(self, reward: Float[Tensor, "b g t"]) -> Float[Tensor, "b g"]:
        """Return one score for the rewards along a trajectory."""
        terminal = self.config.terminal
        return (1 - terminal) * reward.mean(-1) + terminal * reward[..., -1]

    def _costs(
        self, observation: Observation, goals: Float[Tensor, "b g 2"], imagined: Trajectories, plans: int
    ) -> Float[Tensor, "b g"]:
        """Return what speaks against goals whatever they promise: uncertainty, and occlusion."""
        config = self.config
        costs = torch.zeros_like(goals[..., 0])
        if config.uncertainty_penalty and imagined.std is not None:
            costs += config.uncertainty_penalty * imagined.std.mean((-1, -2))
        if config.occlusion_penalty and self.lidar is not None:
            penalty = config.occlusion_penalty * self._impatience(plans)
            costs += penalty * occluded(observation, self.lidar, goals, config.occlusion_depth)
        return costs

    def _impatience(self, plans: int) -> float:
        """Return the share of the cost of occlusion that is asked for after so many plans."""
        passed = plans * self.inference.elapsed
        return min(1.0, passed / self.config.patience) if self.config.patience else 1.0

    def candidates(self, observation: Observation) -> Float[Tensor, "b g 2"]:
        """Return the lattice points nearest to the team's midpoint; the same set for every robot."""
        spacing, rows = self.config.spacing, self.config.spacing * math.sqrt(3) / 2
        anchor = torch.zeros_like(observation.pose[:, :2]) if self.config.shared else observation.pose[:, :2]
        middle = observation.team_poses[..., :2].mean(1) - anchor
        row = (middle[:, 1] / rows).round()
        column = (middle[:, 0] / spacing).round()
        offsets = _offsets(spacing, self.config.reach).to(middle)
        r, c = row[:, None] + offsets[:, 0], column[:, None] + offsets[:, 1]
        shift = 0.5 * (r.remainder(2))
        return torch.stack([(c + shift) * spacing, r * rows], -1) + anchor[:, None]


def _offsets(spacing: float, reach: float) -> Float[Tensor, "g 2"]:
    rows = spacing * math.sqrt(3) / 2
    r = torch.arange(-math.ceil(reach / rows), math.ceil(reach / rows) + 1)
    c = torch.arange(-math.ceil(reach / spacing), math.ceil(reach / spacing) + 1)
    grid = torch.cartesian_prod(r, c).float()
    distance = torch.hypot(grid[:, 0] * rows, (grid[:, 1] + 0.5 * grid[:, 0].remainder(2)) * spacing)
    return grid[distance <= reach]
