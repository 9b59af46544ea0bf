"""Planners that look behind the curtain: ceilings to compare decentralised planners with, no methods.

Whoever runs the episodes shows them the truth, in every step and before anybody acts::

    truth = Truth(worlds, state, observations, running)
    for agent in agents:
        if isinstance(agent.planner, PrivilegedPlanner):
            agent.planner.witness(truth)
    commands = [agent.act(observation) for agent, observation in zip(agents, observations)]

Only :func:`hpp_framework.evaluation.rollout.run_episodes` does.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

from jaxtyping import Bool
from torch import Tensor

from hpp_framework.core.planner import MetaPlanner
from hpp_framework.core.predictor import Predictor
from hpp_framework.core.types import Observation, State
from hpp_framework.core.world import World

Answer = TypeVar("Answer")


@dataclass(frozen=True)
class Truth:
    """What no robot knows.

    Attributes:
        worlds: one an episode.
        state: of the simulator, noise-free.
        observations: of all agents, in team order.
        running: episodes that are not decided yet.
    """

    worlds: Sequence[World]
    state: State
    observations: Sequence[Observation]
    running: Bool[Tensor, "b"]
    _answers: dict[str, Any] = field(default_factory=lambda: dict[str, Any](), repr=False, compare=False)

    def once(self, question: str, answer: Callable[[], Answer]) -> Answer:
        """Return the answer to a question, worked out for the first agent that asks and the same for all.

        Args:
            question: what is asked; questions of different planners need different names.
            answer: works it out.
        """
        if question not in self._answers:
            self._answers[question] = answer()
        return self._answers[question]


class PrivilegedPlanner(MetaPlanner):
    """A meta-planner that is shown the truth before each plan."""

    @abstractmethod
    def witness(self, truth: Truth) -> None:
        """Take note of the truth of this control step; called in each, plans or not."""


class PrivilegedPredictor(Predictor):
    """A predictor that answers from the truth.

    Attributes:
        truth: of the control step in which it is asked.
    """

    truth: Truth
