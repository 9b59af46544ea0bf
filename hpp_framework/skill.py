"""Skills: goal-conditioned low-level policies.

The loop that calls one (every control step, for all episodes at once)::

    skill = hub().skills.create("p2p", robot)
    command = skill.act(observation, goal)
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path

from jaxtyping import Float
from torch import Tensor

from hpp_framework.types import Observation


class Skill(ABC):
    """Drives one robot towards a goal from that robot's own observation."""

    @abstractmethod
    def act(self, observation: Observation, goal: Float[Tensor, "b 2"]) -> Float[Tensor, "b 2"]:
        """Return commands [v in m/s, omega in rad/s].

        Args:
            observation: what the agent knows.
            goal: world coordinates in metres.
        """


@dataclass(frozen=True, kw_only=True)
class SkillTraining:
    """What every skill trainer is told.

    Attributes:
        robot: registered robot to train for.
        out: folder for weights, card, curves and resumable state.
        seed: of the worlds, the noise and the network.
        steps: robot control steps to train for.
        init: weights to start from, or None.
        threads: torch threads.
    """

    robot: str
    out: Path
    seed: int = 0
    steps: int = 4_000_000
    init: Path | None = None
    threads: int = 2
