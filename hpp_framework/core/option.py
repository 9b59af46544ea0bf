"""Options: skills that say where they may be started, when they are over, and how long they may take.

After Sutton, Precup and Singh (1999), "Between MDPs and semi-MDPs": an initiation set, a policy, a
termination condition; and a budget of control steps besides. The loop that runs one, for all episodes at
once::

    option = make_option("p2p", robot)
    if option.may_start(observation, goal).all():
        while not option.is_over(observation, goal, steps).all():
            command = option.skill.act(observation, goal)
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.core.skill import Skill
from hpp_framework.core.types import Observation
from hpp_framework.utils.validation import Count, validated

Condition = Callable[[Observation, Tensor], Tensor]
"""Says of an observation and goals (b, 2) in world coordinates in which episodes (b,) something holds."""

BUDGET = 50
"""Control steps an option may take unless told otherwise: 10 s."""


def anywhere(observation: Observation, goal: Float[Tensor, "b 2"]) -> Bool[Tensor, "b"]:
    """Hold always: the initiation set of a skill that avoids obstacles itself."""
    del goal
    return torch.ones(len(observation.pose), dtype=torch.bool, device=observation.pose.device)


def arrived(radius: float = 0.3) -> Condition:
    """Return the condition that the robot is within ``radius`` metres of its goal."""

    def holds(observation: Observation, goal: Float[Tensor, "b 2"]) -> Bool[Tensor, "b"]:
        return (observation.pose[:, :2] - goal).norm(dim=-1) <= radius

    return holds


@validated
class Option:
    """A skill with an initiation set, a termination condition and a time budget.

    Attributes:
        name: for messages and records.
        skill: that drives.
        starts: where it may be started.
        ends: where it is over.
        budget: control steps after which it is over anyway.
    """

    name: str
    skill: Skill
    starts: Condition = anywhere
    ends: Condition = arrived()
    budget: Count = BUDGET

    def may_start(self, observation: Observation, goal: Float[Tensor, "b 2"]) -> Bool[Tensor, "b"]:
        """Return in which episodes it may be started for these goals."""
        return self.starts(observation, goal)

    def is_over(
        self, observation: Observation, goal: Float[Tensor, "b 2"], steps: int | Tensor
    ) -> Bool[Tensor, "b"]:
        """Return in which episodes it is over.

        Args:
            observation: of the robot.
            goal: that it was started for, world coordinates.
            steps: control steps since then; one number or one per episode.
        """
        over = self.ends(observation, goal)
        return over | (torch.as_tensor(steps, device=over.device) >= self.budget)
