"""Hierarchical predictive planning (the paper's Algorithm 1) and its presets."""

from __future__ import annotations

from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.config.settings import altered
from hpp_framework.core.planner import Belief, Decision, Imagination, MetaPlanner, PlannerContext
from hpp_framework.core.predictor import Predictor, PredictorRequest
from hpp_framework.core.task import Task
from hpp_framework.core.types import Observation, Trajectories
from hpp_framework.planning.hpp.cem import CemConfig, cross_entropy
from hpp_framework.planning.hpp.lattice import LatticePlanner, lattice_config
from hpp_framework.planning.targets import imagine_task, own_target
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import unknown_name
from hpp_framework.utils.seeding import EpisodeRng
from hpp_framework.utils.validation import Count, validated

MIN_STD = 0.25
"""Smallest initial standard deviation in metres, so that robots in one row still search to its sides."""


@validated
class HppConfig:
    """Parameters of the paper's planner (appendix C.1).

    Attributes:
        predictor: registered motion model.
        horizon: prediction steps T.
        plan_every: control steps between plans T_h.
        cem: the search.
    """

    predictor: str = "delta-pose-lidar"
    horizon: Count = 5
    plan_every: Count = 10
    cem: CemConfig = CemConfig()


class HppPlanner(MetaPlanner):
    """Algorithm 1: search goals by CEM, score each by where its imagined team would end up.

    The first Gaussian has the midpoint of the observed positions as its mean and half their spread as its
    standard deviation; the paper says "using agent poses" only.

    Args:
        predictor: the agent's motion models.
        task: the shared objective.
        config: parameters.
        least_std: smallest standard deviation of the first Gaussian along an axis, metres.
    """

    def __init__(
        self, predictor: Predictor, task: Task, config: HppConfig, least_std: float = MIN_STD
    ) -> None:
        self.predictor = predictor
        self.task = task
        self.config = config
        self.least_std = least_std
        self.plan_every = config.plan_every

    @torch.no_grad()
    def plan(self, observation: Observation, belief: Belief | None, rng: EpisodeRng) -> Decision:
        """Return the own place of the final Gaussian's mean; each plan starts afresh, as in the paper."""
        del belief
        positions = observation.team_poses[..., :2]
        spread = positions.amax(1) - positions.amin(1)
        imagine = imagine_task(self.predictor, self.task, observation, self.config.horizon)
        seen: list[Trajectories] = []

        def objective(goals: Float[Tensor, "b g 2"]) -> Float[Tensor, "b g"]:
            imagined = imagine(goals)
            seen[:] = [imagined]
            return self.task.trajectory_reward(imagined.poses)

        std = (spread / 2).clamp(min=self.least_std)
        found = cross_entropy(objective, positions.mean(1), std, rng, self.config.cem)
        imagination = Imagination(found.samples, found.scores, seen[0]) if seen else None
        own = own_target(self.task, found.mean, observation.team_poses, observation.agent)
        return Decision(own, Belief(found.mean, found.mean, found.std, imagination))


MakePredictor = Callable[[str, PlannerContext], Predictor]
"""Builds the predictor of a registered name for the agent that a context names."""


def own_predictor(name: str, context: PlannerContext) -> Predictor:
    """Build the predictor that an agent asks about itself and the others.

    Raises:
        CheckpointError: if there are no weights for the team.
    """
    team = context.team.as_believed_by(context.agent)
    request = PredictorRequest(team=team, agent=context.agent, folders=context.weights)
    return hub().predictors.create(name, request)


def paper(context: PlannerContext, make_predictor: MakePredictor) -> MetaPlanner:
    """Build the planner with the paper's numbers."""
    config = altered(HppConfig(), context.settings, "planner 'hpp', preset 'paper'")
    return HppPlanner(make_predictor(config.predictor, context), context.task, config)


def best(context: PlannerContext, make_predictor: MakePredictor) -> MetaPlanner:
    """Build the planner with the best settings known so far; see docs/decisions/planning.md."""
    config = altered(lattice_config(len(context.team)), context.settings, "planner 'hpp', preset 'best'")
    lidar = context.team.robots[context.agent].lidar
    return LatticePlanner(make_predictor(config.predictor, context), context.task, config, lidar)


PRESETS: dict[str, Callable[[PlannerContext, MakePredictor], MetaPlanner]] = {"paper": paper, "best": best}


def hpp(context: PlannerContext, make_predictor: MakePredictor = own_predictor) -> MetaPlanner:
    """Build HPP under the context's preset.

    Args:
        context: what the planner is told.
        make_predictor: other than an agent's own, for comparisons.

    Raises:
        UnknownNameError: if there is no such preset.
        CheckpointError: if there are no predictor weights for the team.
    """
    if context.preset not in PRESETS:
        raise unknown_name("preset", context.preset, PRESETS)
    return PRESETS[context.preset](context, make_predictor)
