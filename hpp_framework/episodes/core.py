"""A batch of episodes of one team: the core of evaluation, collection, environments and training.

The loop that drives one::

    episodes = EpisodeBatch(simulator, robots=2)
    episodes.begin(worlds, starts, seeds)
    while episodes.running.any():
        commands = [agent.act(episodes.observe(i)) for i, agent in enumerate(agents)]
        episodes.step(torch.stack(commands, 1))

Seeds and disturbances belong to the episode: it runs the same, bit for bit, alone and in any batch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.core.disturbances import IDEAL, Disturbances
from hpp_framework.core.estimator import Estimator
from hpp_framework.core.schedule import Stage
from hpp_framework.core.types import Observation, Privileged, State
from hpp_framework.core.world import World
from hpp_framework.episodes.links import CommandLinks
from hpp_framework.perception.sensing import HISTORY, KEYFRAMES, Sensing
from hpp_framework.sim.simulator import Simulator
from hpp_framework.utils.seeding import EpisodeRng, child_seed, numpy_rng
from hpp_framework.worlds.people import populate


class EpisodeBatch:
    """Steps a team in its worlds, keeps what its agents sense, and judges its task by the true state.

    Args:
        simulator: of the team.
        schedule: who takes part when, with the task of those who do; empty where nothing is judged.
        disturbances: of sensing and acting, the same for all or one for each robot.
        estimators: one for each agent; None takes what was sensed last as it is.
        history: entries that observations hold; fewer cost less.
        keyframes: that observations hold, one per second; 0 for none.
        shared: whether states may be the simulator's own memory, which the next step overwrites.

    Attributes:
        state: of the simulator, after the last step.
        worlds: one per episode.
        steps: control steps since the beginning.
        done_step: step at which success had been sustained long enough, -1 before.
        contact_step: first step at which the poses alone fulfilled the task, -1 before.
        sustained: consecutive steps for which success has held.
        touched_obstacle: whether any robot touched an obstacle before the episode was done.
        touched_robot: whether any two robots touched each other before the episode was done.
        touched_person: whether any robot drove into a person before the episode was done.
    """

    state: State

    def __init__(
        self,
        simulator: Simulator,
        schedule: Sequence[Stage] = (),
        *,
        disturbances: Disturbances | Sequence[Disturbances] = IDEAL,
        estimators: Sequence[Estimator] | None = None,
        history: int = HISTORY,
        keyframes: int = KEYFRAMES,
        shared: bool = False,
    ) -> None:
        self.simulator = simulator
        self._advance = simulator.advance if shared else simulator.step
        self.schedule = tuple(schedule)
        self.sensing = Sensing(
            simulator.robots, disturbances, estimators, history=history, keyframes=keyframes
        )
        self._links = CommandLinks(self.sensing.disturbances)
        self.worlds: Sequence[World] = ()

    def begin(self, worlds: Sequence[World], starts: Float[Tensor, "b n 3"], seeds: Sequence[int]) -> None:
        """Begin episodes, robots at rest; what worlds leave open about their people is settled by the seeds.

        Args:
            worlds: one per episode.
            starts: poses in them.
            seeds: of the disturbances, one per episode.
        """
        settled = [
            populate(world, self.simulator.robots, start, numpy_rng(seed, "people"))
            for world, start, seed in zip(worlds, starts.numpy(), seeds, strict=True)
        ]
        self.start(self.simulator.reset(settled, starts), seeds, settled)

    def start(self, state: State, seeds: Sequence[int], worlds: Sequence[World] = ()) -> None:
        """Begin episodes in a state that the caller has brought the simulator into.

        Args:
            state: of the simulator.
            seeds: of the disturbances, one per episode.
            worlds: one per episode, where oracles look on.
        """
        self.worlds = worlds
        self.state = state
        self.sensing.reset(state, EpisodeRng([child_seed(seed, "sensing") for seed in seeds]))
        self._links.reset(EpisodeRng([child_seed(seed, "acting") for seed in seeds]))
        count = len(state.poses)
        self._left = list(self.schedule)
        self._stage = self._left.pop(0) if self._left else None
        self.steps = 0
        self.done_step = torch.full((count,), -1)
        self.contact_step = torch.full((count,), -1)
        self.sustained = torch.zeros(count, dtype=torch.int64)
        self.touched_obstacle = torch.zeros(count, dtype=torch.bool)
        self.touched_robot = torch.zeros(count, dtype=torch.bool)
        self.touched_person = torch.zeros(count, dtype=torch.bool)

    @property
    def running(self) -> Bool[Tensor, "b"]:
        """Which episodes have not succeeded yet."""
        return self.done_step < 0

    @property
    def stage(self) -> Stage:
        """Who takes part now."""
        assert self._stage is not None, "nothing is judged here"
        return self._stage

    def observe(self, agent: int) -> Observation:
        """Return what one agent knows."""
        return self.sensing.observe(agent)

    def observe_all(self) -> list[Observation]:
        """Return what each agent knows, and beside it what only an oracle may read."""
        own = [self.sensing.observe(agent) for agent in range(len(self.simulator.robots))]
        privileged = Privileged(self.worlds, self.state, own, self.running)
        return [replace(observation, privileged=privileged) for observation in own]

    def step(self, commands: Float[Tensor, "b n 2"]) -> State:
        """Drive for one control period, measure, and judge what it led to.

        Args:
            commands: [v in m/s, omega in rad/s] of each robot; drive limits are applied.
        """
        self.state = self._advance(self._links.delivered(commands))
        self.sensing.update(self.state, commands)
        self.steps += 1
        if self._stage is not None:
            self._judge()
        return self.state

    def restart(self, state: State, robots: Bool[Tensor, "b n"]) -> None:
        """Go on after some of the robots have been put elsewhere.

        Args:
            state: of the simulator, after that.
            robots: which.
        """
        self.state = state
        self.sensing.restart(state, robots)
        self._links.restart(robots)

    def _judge(self) -> None:
        while self._left and self._left[0].begun(self.steps - 1):
            self._stage = self._left.pop(0)
            self.sustained.zero_()
        stage, running = self.stage, self.running
        self.touched_obstacle |= self.state.touched_obstacle.any(1).cpu() & running
        self.touched_robot |= self.state.touched_robot.any(1).cpu() & running
        if self.state.touched_person is not None:
            self.touched_person |= self.state.touched_person.any(1).cpu() & running
        if not stage.complete:
            return
        present = list(stage.present)
        poses, velocities = self.state.poses[:, present], self.state.velocities[:, present]
        contact = stage.task.success(poses).cpu() & (self.contact_step < 0) & running
        self.contact_step[contact] = self.steps
        done = stage.task.success(poses, velocities).cpu()
        self.sustained = torch.where(done, self.sustained + 1, 0)
        self.done_step[running & (self.sustained >= stage.task.sustain_steps)] = self.steps
