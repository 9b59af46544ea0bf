"""Training episodes of MADDPG: teams act with noise in random rooms, and the learner is updated."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.agents.policy import one_second_ahead
from hpp_framework.config.control_choice import make_control
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.task import Task
from hpp_framework.episodes.core import EpisodeBatch
from hpp_framework.evaluation.rollout import EPISODE_STEPS
from hpp_framework.planning.baselines.maddpg import feature_count, features, roles, to_command
from hpp_framework.plugins.builtin import DEFAULT_WORLD
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.training.maddpg.learner import Learner, MaddpgConfig, Replay
from hpp_framework.utils.seeding import numpy_rng, torch_rng
from hpp_framework.worlds.pool import build_pool, draw_starts

ACTIONS = 2
"""Numbers that an agent decides on: [v, omega]."""
STREAM = "practice"
"""Name of the random stream; weights are repeatable only under this name."""


@dataclass(frozen=True, kw_only=True)
class Rooms:
    """What the rooms are like.

    Attributes:
        world: registered world, or a world file.
        count: different worlds.
        episodes: side by side.
        steps: control steps per episode.
        start_distance: nearest and farthest neighbour at the start, in metres.
        control: control stack of the robots, as they have it when they are judged.
    """

    world: str = DEFAULT_WORLD
    count: int = 500
    episodes: int = 100
    steps: int = EPISODE_STEPS
    start_distance: tuple[float, float] = (1.5, 8.0)
    control: str = "stop-on-success:beyond=0"


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """How a policy is made.

    Attributes:
        learner: hyper-parameters of the gradient steps.
        rooms: the training worlds.
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


class TrainingEpisodes:
    """Teams that train side by side.

    Args:
        robots: the team, in team order; everything else here is in the order of the actors.
        task: gives the reward.
        rooms: what the rooms are like.
        seed: of worlds and starts.
    """

    def __init__(self, robots: Sequence[RobotSpec], task: Task, rooms: Rooms, seed: int) -> None:
        self.robots = [robots[index] for index in roles(robots)]
        self.task = task
        self.rooms = rooms
        self._rng = numpy_rng(seed, STREAM)
        self._control = [
            make_control(rooms.control, self.robots, index, task) for index in range(len(self.robots))
        ]
        self._pool = build_pool(rooms.world, rooms.count, self.robots, seed=seed)
        self._simulator = BatchSimulator(self.robots, threads=1)
        self._simulator.load(self._pool.worlds, episodes=rooms.episodes)
        self._batch = EpisodeBatch(self._simulator, shared=True)

    def begin(self) -> Float[Tensor, "e n f"]:
        """Begin new episodes in worlds drawn anew; returns what the team sees."""
        world = self._rng.integers(len(self._pool), size=self.rooms.episodes)
        starts = draw_starts(self._pool, world, len(self.robots), self.rooms.start_distance, self._rng)
        whole_team = torch.ones(starts.shape[:2], dtype=torch.bool)
        index = torch.from_numpy(world.astype(np.int32))
        self._batch.start(self._simulator.place(index, whole_team, starts), range(len(starts)))
        return self._look()

    def step(self, actions: Float[Tensor, "e n 2"]) -> tuple[Float[Tensor, "e n f"], Float[Tensor, "e"]]:
        """Drive for a control step; returns what the team sees then, and the reward of the true poses.

        Args:
            actions: in [-1, 1].
        """
        commands = [self._command(action, index) for index, action in enumerate(actions.unbind(1))]
        state = self._batch.step(torch.stack(commands, 1))
        return self._look(), self.task.reward(state.poses)

    def _command(self, action: Float[Tensor, "e 2"], index: int) -> Float[Tensor, "e 2"]:
        """Return what becomes of an agent's action."""
        seen = self._batch.observe(index)
        command = to_command(action, self.robots[index])
        return self._control[index].filter(seen, one_second_ahead(seen, command), command)

    def _look(self) -> Float[Tensor, "e n f"]:
        team = range(len(self.robots))
        others = [[other for other in team if other != index] for index in team]
        seen = [features(self._batch.observe(i), robot, others[i]) for i, robot in enumerate(self.robots)]
        return torch.stack(seen, 1)


def exploration(shape: tuple[int, ...], std: float, decay: float, rng: torch.Generator) -> Iterator[Tensor]:
    """Yield Ornstein-Uhlenbeck noise, which lasts long enough for a robot to get moving.

    Args:
        shape: of the noise of a control step.
        std: standard deviation.
        decay: share that is lost in a control step.
        rng: its source.
    """
    now, keep = std * torch.randn(shape, generator=rng), 1 - decay
    while True:
        now = keep * now + std * (1 - keep**2) ** 0.5 * torch.randn(shape, generator=rng)
        yield now


def train(
    learner: Learner, robots: tuple[RobotSpec, ...], task: Task, recipe: Recipe, *, steps: int, seed: int
) -> Iterator[tuple[int, float]]:
    """Train a learner.

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
    rooms, rng = recipe.rooms, torch_rng(seed, STREAM)
    episodes = TrainingEpisodes(robots, task, rooms, seed)
    shape = rooms.episodes, len(robots), ACTIONS
    a_round = rooms.steps * rooms.episodes
    capacity = max(1, min(recipe.memory, steps) // a_round)
    replay = Replay(capacity, rooms.steps, rooms.episodes, (len(robots), feature_count(robots)), ACTIONS)
    due = 0.0
    for done in range(a_round, steps + a_round, a_round):
        seen = episodes.begin()
        replay.begin(seen)
        total = 0.0
        noise = exploration(shape, recipe.noise, recipe.noise_decay, rng)
        for step, disturbance in zip(range(rooms.steps), noise, strict=False):
            actions = (learner.act(seen) + disturbance).clamp(-1, 1)
            seen, rewards = episodes.step(actions)
            replay.add(step, actions, rewards * recipe.reward_scale, seen)
            total += float(rewards.mean())
            due += rooms.episodes / recipe.update_every if len(replay) >= recipe.warm_up else 0
            while due >= 1:
                learner.update(replay.sample(recipe.learner.batch, rng))
                due -= 1
        yield done, total
