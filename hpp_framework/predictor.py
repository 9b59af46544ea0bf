"""Predictors: goal-conditioned motion models of a whole team, from one agent's point of view.

The loop that calls one (inside a meta-planner)::

    imagined = predictor.rollout(observation, goals, horizon)
    scores = task.reward(imagined.poses[:, :, -1])
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path

from jaxtyping import Float
from torch import Tensor

from hpp_framework.team import Team
from hpp_framework.types import Observation, Trajectories


class Predictor(ABC):
    """Answers "where would we all be if we shared this goal?"."""

    @abstractmethod
    def rollout(self, observation: Observation, goals: Float[Tensor, "b g 2"], horizon: int) -> Trajectories:
        """Imagine the motion of every robot of the team towards each goal.

        Args:
            observation: of the predicting agent.
            goals: candidates in world coordinates, metres.
            horizon: number of prediction steps; their length is the predictor's own
                (see ``Trajectories.times``).
        """


@dataclass(frozen=True, kw_only=True)
class PredictorRequest:
    """What a predictor factory is told.

    Attributes:
        team: everybody, with robots and skills.
        agent: index of the agent that will use it.
        folders: extra folders searched for weights before the registered ones.
    """

    team: Team
    agent: int
    folders: tuple[Path, ...] = ()


@dataclass(frozen=True, kw_only=True)
class PredictorTraining:
    """What every predictor trainer is told.

    Attributes:
        data: folder written by ``hpp collect``.
        out: folder for weights, card and curves.
        agent: index of the predicting robot in the collected team.
        subject: index of the predicted robot; equal to ``agent`` for self-prediction.
        seed: of the network and the batches.
        steps: gradient steps.
        batch: samples a gradient step.
        learning_rate: of Adam.
        threads: torch threads.
    """

    data: Path
    out: Path
    agent: int
    subject: int
    seed: int = 0
    steps: int = 50_000
    batch: int = 500
    learning_rate: float = 1e-3
    threads: int = 2
