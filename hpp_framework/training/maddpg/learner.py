"""What MADDPG learns from and how (Lowe et al. 2017, algorithm 1): one actor and one critic per agent.

A critic sees what all agents see and do, an actor only what its own agent sees. All networks of a kind are
stacked and work side by side.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.optim import Adam

from hpp_framework.planning.baselines.maddpg import Layers


@dataclass(frozen=True, kw_only=True)
class MaddpgConfig:
    """Hyper-parameters; the paper names batch and rate only, the others are those of Lowe et al.

    Attributes:
        batch: transitions a gradient step.
        learning_rate: of Adam, for actors and critics.
        gamma: discount a control step.
        follow: share of the distance to their networks that target networks move in each gradient step.
        clip: largest norm of the gradient of a layer's weights or biases.
        shrink: weight of the squared actions before the hyperbolic tangent in an actor's loss, which keeps
            them out of its flat ends.
    """

    batch: int = 1024
    learning_rate: float = 5e-4
    gamma: float = 0.95
    follow: float = 0.01
    clip: float = 0.5
    shrink: float = 1e-3


@dataclass(frozen=True)
class Transitions:
    """What happened in a control step, in the order of the actors.

    Attributes:
        seen: features before the step.
        actions: in [-1, 1], before the limits of robots and without regard to agents at rest.
        rewards: of the team, scaled.
        seen_next: features after the step.
    """

    seen: Float[Tensor, "b n f"]
    actions: Float[Tensor, "b n a"]
    rewards: Float[Tensor, "b"]
    seen_next: Float[Tensor, "b n f"]


class Learner:
    """Actors and critics of a team, with their targets and optimisers.

    Args:
        agents: how many.
        features: that each sees.
        actions: numbers that each decides on.
        config: hyper-parameters.
        rng: source of the first weights.
    """

    def __init__(
        self, agents: int, features: int, actions: int, config: MaddpgConfig, rng: torch.Generator
    ) -> None:
        self.config = config
        self.actors = Layers(agents, features, actions, rng)
        self.critics = Layers(agents, agents * (features + actions), 1, rng)
        both = self.actors, self.critics
        self._targets = [deepcopy(networks).requires_grad_(requires_grad=False) for networks in both]
        self._optimisers = [Adam(each.parameters(), lr=config.learning_rate, fused=True) for each in both]

    @torch.no_grad()
    def act(self, seen: Float[Tensor, "b n f"]) -> Float[Tensor, "b n a"]:
        """Return the action of all agents in [-1, 1]."""
        return self.actors(seen.transpose(0, 1)).tanh().transpose(0, 1)

    def update(self, batch: Transitions) -> None:
        """Take a gradient step with all critics, then one with all actors, and let the targets follow."""
        actors, critics = self._optimisers
        self._step(critics, self.critics, self.critic_loss(batch))
        # the critics only pass gradients on to the actions
        self.critics.requires_grad_(requires_grad=False)
        self._step(actors, self.actors, self.actor_loss(batch))
        self.critics.requires_grad_(requires_grad=True)
        with torch.no_grad():
            for target, networks in zip(self._targets, (self.actors, self.critics), strict=True):
                for old, new in zip(target.parameters(), networks.parameters(), strict=True):
                    old.lerp_(new, self.config.follow)

    def critic_loss(self, batch: Transitions) -> Tensor:
        """Return the critics' mean squared errors against y = r + gamma Q'(x', mu'(o')), summed.

        Episodes end because time is up, never because of what happened, so all go on in the targets.
        """
        target_actors, target_critics = self._targets
        with torch.no_grad():
            next_actions = target_actors(batch.seen_next.transpose(0, 1)).tanh().transpose(0, 1)
            worth = target_critics(batch.seen_next.flatten(1), next_actions.flatten(1))[..., 0]
            target = batch.rewards + self.config.gamma * worth
        guess = self.critics(batch.seen.flatten(1), batch.actions.flatten(1))[..., 0]
        return (guess - target).square().mean(1).sum()

    def actor_loss(self, batch: Transitions) -> Tensor:
        """Return minus what critic i thinks of actor i's own new action among the others' stored ones."""
        raw = self.actors(batch.seen.transpose(0, 1))
        own = torch.eye(len(raw), dtype=torch.bool)[:, None, :, None]
        mixed = torch.where(own, raw.tanh()[:, :, None], batch.actions)
        worth = self.critics(batch.seen.flatten(1), mixed.flatten(2))
        return (self.config.shrink * raw.square().mean((1, 2)) - worth.mean((1, 2))).sum()

    def _step(self, optimiser: torch.optim.Optimizer, networks: nn.Module, loss: Tensor) -> None:
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        for parameters in networks.parameters():
            assert parameters.grad is not None
            norm = parameters.grad.flatten(1).norm(dim=1)[:, None, None]
            parameters.grad *= self.config.clip / norm.clamp(min=self.config.clip)
        optimiser.step()


class Replay:
    """Rounds of episodes of equal length that ran side by side, scans and all, in half precision.

    The newest replace the oldest.

    Args:
        rounds: finished ones that it has room for.
        steps: control steps per episode.
        episodes: side by side.
        shape: of what the team sees in one control step: (agents, features).
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
        """Note what the team sees when a round begins."""
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
            actions: of all agents.
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
        # observations have one more row per round than transitions
        seen = chosen + place * episodes
        every = self._seen.flatten(0, 2)
        return Transitions(
            seen=every[seen].float(),
            actions=self._actions.flatten(0, 2)[chosen],
            rewards=self._rewards.flatten()[chosen],
            seen_next=every[seen + episodes].float(),
        )
