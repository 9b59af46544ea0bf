"""How MADDPG practises: act with noise, remember, learn a little, from round to round."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import torch
from torch import Tensor

from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.task import Task
from hpp_framework.planning.baselines.maddpg import feature_count
from hpp_framework.training.maddpg.learner import Learner, MaddpgConfig
from hpp_framework.training.maddpg.replay import Replay
from hpp_framework.training.maddpg.rooms import Practice, Rooms
from hpp_framework.utils.seeding import torch_rng

ACTIONS = 2
"""Numbers that an agent decides on: [v, omega]."""


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """How a policy is made.

    Attributes:
        learner: hyper-parameters of the gradient steps.
        rooms: where is practised.
        update_every: control steps between two gradient steps, as in the code of Lowe et al.
        memory: control steps remembered.
        warm_up: control steps before the first gradient step.
        reward_scale: factor of the rewards that critics learn.
        noise: standard deviation of the Ornstein-Uhlenbeck noise on actions in [-1, 1].
        noise_decay: share of the noise that is lost in a control step.
        judged: episodes without noise that a policy is judged by, at each point of the learning curve.
    """

    learner: MaddpgConfig = field(default_factory=MaddpgConfig)
    rooms: Rooms = field(default_factory=Rooms)
    update_every: int = 100
    memory: int = 1_000_000
    warm_up: int = 25_000
    reward_scale: float = 0.1
    noise: float = 0.3
    noise_decay: float = 0.15
    judged: int = 100


class Noise:
    """Ornstein-Uhlenbeck noise: exploration that lasts long enough for a robot to get moving.

    Args:
        std: standard deviation.
        decay: share that is lost in a control step.
        rng: its source.
    """

    def __init__(self, std: float, decay: float, rng: torch.Generator) -> None:
        self.std, self.keep, self.rng = std, 1 - decay, rng
        self._now: Tensor = torch.zeros(())

    def begin(self, *shape: int) -> None:
        """Draw afresh, for new episodes."""
        self._now = self.std * torch.randn(shape, generator=self.rng)

    def next(self) -> Tensor:
        """Return the noise of a control step."""
        fresh = torch.randn(self._now.shape, generator=self.rng)
        self._now = self.keep * self._now + self.std * (1 - self.keep**2) ** 0.5 * fresh
        return self._now


def practise(
    learner: Learner, robots: tuple[RobotSpec, ...], task: Task, recipe: Recipe, *, steps: int, seed: int
) -> Iterator[tuple[int, float]]:
    """Let a learner practise.

    Args:
        learner: of as many agents as there are robots.
        robots: the team.
        task: gives the reward.
        recipe: how.
        steps: control steps of teams, rounded up to whole rounds of episodes.
        seed: of worlds, starts, noise and batches.

    Yields:
        After each round: control steps done, and the mean return of its episodes, noise and all.
    """
    rooms, rng = recipe.rooms, torch_rng(seed, "practice")
    practice = Practice(robots, task, rooms, seed)
    a_round = rooms.steps * rooms.episodes
    capacity = max(1, min(recipe.memory, steps) // a_round)
    replay = Replay(capacity, rooms.steps, rooms.episodes, (len(robots), feature_count(robots)), ACTIONS)
    noise = Noise(recipe.noise, recipe.noise_decay, rng)
    due = 0.0
    for done in range(a_round, steps + a_round, a_round):
        seen = practice.begin()
        replay.begin(seen)
        noise.begin(len(seen), len(robots), ACTIONS)
        total = 0.0
        for step in range(rooms.steps):
            actions = (learner.act(seen) + noise.next()).clamp(-1, 1)
            seen, rewards = practice.step(actions)
            replay.add(step, actions, rewards * recipe.reward_scale, seen)
            total += float(rewards.mean())
            due += rooms.episodes / recipe.update_every if len(replay) >= recipe.warm_up else 0
            while due >= 1:
                learner.update(replay.sample(recipe.learner.batch, rng))
                due -= 1
        yield done, total
