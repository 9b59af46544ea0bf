"""What MADDPG remembers of its training: whole episodes, scans and all, in half precision."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.training.maddpg.learner import Transitions


class Replay:
    """Rounds of episodes of equal length that ran side by side; the newest replace the oldest.

    Args:
        rounds: finished ones that it has room for.
        steps: control steps an episode.
        episodes: side by side.
        shape: of what everybody sees in one control step: (agents, features).
        actions: numbers that each agent decides on.
    """

    def __init__(self, rounds: int, steps: int, episodes: int, shape: tuple[int, int], actions: int) -> None:
        self.rounds = rounds
        self.finished = 0
        # one more for the round that is not finished
        self._slots = rounds + 1
        self._seen = torch.zeros(self._slots, steps + 1, episodes, *shape, dtype=torch.float16)
        self._actions = torch.zeros(self._slots, steps, episodes, shape[0], actions)
        self._rewards = torch.zeros(self._slots, steps, episodes)

    def __len__(self) -> int:
        """Return the number of transitions of finished rounds."""
        return min(self.finished, self.rounds) * self._rewards[0].numel()

    def begin(self, seen: Float[Tensor, "e n f"]) -> None:
        """Note what everybody sees when a round begins."""
        self._seen[self.finished % self._slots, 0] = seen

    def add(
        self,
        step: int,
        actions: Float[Tensor, "e n a"],
        rewards: Float[Tensor, "e"],
        seen: Float[Tensor, "e n f"],
    ) -> None:
        """Note a control step of the round.

        Args:
            step: its number in the round, from 0; with the last one the round counts as finished.
            actions: everybody's.
            rewards: of the teams.
            seen: features after the step.
        """
        place = self.finished % self._slots
        self._actions[place, step] = actions
        self._rewards[place, step] = rewards
        self._seen[place, step + 1] = seen
        self.finished += step + 1 == self._rewards.shape[1]

    def sample(self, size: int, rng: torch.Generator) -> Transitions:
        """Draw transitions of finished rounds, with replacement."""
        _, steps, episodes = self._rewards.shape
        drawn = torch.randint(len(self), (size,), generator=rng)
        oldest = max(0, self.finished - self.rounds)
        place = (oldest + drawn // (steps * episodes)) % self._slots
        chosen = place * steps * episodes + drawn % (steps * episodes)
        # observations have one more row a round than transitions
        seen = chosen + place * episodes
        every = self._seen.flatten(0, 2)
        return Transitions(
            seen=every[seen].float(),
            actions=self._actions.flatten(0, 2)[chosen],
            rewards=self._rewards.flatten()[chosen],
            seen_next=every[seen + episodes].float(),
        )
