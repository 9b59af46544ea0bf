"""Planning over pairs of a skill and a goal: a planner a skill, and the best of their proposals.

Motion models belong to a skill, so each skill has its own for the agent's own motion. A skill without learned
weights can be given ``empty-world``, which knows no obstacles: it may then be chosen only where the straight
path to its goal is seen to be free, where that model is about right. How the *others* move does not depend on
the agent's skill; one model predicts them for all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from hpp_framework.config.settings import altered
from hpp_framework.core.option import BUDGET, Option, anywhere
from hpp_framework.core.planner import Belief, Decision, MetaPlanner, PlannerContext
from hpp_framework.core.predictor import Imagine, Predictor, PredictorRequest
from hpp_framework.core.team import Team
from hpp_framework.core.types import Observation, Trajectories
from hpp_framework.perception.visibility import clear_way
from hpp_framework.planning.hpp.lattice import LatticeConfig, LatticePlanner, lattice_config
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.seeding import EpisodeRng
from hpp_framework.utils.validation import Count, NonNegative, validated

BLIND = ("empty-world", "constant-velocity")
"""Predictors that know no obstacles."""


@validated
class OptionsConfig:
    """Parameters of planner ``hpp-options``.

    Attributes:
        skills: registered skills to choose among, separated by commas.
        predictors: registered motion model of each, in the same order; the first predicts the others too.
        hysteresis: the skill is kept while no other scores better by more than this (in units of reward).
        budget: control steps after which a skill has to be chosen anew.
        lattice: how goals are chosen; its predictor is not used.
    """

    RENAMED: ClassVar[Mapping[str, str]] = {"keep": "hysteresis"}

    skills: str = "p2p,pure-pursuit"
    predictors: str = "far-sighted,empty-world"
    hysteresis: NonNegative = 0.1
    budget: Count = BUDGET
    lattice: LatticeConfig = LatticeConfig()

    def __post_init__(self) -> None:
        if self.skills.count(",") != self.predictors.count(",") or not all(map(all, self.pairs())):
            raise ConfigError(
                f"options: every skill needs a predictor of its own, got skills '{self.skills}' and "
                f"predictors '{self.predictors}'."
            )

    def pairs(self) -> list[tuple[str, str]]:
        """Return each skill with its predictor."""
        return [
            (skill.strip(), predictor.strip())
            for skill, predictor in zip(self.skills.split(","), self.predictors.split(","), strict=False)
        ]


class OwnMotion(Predictor):
    """The others as one model predicts them, the agent itself as another does.

    Args:
        others: predicts the others.
        own: predicts the agent.
    """

    def __init__(self, others: Predictor, own: Predictor) -> None:
        self.others = others
        self.own = own

    def rollout(self, observation: Observation, goals: Float[Tensor, "b g 2"], horizon: int) -> Trajectories:
        """Imagine the team with both models; see :meth:`Predictor.rollout`.

        Raises:
            ConfigError: if the models do not predict the same times.
        """
        return self.condition(observation, horizon)(goals)

    def condition(self, observation: Observation, horizon: int) -> Imagine:
        """Prepare both models."""
        others = self.others.condition(observation, horizon)
        own = self.own.condition(observation, horizon)

        def imagine(goals: Float[Tensor, "b g 2"]) -> Trajectories:
            team, self_ = others(goals), own(goals)
            if team.times.shape != self_.times.shape or not torch.allclose(team.times, self_.times):
                raise ConfigError(
                    "the predictors of all skills must predict the same times, but steps differ: "
                    f"{team.times[:2].tolist()} s and {self_.times[:2].tolist()} s."
                )
            poses = team.poses.clone()
            poses[..., observation.agent, :] = self_.poses[..., observation.agent, :]
            return replace(team, poses=poses)

        return imagine


@dataclass(frozen=True)
class OptionsBelief(Belief):
    """Adds what each skill's planner believes, which one was chosen, and for how long.

    Attributes:
        parts: of the planners.
        choice: index of the chosen option, -1 where none may be started.
        steps: control steps since it was chosen.
    """

    parts: tuple[Belief, ...] = ()
    choice: Int[Tensor, "b"] | None = None
    steps: Int[Tensor, "b"] | None = None


class OptionsPlanner(MetaPlanner):
    """Asks a planner per skill for its best goal and takes the pair that scores best.

    Args:
        options: the skills.
        planners: of the same number, each with a motion model of its skill.
        config: parameters.
    """

    def __init__(
        self, options: Sequence[Option], planners: Sequence[LatticePlanner], config: OptionsConfig
    ) -> None:
        self.options = options
        self.planners = planners
        self.config = config
        self.plan_every = config.lattice.plan_every

    @torch.no_grad()
    def plan(self, observation: Observation, belief: Belief | None, rng: EpisodeRng) -> Decision:
        """Return the goal of the best pair; ``hysteresis`` favours the pair before until it is over."""
        before = belief if isinstance(belief, OptionsBelief) else None
        parts = before.parts if before else (None,) * len(self.planners)
        plans = [
            planner.plan(observation, part, rng) for planner, part in zip(self.planners, parts, strict=True)
        ]
        goals = torch.stack([plan.goal for plan in plans], 1)
        scores = torch.stack([score_of(plan.belief) for plan in plans], 1)
        steps = torch.zeros(len(goals), dtype=torch.long, device=goals.device)
        if before is not None and before.choice is not None and before.steps is not None:
            steps = before.steps + self.plan_every
            scores = scores + self.config.hysteresis * self._going_on(observation, before, steps)
        may = [o.may_start(observation, goals[:, k]) for k, o in enumerate(self.options)]
        scores = torch.where(torch.stack(may, 1), scores, -torch.inf)
        choice = torch.where(scores.isneginf().all(1), -1, scores.argmax(1))
        if before is not None and before.choice is not None:
            steps = torch.where((choice == before.choice) & (steps < self.config.budget), steps, 0)
        return _decide(choice, steps, goals, [plan.belief for plan in plans])

    def _going_on(
        self, observation: Observation, before: OptionsBelief, steps: Int[Tensor, "b"]
    ) -> Bool[Tensor, "b k"]:
        """Return which options were chosen before and are not over."""
        over = [option.is_over(observation, before.goal, steps) for option in self.options]
        assert before.choice is not None
        chosen = before.choice[:, None] == torch.arange(len(self.options), device=steps.device)
        return chosen & ~torch.stack(over, 1)


def _decide(
    choice: Int[Tensor, "b"], steps: Int[Tensor, "b"], goals: Float[Tensor, "b k 2"], parts: Sequence[Belief]
) -> Decision:
    rows, column = torch.arange(len(choice)), choice.clamp(min=0)
    mean = torch.stack([part.mean for part in parts], 1)[rows, column]
    std = torch.stack([part.std for part in parts], 1)[rows, column]
    shared = torch.stack([part.goal for part in parts], 1)[rows, column]
    # a picture has one set of candidates; one episode shows those of its own choice
    imagination = parts[int(column[0])].imagination
    belief = OptionsBelief(shared, mean, std, imagination, tuple(parts), choice, steps)
    return Decision(goals[rows, column], belief, choice)


def score_of(belief: Belief) -> Float[Tensor, "b"]:
    """Return the score of the goal that a planner chose, from what it weighed."""
    assert belief.imagination is not None, "a planner that chooses among options must imagine"
    goals, scores = belief.imagination.goals, belief.imagination.scores
    chosen = (goals - belief.goal[:, None]).norm(dim=-1).argmin(1)
    return scores[torch.arange(len(scores)), chosen]


def _with_skill(team: Team, agent: int, skill: str) -> Team:
    members = list(team.members)
    members[agent] = replace(members[agent], skill=skill)
    return Team(tuple(members))


def options(context: PlannerContext) -> OptionsPlanner:
    """Build the planner of one agent.

    Raises:
        ConfigError: if a setting is wrong.
        UnknownNameError: if a skill or a predictor is not registered.
        CheckpointError: if a predictor has no weights for its skill.
    """
    best = OptionsConfig(lattice=lattice_config(len(context.team)))
    config = altered(best, context.settings, "planner 'hpp-options'")
    robot = context.team.robots[context.agent]
    chosen: list[Option] = []
    planners: list[LatticePlanner] = []
    models: list[Predictor] = []
    for skill, predictor in config.pairs():
        team = _with_skill(context.team.as_believed_by(context.agent), context.agent, skill)
        request = PredictorRequest(team=team, agent=context.agent, folders=context.weights)
        own: Predictor = hub().predictors.create(predictor, request)
        models.append(OwnMotion(models[0], own) if models else own)
        starts = clear_way(robot) if predictor in BLIND else anywhere
        driver = hub().skills.create(skill, robot)
        chosen.append(Option(name=skill, skill=driver, starts=starts, budget=config.budget))
        planners.append(LatticePlanner(models[-1], context.task, config.lattice, robot.lidar))
    return OptionsPlanner(chosen, planners, config)
