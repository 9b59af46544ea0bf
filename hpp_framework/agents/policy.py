"""Agents without a hierarchy: a policy drives from observation to command, layers have the last word."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.agent import Agent
from hpp_framework.core.control import ControlLayer
from hpp_framework.core.geometry import to_world
from hpp_framework.core.planner import certain
from hpp_framework.core.policy import Policy
from hpp_framework.core.types import Observation


class PolicyAgent(Agent):
    """Asks a policy every control step.

    Its goal is for those who look on: where one second of the command leads.

    Args:
        policy: from the robot's own observation to its command.
        control: between the policy and the wheels.
    """

    def __init__(self, policy: Policy, control: ControlLayer) -> None:
        self.policy = policy
        self.control = control
        self.config = getattr(policy, "config", None)

    def reset(self, seeds: Sequence[int]) -> None:
        """Forget the episodes before."""
        del seeds
        self.belief = None

    def act(self, observation: Observation) -> Float[Tensor, "b 2"]:
        """Return commands [v, omega] for this control step."""
        command = self.policy.act(observation)
        self.goal = one_second_ahead(observation, command)
        self.belief = certain(self.goal)
        self.waypoint = self.control.redirect(observation, self.goal, self.goal)
        self.command = self.control.filter(observation, self.waypoint, command)
        return self.command


def one_second_ahead(observation: Observation, command: Float[Tensor, "b 2"]) -> Float[Tensor, "b 2"]:
    """Return where one second of a command leads, world frame, metres: the chord of its arc."""
    speed, turn = command.unbind(-1)
    chord = speed * torch.sinc(turn / (2 * torch.pi))
    ahead = torch.stack([chord * (turn / 2).cos(), chord * (turn / 2).sin()], -1)
    return to_world(observation.pose, ahead)
