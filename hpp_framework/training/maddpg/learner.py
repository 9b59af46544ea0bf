"""The gradient steps of MADDPG (Lowe et al. 2017, algorithm 1): one actor and one critic an agent.

A critic sees what all agents see and do, an actor only what its own agent sees. All networks of a kind are
stacked and work side by side.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from hpp_framework.planning.baselines.maddpg import Layers


@dataclass(frozen=True, kw_only=True)
class MaddpgConfig:
    """Hyper-parameters; the paper names batch and rate only, the others are those of Lowe et al.

    Attributes:
        batch: transitions a gradient step.
        learning_rate: of Adam, for actors and critics.
        gamma: discount a control step.
        follow: share of the way that target networks move towards their networks in each gradient step.
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
        self._target_actors = deepcopy(self.actors).requires_grad_(requires_grad=False)
        self._target_critics = deepcopy(self.critics).requires_grad_(requires_grad=False)
        self._optimisers = [
            torch.optim.Adam(networks.parameters(), lr=config.learning_rate, fused=True)
            for networks in (self.actors, self.critics)
        ]

    @torch.no_grad()
    def act(self, seen: Float[Tensor, "b n f"]) -> Float[Tensor, "b n a"]:
        """Return everybody's action in [-1, 1]."""
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
            self._follow(self._target_actors, self.actors)
            self._follow(self._target_critics, self.critics)

    def _follow(self, targets: nn.Module, networks: nn.Module) -> None:
        for target, parameters in zip(targets.parameters(), networks.parameters(), strict=True):
            target.lerp_(parameters, self.config.follow)

    def critic_loss(self, batch: Transitions) -> Tensor:
        """Return the critics' mean squared errors against y = r + gamma Q'(x', mu'(o')), summed.

        Episodes end because time is up, never because of what happened, so all go on in the targets.
        """
        with torch.no_grad():
            next_actions = self._target_actors(batch.seen_next.transpose(0, 1)).tanh().transpose(0, 1)
            worth = self._target_critics(batch.seen_next.flatten(1), next_actions.flatten(1))[..., 0]
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
