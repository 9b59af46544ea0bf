"""Scripted agents: robots that an HPP robot may find beside it and cannot change.

- ``stubborn``: a teammate that keeps one goal of its own throughout.
- ``route``: drives waypoints, like a leader that knows the path; ignores the others and never stops before
  the last.
- ``wander``: drives from one random place in sight to the next, like a robot with another task.

None of them looks at the others, so what they do tells nothing of what the team wants.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from hpp_framework.config.settings import altered
from hpp_framework.core.planner import Belief, Decision, MetaPlanner, PlannerContext, certain
from hpp_framework.core.robot import Lidar
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import Observation
from hpp_framework.perception.sensing import lidar_poses
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.seeding import EpisodeRng
from hpp_framework.utils.validation import Number, Positive, validated

OPEN = 2.0
"""Metres that a beam must reach for a place along it to be driven to."""
MARGIN = 0.8
"""Metres that such a place keeps from what the beam meets."""
NEAREST = 1.0
"""Metres to such a place, at least."""

Config = TypeVar("Config")


@validated
class StubbornConfig:
    """Where a stubborn robot goes.

    Attributes:
        x: of its goal, metres; None draws a place in sight when the episode begins. Give both or none.
        y: of its goal, metres.
        reach: farthest such place, metres.
    """

    x: Number | None = None
    y: Number | None = None
    reach: Positive = 6.0


@validated
class RouteConfig:
    """The waypoints of a route.

    Attributes:
        points: metres, world frame, as text: ``"0 0; 4 0; 4 3"``.
        near: metres from a waypoint at which it counts as passed.
        loop: whether the first follows the last; else the robot stays there.
    """

    points: str = "-3 -3; 3 -3; 3 3; -3 3"
    near: Positive = 0.6
    loop: bool = False

    def __post_init__(self) -> None:
        self.places()

    def places(self) -> list[tuple[float, float]]:
        """Return the waypoints.

        Raises:
            ConfigError: if the text has none, or something else in it.
        """
        try:
            pairs = [[float(part) for part in point.split()] for point in self.points.split(";")]
        except ValueError:
            pairs = []
        if not pairs or any(len(pair) != 2 or not all(map(math.isfinite, pair)) for pair in pairs):
            raise ConfigError(
                f"planner 'route' needs waypoints 'x y; x y', e.g. 'route:points=0 0; 4 0; 4 3', got "
                f"'{self.points}'."
            )
        return [(x, y) for x, y in pairs]


@validated
class WanderConfig:
    """How a wandering robot wanders.

    Attributes:
        reach: farthest next place, metres.
        near: metres from a place at which it counts as reached.
        patience: seconds after which a robot that does not get there chooses another.
    """

    reach: Positive = 6.0
    near: Positive = 0.6
    patience: Positive = 15.0


class ScriptedPlanner(MetaPlanner):
    """Looks at no other robot, so that it goes on as before where the team changes."""

    def carry_over(self, belief: Belief) -> Belief:
        """Return the belief as it is."""
        return belief


class Stubborn(ScriptedPlanner):
    """Keeps the goal that it has at the start; it rests like a teammate when the task is fulfilled.

    Args:
        config: its goal.
        lidar: of its robot, in whose sight goals are drawn.

    Raises:
        ConfigError: if the goal is half given.
    """

    def __init__(self, config: StubbornConfig, lidar: Lidar) -> None:
        # settings are applied one by one, so the config itself cannot tell
        if (config.x is None) != (config.y is None):
            raise ConfigError("planner 'stubborn' needs both x and y of its goal, or neither.")
        self.config = config
        self.lidar = lidar

    def plan(self, observation: Observation, belief: Belief | None, rng: EpisodeRng) -> Decision:
        """Return the goal of the first plan."""
        if belief is not None:
            return Decision(belief.goal, belief)
        if self.config.x is not None and self.config.y is not None:
            place = observation.pose.new_tensor([self.config.x, self.config.y])
            goal = place.expand(len(observation.pose), 2).clone()
        else:
            goal = place_in_sight(observation, self.lidar, self.config.reach, rng)
        return Decision(goal, certain(goal))


@dataclass(frozen=True, kw_only=True)
class UnderWay(Belief):
    """A goal that will be followed by another.

    Attributes:
        count: waypoints passed, or plans since the goal was drawn.
    """

    count: Int[Tensor, "b"]


class Route(ScriptedPlanner):
    """Drives waypoints one after another.

    Args:
        config: the waypoints.
    """

    plan_every = 1

    def __init__(self, config: RouteConfig) -> None:
        self.config = config
        self._places = torch.tensor(config.places())

    def plan(self, observation: Observation, belief: Belief | None, rng: EpisodeRng) -> Decision:
        """Return the waypoint that comes next."""
        del rng
        places = self._places.to(observation.pose)
        if isinstance(belief, UnderWay):
            passed = _near(observation, belief.goal, self.config.near)
            if not bool(passed.any()):
                return Decision(belief.goal, belief)
            count = belief.count + passed
        else:
            count = torch.zeros(len(observation.pose), dtype=torch.int64)
        count = count % len(places) if self.config.loop else count.clamp(max=len(places) - 1)
        return _under_way(places[count], count)


class Wander(ScriptedPlanner):
    """Drives from place to place in sight.

    Args:
        config: how.
        lidar: of its robot, in whose sight places are drawn.
    """

    plan_every = 5

    def __init__(self, config: WanderConfig, lidar: Lidar) -> None:
        self.config = config
        self.lidar = lidar

    def plan(self, observation: Observation, belief: Belief | None, rng: EpisodeRng) -> Decision:
        """Return the present place, or another where that is reached or the robot has lost patience."""
        fresh = place_in_sight(observation, self.lidar, self.config.reach, rng)
        if not isinstance(belief, UnderWay):
            return _under_way(fresh, torch.zeros(len(fresh), dtype=torch.int64))
        tired = belief.count * self.plan_every * CONTROL_PERIOD >= self.config.patience
        anew = _near(observation, belief.goal, self.config.near) | tired.to(fresh.device)
        goal = torch.where(anew[:, None], fresh, belief.goal)
        return _under_way(goal, torch.where(anew.cpu(), 0, belief.count + 1))


def place_in_sight(
    observation: Observation, lidar: Lidar, reach: float, rng: EpisodeRng
) -> Float[Tensor, "b 2"]:
    """Return a random place on a random beam of the present scan, away from what the beam meets.

    Where all is close, it lies on one of the longest beams.

    Args:
        observation: of the robot.
        lidar: its own.
        reach: farthest place, metres.
        rng: of the agent.
    """
    scan = observation.scan
    lots = rng.uniform(scan.shape[1]).to(scan)
    # open beams by lot, all others by length and far behind
    beam = torch.where(scan >= OPEN, lots, scan / lidar.max_range - 2).argmax(1)
    free = (scan.gather(1, beam[:, None])[:, 0] - MARGIN).clamp(NEAREST / 2, max(reach, NEAREST))
    share = rng.uniform().to(scan)
    distance = torch.minimum(free, NEAREST + share * (free - NEAREST).clamp(min=0))
    seen_from = lidar_poses(lidar, observation.pose)
    heading = seen_from[:, 2] + torch.from_numpy(lidar.angles()).to(scan)[beam]
    return seen_from[:, :2] + distance[:, None] * torch.stack([heading.cos(), heading.sin()], -1)


def stubborn(context: PlannerContext) -> Stubborn:
    """Build planner ``stubborn``."""
    return Stubborn(_configured("stubborn", StubbornConfig(), context), _lidar(context))


def route(context: PlannerContext) -> Route:
    """Build planner ``route``."""
    return Route(_configured("route", RouteConfig(), context))


def wander(context: PlannerContext) -> Wander:
    """Build planner ``wander``."""
    return Wander(_configured("wander", WanderConfig(), context), _lidar(context))


def _configured(name: str, config: Config, context: PlannerContext) -> Config:
    return altered(config, context.settings, f"planner '{name}'")


def _lidar(context: PlannerContext) -> Lidar:
    return context.team.robots[context.agent].lidar


def _under_way(goal: Float[Tensor, "b 2"], count: Int[Tensor, "b"]) -> Decision:
    return Decision(goal, UnderWay(goal, goal, torch.zeros_like(goal), count=count))


def _near(observation: Observation, goal: Float[Tensor, "b 2"], near: float) -> Bool[Tensor, "b"]:
    return (observation.pose[:, :2] - goal).norm(dim=-1) < near
