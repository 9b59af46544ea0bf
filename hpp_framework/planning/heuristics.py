"""The paper's centralised baselines (section 5, "Baselines"): a fixed rule sets the goal, nobody infers."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.planner import Belief, MetaPlanner, PlannerContext, certain
from hpp_framework.types import Observation


class CentralizedMidpoint(MetaPlanner):
    """Centralized MP: everybody heads for the mean of all positions."""

    def plan(
        self, observation: Observation, belief: Belief | None, rng: torch.Generator
    ) -> tuple[Float[Tensor, "b 2"], Belief]:
        """Return the midpoint of the observed poses."""
        goal = observation.team_poses[..., :2].mean(1)
        return goal, certain(goal)


class CentralizedOther(MetaPlanner):
    """Centralized OA: everybody heads for another agent; the next one of the team where there are several."""

    def plan(
        self, observation: Observation, belief: Belief | None, rng: torch.Generator
    ) -> tuple[Float[Tensor, "b 2"], Belief]:
        """Return the observed position of the next robot."""
        count = observation.team_poses.shape[1]
        goal = observation.team_poses[:, (observation.agent + 1) % count, :2]
        return goal, certain(goal)


class CentralizedRandom(MetaPlanner):
    """Centralized RP: everybody heads for one random point of the world, drawn once an episode.

    Args:
        bounds: (x_min, y_min, x_max, y_max) of the world, metres.
    """

    centralised = True

    def __init__(self, bounds: tuple[float, float, float, float]) -> None:
        self.low = torch.tensor(bounds[:2])
        self.high = torch.tensor(bounds[2:])

    def plan(
        self, observation: Observation, belief: Belief | None, rng: torch.Generator
    ) -> tuple[Float[Tensor, "b 2"], Belief]:
        """Return the point drawn at the first call; not guaranteed to be free."""
        if belief is not None:
            return belief.goal, belief
        draw = torch.rand(len(observation.poses), 2, generator=rng)
        goal = (self.low + draw * (self.high - self.low)).to(observation.poses)
        return goal, certain(goal)


def midpoint(context: PlannerContext) -> CentralizedMidpoint:
    """Build Centralized MP."""
    del context
    return CentralizedMidpoint()


def other(context: PlannerContext) -> CentralizedOther:
    """Build Centralized OA."""
    del context
    return CentralizedOther()


def random_point(context: PlannerContext) -> CentralizedRandom:
    """Build Centralized RP."""
    return CentralizedRandom(context.bounds)
