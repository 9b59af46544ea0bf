"""Oracles: planner ``hpp`` with privileged information. They are not decentralised methods.

- ``full-communication``: all robots share everything. There is one belief and one goal for all. Every robot
  is predicted by its own model of itself from its own scan. The gain over ``hpp`` is the cost of not
  communicating.
- ``perfect-model``: besides, motion is not predicted but simulated from the true state. The gain over the
  former is the cost of the predictor. Remaining failures are due to the skill, the search over goals, or the
  episode itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.planner import Belief, Decision, MetaPlanner, PlannerContext
from hpp_framework.core.predictor import ImaginePlaces, Predictor
from hpp_framework.core.team import Team
from hpp_framework.core.types import Observation, Trajectories
from hpp_framework.planning.hpp.planner import MakePredictor, hpp, own_predictor
from hpp_framework.planning.oracles.perfect_model import PerfectModel
from hpp_framework.planning.targets import own_target
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.seeding import EpisodeRng

PERFECT_PLAN_EVERY = 10
"""Control steps between plans by simulation, which are dear; less often than predictions need it, as a
simulated plan does not turn out wrong."""


NOTHING_TO_GUESS: Mapping[str, Mapping[str, Any]] = {
    "best": {"respond": False, "likelihood_weight": 0.0, "occlusion_penalty": 0.0}
}
"""Settings by preset that switch off the guessing of others' goals and surroundings: where all is shared
there is nothing to guess, and a goal is scored as what it is, a goal of all."""


class Oracle(MetaPlanner):
    """Planner ``hpp`` for the whole team: the first agent that asks has it plan; all get one goal and belief.

    It plans from the first agent's observed poses.

    Args:
        name: registered, for messages.
        context: what a planner is told.
        make_predictor: builds the predictor that it plans with.

    Raises:
        ConfigError: if the team changes, or one of its robots has another planner.
    """

    shared_rng = True
    timed = False

    def __init__(self, name: str, context: PlannerContext, make_predictor: MakePredictor) -> None:
        _check_team(name, context.team)
        self.name = name
        self.task = context.task
        settings = {**NOTHING_TO_GUESS.get(context.preset, {}), **context.settings}
        self.planner = hpp(replace(context, settings=settings), make_predictor)
        self.plan_every = self.planner.plan_every
        self.config: Any = getattr(self.planner, "config", None)

    def plan(self, observation: Observation, belief: Belief | None, rng: EpisodeRng) -> Decision:
        """Return the own target of the whole team's goal.

        Raises:
            ConfigError: if the observation holds nothing privileged.
        """
        privileged = observation.privileged
        if privileged is None:
            raise ConfigError(
                f"planner '{self.name}' is an oracle: it needs the true state, which only `hpp evaluate` and "
                "`hpp run` give it. Use another planner here."
            )
        first = replace(privileged.observations[0], privileged=privileged)
        shared = privileged.once(self.name, lambda: self.planner.plan(first, belief, rng).belief)
        own = own_target(self.task, shared.goal, first.team_poses, observation.agent)
        return Decision(own, shared)


def _check_team(name: str, team: Team) -> None:
    """Refuse a team for which an oracle cannot plan all the time."""
    for member in team.members:
        if member.planner is not None and member.planner.partition(":")[0] != name:
            raise ConfigError(
                f"planner '{name}' is an oracle: it plans for the whole team, but '{member.id}' has a "
                f"planner of its own, '{member.planner}'. Leave out either."
            )
        if member.joins_at > 0 or member.leaves_at is not None:
            raise ConfigError(
                f"planner '{name}' is an oracle: it plans for the whole team at once, not for one that "
                "robots join or leave. Leave out either the oracle, or joins_at and leaves_at."
            )


class PooledPredictor(Predictor):
    """Asks every robot's own model of itself, with that robot's own observation.

    Args:
        predictors: one per agent, in team order.
    """

    def __init__(self, predictors: list[Predictor]) -> None:
        self.predictors = predictors

    @torch.no_grad()
    def rollout(self, observation: Observation, goals: Float[Tensor, "b g 2"], horizon: int) -> Trajectories:
        """Imagine the motion of the team as each robot imagines its own."""
        own = [
            predictor.rollout(seen, goals, horizon)
            for predictor, seen in zip(self.predictors, _observations(observation), strict=True)
        ]
        return _joined(own)

    @torch.no_grad()
    def condition_places(self, observation: Observation, horizon: int) -> ImaginePlaces:
        """Ask every robot's own model for that robot's own places."""

        def imagine(places: Float[Tensor, "b g n 2"]) -> Trajectories:
            pairs = enumerate(zip(self.predictors, _observations(observation), strict=True))
            return _joined(
                [predictor.rollout(seen, places[:, :, i], horizon) for i, (predictor, seen) in pairs]
            )

        return imagine


def _observations(observation: Observation) -> Sequence[Observation]:
    assert observation.privileged is not None, "only an oracle asks this predictor"
    return observation.privileged.observations


def _joined(own: list[Trajectories]) -> Trajectories:
    """Return the motion of each robot as it imagines it itself."""
    poses = torch.stack([one.poses[..., i, :] for i, one in enumerate(own)], -2)
    stated = [one.std for one in own if one.std is not None]
    std = (
        torch.stack([each[..., i] for i, each in enumerate(stated)], -1) if len(stated) == len(own) else None
    )
    return Trajectories(poses, own[0].times, std)


def full_communication(context: PlannerContext) -> Oracle:
    """Build the full-communication oracle of ``hpp`` under the context's preset and settings."""

    def pooled(name: str, context: PlannerContext) -> PooledPredictor:
        team = range(len(context.team))
        return PooledPredictor([own_predictor(name, replace(context, agent=i)) for i in team])

    return Oracle("full-communication", context, pooled)


def perfect_model(context: PlannerContext) -> Oracle:
    """Build ``hpp`` with the simulator as its predictor; plans every 2 s unless settings say otherwise."""

    def simulated(name: str, context: PlannerContext) -> PerfectModel:
        return PerfectModel(context, own_predictor(name, context), settings["plan_every"])

    settings: dict[str, Any] = {"plan_every": PERFECT_PLAN_EVERY, **context.settings}
    return Oracle("perfect-model", replace(context, settings=settings), simulated)
