"""The paper's centralised baselines (section 5, "Baselines"): a fixed rule sets the goal, none infers."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from hpp_framework.config.settings import altered
from hpp_framework.core.planner import Belief, Decision, MetaPlanner, PlannerContext, certain
from hpp_framework.core.task import Task
from hpp_framework.core.types import Observation
from hpp_framework.planning.targets import own_target
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.seeding import EpisodeRng


@dataclass(frozen=True, kw_only=True)
class CentralizedConfig:
    """How often the rule is asked.

    Attributes:
        plan_every: control steps between plans.
    """

    plan_every: int = 10

    def __post_init__(self) -> None:
        if self.plan_every < 1:
            raise ConfigError(f"plan_every must be at least 1, got {self.plan_every}.")


class CentralizedMidpoint(MetaPlanner):
    """Centralized MP: all robots head for the mean of all positions.

    Args:
        task: the shared objective, which may give each robot a target of its own around a goal.
        config: how often it is asked.
    """

    def __init__(self, task: Task, config: CentralizedConfig | None = None) -> None:
        self.task = task
        self.config = config or CentralizedConfig()
        self.plan_every = self.config.plan_every

    def plan(self, observation: Observation, belief: Belief | None, rng: EpisodeRng) -> Decision:
        """Return the own target of the midpoint of the observed poses."""
        goal = observation.team_poses[..., :2].mean(1)
        own = own_target(self.task, goal, observation.team_poses, observation.agent)
        return Decision(own, certain(goal))


class CentralizedOther(MetaPlanner):
    """Centralized OA: all robots head for another agent; the next one of the team where there are several.

    Args:
        task: the shared objective, which may give each robot a target of its own around a goal.
        config: how often it is asked.
    """

    def __init__(self, task: Task, config: CentralizedConfig | None = None) -> None:
        self.task = task
        self.config = config or CentralizedConfig()
        self.plan_every = self.config.plan_every

    def plan(self, observation: Observation, belief: Belief | None, rng: EpisodeRng) -> Decision:
        """Return the own target of the observed position of the next robot."""
        poses = observation.team_poses
        # a copy, since histories may be overwritten in place while the belief lasts
        goal = poses[:, (observation.agent + 1) % poses.shape[1], :2].clone()
        return Decision(own_target(self.task, goal, poses, observation.agent), certain(goal))


class CentralizedRandom(MetaPlanner):
    """Centralized RP: all robots head for one random point of the world, drawn once an episode.

    Args:
        bounds: (x_min, y_min, x_max, y_max) of the world, metres.
        task: the shared objective, which may give each robot a target of its own around a goal.
    """

    shared_rng = True

    def __init__(self, bounds: tuple[float, float, float, float], task: Task) -> None:
        self.task = task
        self.low = torch.tensor(bounds[:2])
        self.high = torch.tensor(bounds[2:])

    def plan(self, observation: Observation, belief: Belief | None, rng: EpisodeRng) -> Decision:
        """Return the own target of the point drawn at the first call; not guaranteed to be free."""
        if belief is None:
            draw = rng.uniform(2)
            belief = certain((self.low + draw * (self.high - self.low)).to(observation.poses))
        own = own_target(self.task, belief.goal, observation.team_poses, observation.agent)
        return Decision(own, belief)


def midpoint(context: PlannerContext) -> CentralizedMidpoint:
    """Build Centralized MP."""
    return CentralizedMidpoint(context.task, _config("centralized-mp", context))


def other(context: PlannerContext) -> CentralizedOther:
    """Build Centralized OA."""
    return CentralizedOther(context.task, _config("centralized-oa", context))


def random_point(context: PlannerContext) -> CentralizedRandom:
    """Build Centralized RP."""
    return CentralizedRandom(context.bounds, context.task)


def _config(name: str, context: PlannerContext) -> CentralizedConfig:
    return altered(CentralizedConfig(), context.settings, f"planner '{name}'")
