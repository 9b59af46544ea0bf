"""Skills: goal-conditioned low-level policies.

The loop that calls one (every control step, for all episodes at once)::

    skill = hub().skills.create("p2p", robot)
    command = skill.act(observation, goal)
"""

from __future__ import annotations

import shlex
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.types import Observation


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
        init: weights to start from: a file, or the name of a robot that has some; or None.
        threads: torch threads.
        settings: of the trainer's recipe, by dotted name, e.g. ``{"reward.touch": -0.4}``.
        judge: whether the finished skill is judged in unseen worlds for its card.
    """

    robot: str
    out: Path
    seed: int = 0
    steps: int = 4_000_000
    init: Path | None = None
    threads: int = 2
    settings: Mapping[str, Any] = field(default_factory=lambda: dict[str, Any]())
    judge: bool = True


def as_pairs(settings: Mapping[str, Any]) -> list[str]:
    """Return settings as ``name=value`` pairs, quoted for a shell, that a command line reads back."""
    # YAML takes 1e-05 for text, and 1.0e-05 for a number
    return [
        shlex.quote(f"{name}={yaml.safe_dump(value).splitlines()[0]}") for name, value in settings.items()
    ]
