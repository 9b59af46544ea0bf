"""RRT+MP and RRT+OA (section 5 of the paper): a rule sets the goal, an RRT path leads there.

Every ``plan_every`` steps a new tree finds a path through what the robot has seen; in between the goal of its
skill moves along the path, ``look_ahead`` metres ahead of the robot.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from hpp_framework.config.settings import altered
from hpp_framework.core.planner import Belief, Decision, MetaPlanner, PlannerContext
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.types import Observation
from hpp_framework.core.world import World
from hpp_framework.planning.baselines.centralized import CentralizedMidpoint, CentralizedOther
from hpp_framework.planning.baselines.rrt import TreeConfig, find_path, require_ompl
from hpp_framework.planning.baselines.rrt_map import Points, room_for, seen_spaces
from hpp_framework.planning.baselines.rrt_path import SPACING, padded, resampled
from hpp_framework.planning.baselines.rrt_predictor import RrtPredictor
from hpp_framework.utils.errors import ConfigError, unknown_name
from hpp_framework.utils.seeding import EpisodeRng
from hpp_framework.utils.validation import Count, NonNegative, Positive, validated
from hpp_framework.worlds.occupancy import FreeSpace, free_space

PROGRESS = 2.0
"""Metres of its path that a robot may be found to have gone in one control step."""
MOST_SEEDS = 2**31 - 2


@validated
class RrtConfig:
    """How a robot finds and follows paths.

    Attributes:
        plan_every: control steps between plans.
        known_map: whether the true map is known, instead of what the robot's lidar saw.
        margin: gap between footprint and obstacles that paths keep, metres.
        snap: whether a goal where the robot does not fit, or that nothing leads to, moves to the nearest
            place that can be reached; else there is no path.
        look_ahead: distance along the path at which the skill's goal lies ahead of the robot, metres.
        tree: how trees grow.
    """

    plan_every: Count = 10
    known_map: bool = False
    margin: NonNegative = 0.1
    snap: bool = True
    look_ahead: Positive = 2.0
    tree: TreeConfig = TreeConfig()


@dataclass(frozen=True)
class RrtBelief(Belief):
    """Adds the path that is followed.

    Attributes:
        path: points at equal distances, world frame, metres; shorter paths stay at their end.
        progress: index of the point that the robot has come to.
    """

    path: Float[Tensor, "b s 2"] = field(kw_only=True)
    progress: Int[Tensor, "b"] = field(kw_only=True)

    def rest(self, row: int) -> Points:
        """Return what one episode's robot has not gone yet."""
        return self.path[row, int(self.progress[row]) :].double().cpu().numpy()


class RrtPlanner(MetaPlanner):
    """Goes where another planner says, along paths through what the robot has seen.

    Where there is no path the robot keeps its old one; without one its goal is the goal itself.

    Args:
        destination: says where to go.
        context: what a planner is told.
        config: parameters.
        predictor: that the destination asks, and that is to be told what the robot knows; None for none.

    Attributes:
        config: the effective parameters, for records; more than ``config`` where the destination has some.
    """

    def __init__(
        self,
        destination: MetaPlanner,
        context: PlannerContext,
        config: RrtConfig,
        predictor: RrtPredictor | None = None,
    ) -> None:
        require_ompl()
        self.destination = destination
        self.predictor = predictor
        self.robot: RobotSpec = context.team.robots[context.agent]
        self.bounds = context.bounds
        self.path = config
        self.config: Any = config
        self.plan_every = config.plan_every
        self._known: dict[int, tuple[World, FreeSpace]] = {}

    @torch.no_grad()
    def plan(self, observation: Observation, belief: Belief | None, rng: EpisodeRng) -> Decision:
        """Return the first waypoint of a new path."""
        seeds = (1 + rng.integers(MOST_SEEDS)).tolist()
        spaces = self.spaces(observation)
        if self.predictor is not None:
            self.predictor.prepare(spaces, seeds)
        wanted = self.destination.plan(observation, None, rng)
        goals, chosen = wanted.goal, wanted.belief
        starts, ends = (part.double().cpu().numpy() for part in (observation.pose[:, :2], goals))
        found = [self.route(*problem) for problem in zip(spaces, starts, ends, seeds, strict=True)]
        old = belief if isinstance(belief, RrtBelief) else None
        paths = [
            (old.rest(row) if old else ends[row, None]) if route is None else resampled(route)
            for row, route in enumerate(found)
        ]
        renewed = RrtBelief(
            chosen.goal, chosen.mean, chosen.std, chosen.imagination,
            path=torch.from_numpy(padded(paths)).to(goals),
            progress=torch.zeros(len(paths), dtype=torch.long),
        )  # fmt: skip
        return self.follow(observation, Decision(goals, renewed))

    def follow(self, observation: Observation, decision: Decision) -> Decision:
        """Return the waypoint ahead of the place that the robot has come to; it never goes back."""
        belief = decision.belief
        if not isinstance(belief, RrtBelief):
            return decision
        gone = torch.arange(belief.path.shape[1]) - belief.progress[:, None]
        away = (belief.path - observation.pose[:, None, :2]).norm(dim=-1)
        progress = away.masked_fill((gone < 0) | (gone > PROGRESS / SPACING), torch.inf).argmin(1)
        ahead = (progress + round(self.path.look_ahead / SPACING)).clamp(max=belief.path.shape[1] - 1)
        goal = belief.path[torch.arange(len(ahead)), ahead]
        return Decision(goal, replace(belief, progress=progress))

    def spaces(self, observation: Observation) -> Sequence[FreeSpace]:
        """Return what is known of free space in each episode: the true map, or what the robot has seen.

        Raises:
            ConfigError: if the true map is wanted where there is none.
        """
        if not self.path.known_map:
            return seen_spaces(observation, self.robot.lidar, self.bounds)
        privileged = observation.privileged
        if privileged is None:
            raise ConfigError(
                "a planner with known_map=true needs the true map, which only `hpp evaluate` and `hpp run` "
                "give it. Leave the setting out here."
            )
        known, height = self._known, self.robot.height
        # worlds are kept beside their maps: an identity is not used again while its object lives
        self._known = {
            id(world): known.get(id(world)) or (world, free_space(world, body_height=height))
            for world in privileged.worlds
        }
        return [self._known[id(world)][1] for world in privileged.worlds]

    def route(self, space: FreeSpace, start: Points, goal: Points, seed: int) -> Points | None:
        """Return a path (p, 2) in one episode, or None if there is none.

        A robot nearer to an obstacle than paths keep first leaves for the nearest place that is not.

        Args:
            space: what is known of free space.
            start: where the robot is, metres.
            goal: where it wants to go, metres.
            seed: of the search, positive.
        """
        config = self.path
        room = room_for(space, self.robot.footprint_radius + config.margin)
        begin = room.nearest(start)
        if begin is None:
            return None
        around = room.around(begin)
        end = around.nearest(goal) if config.snap else goal
        if end is None:
            return None
        if config.tree.simplify and bool(around.passes(begin, end).all()):
            return np.stack([start, begin, end])
        path = find_path(around, begin, end, config.tree, seed)
        return None if path is None else np.concatenate([start[None], path])


PLAIN = TreeConfig(tries=1, simplify=False)
"""Trees and paths as LaValle (1998) has them."""
PRESETS = {"paper": RrtConfig(plan_every=40, snap=False, tree=PLAIN), "best": RrtConfig()}


def midpoint(context: PlannerContext) -> RrtPlanner:
    """Build RRT+MP: along an RRT path to the midpoint of the team.

    Raises:
        ConfigError: if OMPL is not installed.
    """
    return RrtPlanner(CentralizedMidpoint(context.task), context, configured("rrt-mp", PRESETS, context))


def other(context: PlannerContext) -> RrtPlanner:
    """Build RRT+OA: along an RRT path to another robot, the next one of the team where there are several.

    Raises:
        ConfigError: if OMPL is not installed.
    """
    return RrtPlanner(CentralizedOther(context.task), context, configured("rrt-oa", PRESETS, context))


Config = TypeVar("Config")


def configured(name: str, presets: Mapping[str, Config], context: PlannerContext) -> Config:
    """Return the parameters of a planner under the context's preset and settings.

    Raises:
        UnknownNameError: if there is no such preset.
    """
    if context.preset not in presets:
        raise unknown_name("preset", context.preset, presets)
    owner = f"planner '{name}', preset '{context.preset}'"
    return altered(presets[context.preset], context.settings, owner)
