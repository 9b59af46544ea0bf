"""Policies: planners that drive as well, from observation to command, with no goal and no skill between.

An agent that is given one asks it as its planner and as its skill::

    policy = hub().planners.create("maddpg", context)
    command = policy.command(observation)
"""

from __future__ import annotations

from abc import abstractmethod

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.geometry import to_world
from hpp_framework.core.planner import Belief, MetaPlanner, certain
from hpp_framework.core.skill import Skill
from hpp_framework.core.types import Observation


class Policy(MetaPlanner, Skill):
    """Drives one robot of a team from that robot's own observation; the robot's skill is not used.

    What it gives as its goal is for those who look on: where one second of its command leads.
    """

    plan_every = 1

    @abstractmethod
    def command(self, observation: Observation) -> Float[Tensor, "b 2"]:
        """Return commands [v in m/s, omega in rad/s].

        Args:
            observation: of the agent; nothing else may be read.
        """

    def plan(
        self, observation: Observation, belief: Belief | None, rng: torch.Generator
    ) -> tuple[Float[Tensor, "b 2"], Belief]:
        """Return where one second of the command leads, in world coordinates."""
        del belief, rng
        speed, turn = self.command(observation).unbind(-1)
        # the chord of an arc of length v and angle omega
        chord = speed * torch.sinc(turn / (2 * torch.pi))
        ahead = torch.stack([chord * (turn / 2).cos(), chord * (turn / 2).sin()], -1)
        goal = to_world(observation.pose, ahead)
        return goal, certain(goal)

    def act(self, observation: Observation, goal: Float[Tensor, "b 2"]) -> Float[Tensor, "b 2"]:
        """Return :meth:`command`, whatever the goal."""
        del goal
        return self.command(observation)
