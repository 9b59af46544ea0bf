"""Meta-planners: choose a goal for one agent from that agent's observation alone.

The loop that calls one (every ``plan_every`` control steps, for all episodes at once)::

    planner = hub().planners.create("hpp", context)
    decision = planner.plan(observation, belief, rng)

and in the control steps between::

    decision = planner.follow(observation, decision)
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from hpp_framework.core.control import ControlLayer, ControlStack
from hpp_framework.core.option import Option
from hpp_framework.core.task import Task
from hpp_framework.core.team import Team
from hpp_framework.core.types import Observation, Trajectories
from hpp_framework.utils.seeding import EpisodeRng


@dataclass(frozen=True)
class Imagination:
    """What a planner weighed, for pictures and inspection.

    Attributes:
        goals: candidates of the last iteration, world coordinates.
        scores: their rewards; higher is better.
        trajectories: the imagined motion for them.
    """

    goals: Float[Tensor, "b g 2"]
    scores: Float[Tensor, "b g"]
    trajectories: Trajectories


@dataclass(frozen=True)
class Belief:
    """An agent's belief over goals between two plans.

    Attributes:
        goal: the shared goal chosen last, world coordinates.
        mean: of the Gaussian over goals, metres.
        std: of the Gaussian over goals, metres, an axis each.
        imagination: what the goal was chosen from, if the planner imagines.
    """

    goal: Float[Tensor, "b 2"]
    mean: Float[Tensor, "b 2"]
    std: Float[Tensor, "b 2"]
    imagination: Imagination | None = None


def certain(goal: Float[Tensor, "b 2"]) -> Belief:
    """Return the belief of a planner that has no doubt."""
    return Belief(goal=goal, mean=goal, std=torch.zeros_like(goal))


@dataclass(frozen=True)
class Decision:
    """What a planner wants of its agent.

    Attributes:
        goal: where the agent's skill is sent, world frame, metres: the belief's goal, the robot's own target
            around it, or a point on the path there.
        belief: that the next plan gets back.
        option: which of the planner's options drives, -1 for none; None leaves it to the agent's own skill.
    """

    goal: Float[Tensor, "b 2"]
    belief: Belief
    option: Int[Tensor, "b"] | None = None


PRESETS = ("paper", "best")
"""Presets that commands offer; planners without presets ignore them."""


class MetaPlanner(ABC):
    """Chooses goals for one agent.

    Attributes:
        plan_every: control steps between plans (the paper's T_h).
        shared_rng: whether all agents share one source of randomness, as only a centralised planner could.
        options: skills that a decision may choose among, instead of the agent's own.
        timed: whether reports say how long a plan takes; not of oracles, which plan once for all agents.
    """

    plan_every: int = 10
    shared_rng: bool = False
    options: Sequence[Option] = ()
    timed: bool = True

    @abstractmethod
    def plan(self, observation: Observation, belief: Belief | None, rng: EpisodeRng) -> Decision:
        """Return what the agent is to do, and the updated belief.

        Args:
            observation: of the planning agent; nothing else may be read.
            belief: of the last decision, None at the start of an episode.
            rng: the agent's own source of randomness.
        """

    def follow(self, observation: Observation, decision: Decision) -> Decision:
        """Return the decision for a control step between two plans.

        Planners of paths move the goal along the path. A goal that stays must be the same object.

        Args:
            observation: of the planning agent; nothing else may be read.
            decision: of the step before.
        """
        del observation
        return decision

    def carry_over(self, belief: Belief) -> Belief | None:
        """Return what remains of a belief where the team changes; None: the agent plans anew.

        Args:
            belief: about the team before.
        """
        del belief
        return None


@dataclass(frozen=True, kw_only=True)
class PlannerContext:
    """What a planner factory is told.

    Attributes:
        team: all robots, with their skills.
        agent: index of the agent that plans.
        task: the shared objective.
        preset: ``"paper"`` or ``"best"``; planners without presets ignore it.
        bounds: (x_min, y_min, x_max, y_max) of the world, metres.
        weights: extra folders searched for predictor weights.
        control: builds the control stack of a robot of the team by its index; for oracles that imagine it.
        settings: that differ from the preset, by dotted name, e.g. ``{"hysteresis": 0.05}``; a planner that
            keeps its parameters in a dataclass ``config`` applies them with
            :func:`hpp_framework.config.settings.altered`. Planners without parameters ignore them.
    """

    team: Team
    agent: int
    task: Task
    preset: str = "best"
    bounds: tuple[float, float, float, float] = (-10.0, -10.0, 10.0, 10.0)
    weights: tuple[Path, ...] = ()
    control: Callable[[int], ControlLayer] = lambda _: ControlStack()
    settings: Mapping[str, Any] = field(default_factory=lambda: dict[str, Any]())
