"""From agents to wheels: commands act late, and of those that overtake each other the newest counts."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.core.disturbances import Disturbances
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.perception.mailbox import Mailbox
from hpp_framework.sim.simulator import SUBSTEPS
from hpp_framework.utils.seeding import EpisodeRng


class CommandLinks:
    """Delays the commands of a team.

    What an agent decides upon was sensed a while ago; both delays together lie between what a simulator
    senses and what its wheels do.

    Args:
        disturbances: one for each robot.
    """

    def __init__(self, disturbances: Sequence[Disturbances]) -> None:
        self._delay = torch.tensor([each.latency for each in disturbances])
        self._jitter = torch.tensor([(each.sensing_jitter, each.command_jitter) for each in disturbances])
        self._longest = float((self._delay + self._jitter.sum(1)).max())

    def reset(self, rng: EpisodeRng) -> None:
        """Begin with wheels that stand and nothing under way."""
        self._rng = rng
        self._mail: Mailbox | None = None

    def restart(self, robots: Bool[Tensor, "b n"]) -> None:
        """Forget what is under way to some of the robots."""
        if self._mail is not None:
            self._mail.restart(torch.zeros_like(self._mail.content), robots)

    def delivered(self, commands: Float[Tensor, "b n 2"]) -> Float[Tensor, "b n *p 2"]:
        """Return what the wheels heed in the control period that begins now.

        Args:
            commands: sent now.

        Returns:
            One command for the whole period, or one for each of its equal parts.
        """
        if not self._longest:
            return commands
        if self._mail is None:
            self._mail = Mailbox(self._longest, torch.zeros_like(commands))
        delay = self._delay.to(commands).expand(commands.shape[:2])
        if bool(self._jitter.any()):
            draws = self._rng.uniform(*self._jitter.shape).to(commands)
            delay = delay + (self._jitter.to(commands) * (2 * draws - 1)).sum(-1)
        self._mail.send(commands, delay)
        parts = [self._mail.newest(part * CONTROL_PERIOD / SUBSTEPS)[0] for part in range(SUBSTEPS)]
        return torch.stack(parts, 2)
