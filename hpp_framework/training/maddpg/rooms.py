"""Where MADDPG practises: teams side by side in random rooms, all episodes of the same length."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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
from hpp_framework.planning.baselines.maddpg import features, roles, to_command
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.seeding import numpy_rng
from hpp_framework.worlds.pool import build_pool, draw_starts


@dataclass(frozen=True, kw_only=True)
class Rooms:
    """What the rooms are like.

    Attributes:
        world: registered world, or a world file.
        count: different worlds.
        episodes: side by side.
        steps: control steps an episode.
        start_distance: nearest and farthest neighbour at the start, in metres.
        control: control stack of the robots, as they have it when they are judged.
    """

    world: str = "training"
    count: int = 500
    episodes: int = 100
    steps: int = EPISODE_STEPS
    start_distance: tuple[float, float] = (1.5, 8.0)
    control: str = "stop-on-success:beyond=0"


class Practice:
    """Teams that practise side by side.

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
        self._rng = numpy_rng(seed, "practice")
        self._control = [
            make_control(rooms.control, self.robots, index, task) for index in range(len(self.robots))
        ]
        self._pool = build_pool(rooms.world, rooms.count, self.robots, seed=seed)
        self._simulator = BatchSimulator(self.robots, threads=1)
        self._simulator.load(self._pool.worlds, episodes=rooms.episodes)
        self._batch = EpisodeBatch(self._simulator, shared=True)

    def begin(self) -> Float[Tensor, "e n f"]:
        """Begin new episodes in worlds drawn anew; returns what everybody sees."""
        world = self._rng.integers(len(self._pool), size=self.rooms.episodes)
        starts = draw_starts(self._pool, world, len(self.robots), self.rooms.start_distance, self._rng)
        everyone = torch.ones(starts.shape[:2], dtype=torch.bool)
        index = torch.from_numpy(world.astype(np.int32))
        self._batch.start(self._simulator.place(index, everyone, starts), range(len(starts)))
        return self._look()

    def step(self, actions: Float[Tensor, "e n 2"]) -> tuple[Float[Tensor, "e n f"], Float[Tensor, "e"]]:
        """Drive for a control step; returns what everybody sees then, and the reward of the true poses.

        Args:
            actions: in [-1, 1].
        """
        commands = [self._command(actions[:, i], i) for i in range(len(self.robots))]
        state = self._batch.step(torch.stack(commands, 1))
        return self._look(), self.task.reward(state.poses)

    def _command(self, action: Float[Tensor, "e 2"], index: int) -> Float[Tensor, "e 2"]:
        """Return what becomes of an agent's action."""
        seen = self._batch.observe(index)
        command = to_command(action, self.robots[index])
        return self._control[index].filter(seen, one_second_ahead(seen, command), command)

    def _look(self) -> Float[Tensor, "e n f"]:
        count = range(len(self.robots))
        seen = [
            features(self._batch.observe(i), robot, [other for other in count if other != i])
            for i, robot in enumerate(self.robots)
        ]
        return torch.stack(seen, 1)
