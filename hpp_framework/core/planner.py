"""Meta-planners: choose a goal for one agent from that agent's observation alone.

The loop that calls one (every ``plan_every`` control steps, for all episodes at once)::

    planner = hub().planners.create("hpp", context)
    goal, belief = planner.plan(observation, belief, rng)

and in the control steps between::

    goal, belief = planner.follow(observation, goal, belief)
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.task import Task
from hpp_framework.core.team import Team
from hpp_framework.core.types import Observation, Trajectories


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


PRESETS = ("paper", "best")
"""Presets that commands offer; planners without presets ignore them."""


class MetaPlanner(ABC):
    """Chooses goals for one agent.

    Attributes:
        plan_every: control steps between plans (the paper's T_h).
        centralised: whether all agents share one source of randomness, as only a centralised planner could.
        guided: whether its agents have a :class:`~hpp_framework.control.rotate_to_path.Guide` unless told
            otherwise.
        heedless: whether it heeds no other robot, so that it goes on as before when the team changes.
        rests: whether its agents stop where that fulfils the task.
    """

    plan_every: int = 10
    centralised: bool = False
    guided: bool = False
    heedless: bool = False
    rests: bool = True

    @abstractmethod
    def plan(
        self, observation: Observation, belief: Belief | None, rng: torch.Generator
    ) -> tuple[Float[Tensor, "b 2"], Belief]:
        """Return a goal for the agent's own skill, in world coordinates, and the updated belief.

        Args:
            observation: of the planning agent; nothing else may be read.
            belief: what the last call returned, None at the start of an episode.
            rng: the agent's own source of randomness.
        """

    def follow(
        self, observation: Observation, goal: Float[Tensor, "b 2"], belief: Belief
    ) -> tuple[Float[Tensor, "b 2"], Belief]:
        """Return the goal for a control step between two plans; planners of paths move it along the path.

        Args:
            observation: of the planning agent; nothing else may be read.
            goal: of the step before.
            belief: what the last call left.
        """
        del observation
        return goal, belief


@dataclass(frozen=True, kw_only=True)
class PlannerContext:
    """What a planner factory is told.

    Attributes:
        team: everybody, with robots and skills.
        agent: index of the agent that plans.
        task: the shared objective.
        preset: ``"paper"`` or ``"best"``; planners without presets ignore it.
        bounds: (x_min, y_min, x_max, y_max) of the world, metres.
        weights: extra folders searched for predictor weights.
        settings: that differ from the preset, by dotted name, e.g. ``{"keep": 0.05}``; a planner that keeps
            its parameters in a dataclass ``config`` applies them with
            :func:`hpp_framework.config.settings.altered`. Planners without parameters ignore them.
    """

    team: Team
    agent: int
    task: Task
    preset: str = "best"
    bounds: tuple[float, float, float, float] = (-10.0, -10.0, 10.0, 10.0)
    weights: tuple[Path, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=lambda: dict[str, Any]())
