"""Agents: what drives one robot of a team from that robot's own observations.

The loop that calls them, all episodes of a batch at once::

    for agent in agents:
        agent.reset(seeds)
    while not done:
        commands = [agent.act(env.observe(i)) for i, agent in enumerate(agents)]
        done = env.step(commands)
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.planner import Belief, Decision
from hpp_framework.core.types import Observation
from hpp_framework.utils.seeding import EpisodeRng


@dataclass(frozen=True)
class Memory:
    """What an agent hands on to the next agent of the same robot, where a team changes.

    Attributes:
        rng: its randomness.
        until_plan: control steps until it plans again.
        decision: taken last.
        waypoint: where its skill is sent.
    """

    rng: EpisodeRng
    until_plan: int
    decision: Decision
    waypoint: Tensor


class Agent(ABC):
    """Drives one robot; the decentralised unit.

    Attributes:
        present: whether the robot takes part now.
        belief: what its planner said last; None before the first plan, and of agents that do not plan.
        goal: chosen last for the team, world frame, metres.
        waypoint: where its skill is sent, world frame, metres.
        command: sent last, [v in m/s, omega in rad/s].
        config: effective parameters of its planner or policy, a dataclass; None if it has none.
    """

    present: bool = True
    belief: Belief | None = None
    goal: Tensor = torch.empty(0, 2)
    waypoint: Tensor = torch.empty(0, 2)
    command: Tensor = torch.empty(0, 2)
    config: object = None

    @abstractmethod
    def reset(self, seeds: Sequence[int]) -> None:
        """Forget the episodes before.

        Args:
            seeds: of the episodes that begin, one each.
        """

    @abstractmethod
    def act(self, observation: Observation) -> Float[Tensor, "b 2"]:
        """Return commands [v in m/s, omega in rad/s] for this control step.

        Args:
            observation: of this robot; nothing else may be read.
        """

    def memory(self) -> Memory | None:
        """Return what another agent of this robot may go on from; None for nothing."""
        return None

    def carry_over(self, memory: Memory | None) -> None:
        """Go on from the memory of another agent of this robot, as far as that makes sense."""
        del memory

    def plan_seconds(self, observation: Observation, repeats: int) -> list[float]:
        """Return wall times of single plans, for reports; the agent stays as it is.

        Args:
            observation: of one episode.
            repeats: plans to time.
        """
        del observation, repeats
        return []
