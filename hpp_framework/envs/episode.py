"""One episode of one team: the common core of the team environments, over any simulator.

The loop that drives one::

    episode = TeamEpisode(team, world, EpisodeConfig())
    episode.reset(seed)
    while not (episode.success or episode.truncated):
        reward = episode.step(commands)
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from hpp_framework.config.sensing_choice import make_estimators, parse_disturbances
from hpp_framework.config.task_file import make_task
from hpp_framework.core.schedule import make_schedule
from hpp_framework.core.task import Task
from hpp_framework.core.team import Team
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import Observation, State
from hpp_framework.core.world import World
from hpp_framework.envs.spaces import check_bounds, to_numbers
from hpp_framework.episodes.core import EpisodeBatch
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.builtin import DEFAULT_TASK, UNDISTURBED
from hpp_framework.sim import make_simulator
from hpp_framework.utils.errors import ConfigError, SimulatorError
from hpp_framework.utils.seeding import numpy_rng
from hpp_framework.utils.validation import Count, validated
from hpp_framework.viz.picture import Picture
from hpp_framework.worlds.loader import resolve_world
from hpp_framework.worlds.occupancy import free_space
from hpp_framework.worlds.spawn import spawn_poses

FloatArray = npt.NDArray[np.floating]


@validated
class EpisodeConfig:
    """What an episode is about, besides team and world.

    Attributes:
        task: registered task, with settings or without, a task file, or a task.
        disturbances: of sensing and acting: a profile, with settings or without, e.g. ``"field"``.
        estimator: registered estimator of all agents, with settings or without.
        backend: simulator, ``"batch"`` or ``"sapien"``.
        max_steps: control steps before truncation (100 are 20 s, as in the paper).
    """

    task: str | Task = DEFAULT_TASK
    disturbances: str = UNDISTURBED
    estimator: str = "none"
    backend: str = "batch"
    max_steps: Count = 100


class TeamEpisode:
    """Draws worlds and starts, steps a team, keeps what its agents sense, judges the task.

    Args:
        team: a team, or text such as ``"fetch,freight"``.
        world: a world, a registered world or a world file; a registered one is drawn afresh each episode.
        config: task, disturbances, estimator, backend, length.
    """

    world: World
    seed: int

    def __init__(self, team: Team | str, world: World | str, config: EpisodeConfig) -> None:
        self.team = parse_team(team) if isinstance(team, str) else team
        self.config = config
        robots = self.team.robots
        self.task = self._task_of(self.team)
        self._draw_world = resolve_world(world) if isinstance(world, str) else lambda _: world
        self.schedule = make_schedule(self.team, self._task_of)
        texts = [member.disturbances or config.disturbances for member in self.team.members]
        disturbances = [parse_disturbances(text) for text in texts]
        self._batch = EpisodeBatch(
            make_simulator(config.backend, robots),
            self.schedule,
            disturbances=disturbances,
            estimators=make_estimators(config.estimator, robots, disturbances),
        )
        self._picture = Picture(robots)
        self.started = False

    def reset(self, seed: int, poses: Any = None) -> None:
        """Start an episode that depends on the seed only.

        Args:
            seed: of the world, the starts and the disturbances.
            poses: starts (n, 3) instead of drawn ones; an array or nested lists.

        Raises:
            ConfigError: if the world has no room for the team, or given starts have the wrong shape.
        """
        self.seed = seed
        self.world = self._draw_world(numpy_rng(seed, "world"))
        check_bounds(self.world)
        if poses is None:
            poses = spawn_poses(self.world, self.team.robots, numpy_rng(seed, "starts"))
        elif to_numbers(poses).shape != (len(self.team), 3):
            raise ConfigError(f"start poses must be numbers of shape ({len(self.team)}, 3), got {poses!r}.")
        start = torch.as_tensor(np.asarray(poses, np.float32))[None]
        self._batch.begin([self.world], start, [seed])
        self.world = self._batch.worlds[0]
        self.started = True

    def step(self, commands: FloatArray) -> float:
        """Drive all robots for one control step and return the reward of the true poses.

        Args:
            commands: (n, 2) forward speed (m/s) and turn rate (rad/s); drive limits are applied.
        """
        self._batch.step(torch.as_tensor(np.asarray(commands, np.float32))[None])
        stage = self._batch.stage
        return float(stage.task.reward(self.state.poses[:, list(stage.present)])[0])

    def _task_of(self, team: Team) -> Task:
        task = self.config.task
        return make_task(task, team.robots, team.ids) if isinstance(task, str) else task

    @property
    def state(self) -> State:
        """True state, of a batch of one."""
        return self._batch.state

    @property
    def steps(self) -> int:
        """Control steps since the beginning."""
        return self._batch.steps

    @property
    def success(self) -> bool:
        """Whether the task has been fulfilled for its ``sustain_steps`` consecutive steps."""
        return bool(self._batch.done_step[0] >= 0)

    @property
    def truncated(self) -> bool:
        """Whether time ran out without success."""
        return self.steps >= self.config.max_steps and not self.success

    @property
    def success_now(self) -> bool:
        """Whether the true poses of those who take part alone fulfil the task now."""
        stage = self._batch.stage
        return bool(stage.task.success(self.state.poses[:, list(stage.present)])[0])

    @property
    def poses(self) -> npt.NDArray[np.float32]:
        """True poses (n, 3)."""
        return self.state.poses[0].cpu().numpy().copy()

    @property
    def collided(self) -> npt.NDArray[np.bool_]:
        """Which robots (n,) touched anything during the last step."""
        return self.state.collided[0].cpu().numpy().copy()

    def observe(self, agent: int) -> Observation:
        """Return what one agent knows."""
        return self._batch.observe(agent)

    def draw_goal(self) -> tuple[float, float]:
        """Draw a point that every robot of the team can reach; depends on the episode's seed only."""
        space = free_space(self.world, body_height=max(robot.height for robot in self.team.robots))
        clearance = max(robot.footprint_radius for robot in self.team.robots) + self.world.spawn.clearance
        regions = space.regions(clearance)
        label = int(space.look_up(regions, self.poses[:1, :2])[0])
        mask = regions == label if label > 0 else space.largest_region(clearance)
        if not mask.any():
            raise ConfigError(
                f"world '{self.world.name}': no robot of the team fits anywhere; remove obstacles."
            )
        x, y = space.sample(mask, 1, numpy_rng(self.seed, "goal"))[0]
        return float(x), float(y)

    def draw(self, goals: FloatArray) -> npt.NDArray[np.uint8]:
        """Return a top-down picture (height, width, 3) with lidars, goals (n, 2) and the clock.

        Raises:
            SimulatorError: before the first reset.
        """
        if not self.started:
            raise SimulatorError("there is nothing to draw yet; call reset() first.")
        scans = [self.observe(i).scan[0].cpu().numpy() for i in range(len(self.team))]
        moving = self.state.people
        return self._picture.draw(
            self.world, self.poses, goals, scans=scans, clock=self.steps * CONTROL_PERIOD,
            people=None if moving is None else moving.poses[0].cpu().numpy(),
        )  # fmt: skip

    def close(self) -> None:
        """Free the simulator; safe to call twice."""
        self._batch.simulator.close()
