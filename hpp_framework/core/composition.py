"""Tasks made of terms: a weighed sum of errors for the reward, limits on errors for success."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.core.requirement import AllOf, Requirement
from hpp_framework.core.task import Task, Terminal, relative_speed
from hpp_framework.core.term import Term
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.validation import Count, Positive, validated

REST_SPEED = 0.1
"""Largest relative speed at success, m/s, unless a task says otherwise; that of a rendezvous."""


@dataclass(frozen=True)
class Weighed:
    """A term of the reward.

    Attributes:
        term: what is judged.
        weight: what an error of 1 costs. Planners weigh rewards as they are; Eq. 1 costs 2 a metre and pair.
    """

    term: Term
    weight: float = 1.0


@dataclass(frozen=True)
class Limit:
    """A condition of success.

    Attributes:
        term: what is judged.
        at_most: largest error that fulfils it.
    """

    term: Term
    at_most: float = 0.0


@validated
class Rules:
    """When a composed task is fulfilled, motion included.

    Attributes:
        sustain_steps: consecutive control steps that success must hold.
        rest_speed: relative speed of two robots at success, at most, m/s; None where motion does not matter.
        halts: whether agents stop where the task is fulfilled.
    """

    sustain_steps: Count = 5
    rest_speed: Positive | None = REST_SPEED
    halts: bool = True


class ComposedTask(Task):
    """A task made of terms.

    The reward is minus the sum of all errors by weight, and 0 where the task is fulfilled, as in Eq. 1.

    Args:
        rewards: what is paid for.
        success: what must hold; all of it.
        rules: when it counts.

    Raises:
        ConfigError: if nothing is paid for or nothing must hold.
    """

    def __init__(
        self, rewards: Sequence[Weighed], success: Sequence[Limit], rules: Rules | None = None
    ) -> None:
        if not rewards or not success:
            raise ConfigError("a task needs at least one term of reward and one of success.")
        self.rewards = tuple(rewards)
        self.limits = tuple(success)
        self.rules = rules or Rules()
        self.sustain_steps = self.rules.sustain_steps
        self.halts = self.rules.halts

    def unit(self, robots: int) -> float:
        """Return what errors of a metre cost together, against those of a formation of two; at least 1."""
        nowhere = torch.zeros(robots, 3)
        costs = (each.weight * each.term.errors(nowhere).shape[-1] for each in self.rewards)
        return max(sum(costs) / 4, 1.0)

    def reward(self, poses: Float[Tensor, "*b n 3"]) -> Float[Tensor, "*b"]:
        """Return minus the weighed sum of the errors, 0 where the task is fulfilled."""
        # a term is often paid for and asked for
        errors = {each.term: each.term.errors(poses) for each in (*self.rewards, *self.limits)}
        paid = [errors[each.term].sum(-1).mul_(-each.weight) for each in self.rewards]
        return torch.stack(paid).sum(0).masked_fill_(self._kept(errors), 0.0)

    def success(
        self, poses: Float[Tensor, "*b n 3"], velocities: Float[Tensor, "*b n 2"] | None = None
    ) -> Bool[Tensor, "*b"]:
        """Return whether no error exceeds its limit, and no two robots move against each other too fast."""
        kept = self._kept({each.term: each.term.errors(poses) for each in self.limits})
        if velocities is None or self.rules.rest_speed is None:
            return kept
        return kept & (relative_speed(poses, velocities) < self.rules.rest_speed)

    def _kept(self, errors: Mapping[Term, Float[Tensor, "*b _"]]) -> Bool[Tensor, "*b"]:
        return torch.stack([(errors[each.term] <= each.at_most).all(-1) for each in self.limits]).all(0)

    def targets(
        self, goals: Float[Tensor, "*#b 2"], poses: Float[Tensor, "*#b n 3"]
    ) -> Float[Tensor, "*c n 3"] | None:
        """Return the targets that the first term with targets gives."""
        for each in (*self.rewards, *self.limits):
            targets = each.term.targets(goals, poses)
            if targets is not None:
                return targets
        return None

    def terminal(self, poses: Float[Tensor, "b n 3"]) -> Terminal | None:
        """Return what the first term with a terminal phase says."""
        for each in (*self.rewards, *self.limits):
            terminal = each.term.terminal(poses)
            if terminal is not None:
                return terminal
        return None

    def requirement(self) -> Requirement | None:
        """Return what all conditions require."""
        found = [each.term.requirement(each.at_most) for each in self.limits]
        parts = tuple(each for each in found if each is not None)
        return AllOf(parts) if parts else None
