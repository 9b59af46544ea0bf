"""A strong rule: meet where the last robot arrives soonest along shortest paths on one's own local map.

It learns nothing and infers nothing. Of two robots it is the point half way along the shortest path between
them, which is as good as any planner where both know the same of the world, drive alike and have nothing
between them that only one passes.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from hpp_framework.config.settings import altered
from hpp_framework.core.planner import Belief, Decision, MetaPlanner, PlannerContext, certain
from hpp_framework.core.types import Observation
from hpp_framework.perception.local_map import RESOLUTION, build_local_map
from hpp_framework.planning.targets import own_target
from hpp_framework.utils.errors import ConfigError, unknown_name
from hpp_framework.utils.seeding import EpisodeRng

WEIGHTS = ("length", "speed")
TIE = 0.01
"""Share of all arrivals together that settles which of two places with equal latest arrivals is chosen."""


@dataclass(frozen=True, kw_only=True)
class GeodesicMidpointConfig:
    """How the rule decides.

    Attributes:
        plan_every: control steps between plans.
        by: ``"length"``: all robots are taken to be equally fast; ``"speed"``: each drives at its top speed.
    """

    plan_every: int = 5
    by: str = "length"

    def __post_init__(self) -> None:
        if self.plan_every < 1:
            raise ConfigError(f"geodesic-midpoint: plan_every must be at least 1, got {self.plan_every}.")
        if self.by not in WEIGHTS:
            raise unknown_name("weight", self.by, WEIGHTS)


class GeodesicMidpoint(MetaPlanner):
    """Sends all robots to the point of least latest arrival.

    Args:
        context: what a planner is told.
        config: how it decides.
    """

    def __init__(self, context: PlannerContext, config: GeodesicMidpointConfig) -> None:
        robots = context.team.robots
        self.config = config
        self.plan_every = config.plan_every
        self.task = context.task
        self.lidar = robots[context.agent].lidar
        self.radii = torch.tensor([robot.footprint_radius for robot in robots])
        by_speed = config.by == "speed"
        self.speeds = torch.tensor([robot.drive.speed[1] if by_speed else 1.0 for robot in robots])

    @torch.no_grad()
    def plan(self, observation: Observation, belief: Belief | None, rng: EpisodeRng) -> Decision:
        """Return the own target of the point of least latest arrival on the local map."""
        poses = observation.team_poses
        local_map = build_local_map(
            self.lidar, observation.agent, poses, observation.scan, observation.keyframes,
            poses[..., :2].contiguous(), self.radii,
        )  # fmt: skip
        arrivals = (local_map.fields / self.speeds.to(poses)[:, None, None]).flatten(2)
        cell = (arrivals.amax(1) + TIE * arrivals.mean(1)).argmin(1)
        width = local_map.fields.shape[-1]
        place = torch.stack([cell % width, cell // width], -1)
        goal = local_map.origins + RESOLUTION * (place + 0.5)
        return Decision(own_target(self.task, goal, poses, observation.agent), certain(goal))


def geodesic_midpoint(context: PlannerContext) -> GeodesicMidpoint:
    """Build the rule."""
    config = altered(GeodesicMidpointConfig(), context.settings, "planner 'geodesic-midpoint'")
    return GeodesicMidpoint(context, config)
