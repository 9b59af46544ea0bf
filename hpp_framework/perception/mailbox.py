"""Things that are late: what was sent last counts as soon as it is there."""

from __future__ import annotations

import math

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.core.timing import CONTROL_PERIOD

EPSILON = 1e-5
"""Seconds that rounding may cost."""


class Mailbox:
    """Keeps what was sent once a control step until it arrives.

    What is overtaken by something sent later is dropped; what never arrives leaves the one before in place.

    Args:
        longest: seconds that anything takes at most.
        first: what counts until something arrives (b, ..., d).
    """

    def __init__(self, longest: float, first: Float[Tensor, "b *s d"]) -> None:
        slots = max(math.ceil(longest / CONTROL_PERIOD - EPSILON), 0) + 1
        self._content = first[None].repeat(slots, *[1] * first.dim())
        self._arrival = torch.full((slots, *first.shape[:-1]), torch.inf)
        self._sent = 0
        self.content = first
        self.stamp = torch.zeros(first.shape[:-1], dtype=torch.int64)

    def send(self, content: Float[Tensor, "b *s d"], delay: Float[Tensor, "b *s"]) -> None:
        """Send something that takes so many seconds, or never arrives (infinite), once a control step."""
        self._content = torch.cat([self._content[1:], content[None]])
        self._arrival = torch.cat([self._arrival[1:] - CONTROL_PERIOD, delay[None]])
        self._sent += 1

    def newest(self, elapsed: float) -> tuple[Float[Tensor, "b *s d"], Bool[Tensor, "b *s"]]:
        """Return what counts now, and whether it is new.

        Args:
            elapsed: seconds since something was sent last.
        """
        arrived = (self._arrival <= elapsed + EPSILON).flip(0).to(torch.uint8)
        there, back = arrived.max(0)
        stamp = self._sent - back
        new = (there > 0) & (stamp > self.stamp)
        slot = (len(self._content) - 1 - back)[None, ..., None].expand(1, *self.content.shape)
        self.content = torch.where(new[..., None], self._content.gather(0, slot)[0], self.content)
        self.stamp = torch.where(new, stamp, self.stamp)
        return self.content, new

    @property
    def age(self) -> Float[Tensor, "b *s"]:
        """Seconds from when what counts was sent to when something was sent last."""
        return (self._sent - self.stamp) * CONTROL_PERIOD

    def restart(self, content: Float[Tensor, "b *s d"], chosen: Bool[Tensor, "b *s"]) -> None:
        """Let what is given count for some, as if sent last, and drop what is under way to them."""
        self.content = torch.where(chosen[..., None], content, self.content)
        self.stamp = torch.where(chosen, self._sent, self.stamp)
        self._arrival = torch.where(chosen[None], torch.inf, self._arrival)
