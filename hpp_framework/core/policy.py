"""Policies: drive one robot end to end, from its observation to its command, without a goal or a skill.

The loop that calls one (every control step, for all episodes at once)::

    policy = hub().policies.create("maddpg", context)
    command = policy.act(observation)
"""

from __future__ import annotations

from abc import ABC, abstractmethod

from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.types import Observation


class Policy(ABC):
    """Drives one robot of a team from that robot's own observation."""

    @abstractmethod
    def act(self, observation: Observation) -> Float[Tensor, "b 2"]:
        """Return commands [v in m/s, omega in rad/s].

        Args:
            observation: of the agent; nothing else may be read.
        """
