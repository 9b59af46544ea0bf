"""The paper's centralised baselines (section 5, "Baselines"): a fixed rule sets the goal, nobody infers."""

from __future__ import annotations

import torch

from hpp_framework.core.planner import Belief, Decision, MetaPlanner, PlannerContext, certain
from hpp_framework.core.task import Task
from hpp_framework.core.types import Observation
from hpp_framework.planning.targets import own_target
from hpp_framework.utils.seeding import EpisodeRng


class CentralizedMidpoint(MetaPlanner):
    """Centralized MP: everybody heads for the mean of all positions.

    Args:
        task: the shared objective, which may give each robot a place of its own around a goal.
    """

    def __init__(self, task: Task) -> None:
        self.task = task

    def plan(self, observation: Observation, belief: Belief | None, rng: EpisodeRng) -> Decision:
        """Return the own place of the midpoint of the observed poses."""
        goal = observation.team_poses[..., :2].mean(1)
        own = own_target(self.task, goal, observation.team_poses, observation.agent)
        return Decision(own, certain(goal))


class CentralizedOther(MetaPlanner):
    """Centralized OA: everybody heads for another agent; the next one of the team where there are several.

    Args:
        task: the shared objective, which may give each robot a place of its own around a goal.
    """

    def __init__(self, task: Task) -> None:
        self.task = task

    def plan(self, observation: Observation, belief: Belief | None, rng: EpisodeRng) -> Decision:
        """Return the own place of the observed position of the next robot."""
        poses = observation.team_poses
        # a copy, since histories may be overwritten in place while the belief lasts
        goal = poses[:, (observation.agent + 1) % poses.shape[1], :2].clone()
        return Decision(own_target(self.task, goal, poses, observation.agent), certain(goal))


class CentralizedRandom(MetaPlanner):
    """Centralized RP: everybody heads for one random point of the world, drawn once an episode.

    Args:
        bounds: (x_min, y_min, x_max, y_max) of the world, metres.
        task: the shared objective, which may give each robot a place of its own around a goal.
    """

    shared_rng = True

    def __init__(self, bounds: tuple[float, float, float, float], task: Task) -> None:
        self.task = task
        self.low = torch.tensor(bounds[:2])
        self.high = torch.tensor(bounds[2:])

    def plan(self, observation: Observation, belief: Belief | None, rng: EpisodeRng) -> Decision:
        """Return the own place of the point drawn at the first call; not guaranteed to be free."""
        if belief is None:
            draw = rng.uniform(2)
            belief = certain((self.low + draw * (self.high - self.low)).to(observation.poses))
        own = own_target(self.task, belief.goal, observation.team_poses, observation.agent)
        return Decision(own, belief)


def midpoint(context: PlannerContext) -> CentralizedMidpoint:
    """Build Centralized MP."""
    return CentralizedMidpoint(context.task)


def other(context: PlannerContext) -> CentralizedOther:
    """Build Centralized OA."""
    return CentralizedOther(context.task)


def random_point(context: PlannerContext) -> CentralizedRandom:
    """Build Centralized RP."""
    return CentralizedRandom(context.bounds, context.task)
