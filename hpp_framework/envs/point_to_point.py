"""Point-to-point navigation as a ``gymnasium.vector.VectorEnv`` over the batch simulator.

One sub-environment is one robot with its own goal. With ``robots_per_world`` above one, several
sub-environments share a world and are moving obstacles to each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt
import torch
from gymnasium.vector import AutoresetMode
from torch import Tensor

from hpp_framework.core import geometry
from hpp_framework.core.disturbances import IDEAL, Disturbances
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import State
from hpp_framework.core.world import World
from hpp_framework.envs.navigation_tasks import NavigationTasks
from hpp_framework.envs.problem import DomainRandomisation, PointToPoint
from hpp_framework.envs.spaces import (
    MAX_GOAL_DISTANCE,
    command_space,
    from_unit,
    goal_space,
    scan_space,
    unit_space,
)
from hpp_framework.episodes.core import EpisodeBatch
from hpp_framework.plugins.builtin import DEFAULT_ROBOT, DEFAULT_WORLD
from hpp_framework.plugins.registry import hub
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.errors import ConfigError, SimulatorError
from hpp_framework.utils.seeding import child_seed, torch_rng
from hpp_framework.worlds.pool import WorldPool, build_pool

START_GAP = 0.3
"""Smallest gap between two footprints at the start, in metres."""
PRIVILEGED = 5
"""Size of the observation ``privileged`` of a training."""


def observation_space(robot: RobotSpec, *, privileged: bool = False) -> gym.Space[Any]:
    """Return the space of one robot: scan (m), goal (distance m, bearing rad), velocity (m/s, rad/s).

    Args:
        robot: the robot.
        privileged: whether there is an entry ``privileged`` (see :class:`DomainRandomisation`).
    """
    parts: dict[str, gym.Space[Any]] = {
        "scan": scan_space(robot), "goal": goal_space(), "velocity": command_space(robot)
    }  # fmt: skip
    if privileged:
        parts["privileged"] = gym.spaces.Box(-np.inf, np.inf, (PRIVILEGED,), np.float32)
    return gym.spaces.Dict(parts)


class PointToPointVectorEnv(gym.vector.VectorEnv[dict[str, Any], Any, Any]):
    """Many robots, each on its way to its own goal; autoresets in the same step.

    Args:
        num_envs: number of robots.
        robot: registered robot or its data.
        world: registered world or world file that the pool is drawn from.
        pool_size: number of different worlds.
        robots_per_world: robots that share a world.
        problem: arrival and rewards.
        disturbances: of sensing and acting.
        seed: of the pool of worlds.
        device: torch device.
        pool: worlds drawn already, instead of ``world``, ``pool_size`` and ``seed``.
        unit_actions: whether actions lie in [-1, 1] and are scaled to the drive limits, or are m/s and rad/s.
        autoreset: whether a robot whose episode ended begins the next in the same step (Gymnasium's
            ``SAME_STEP``); else all robots wait for :meth:`reset`.
        randomisation: of training, instead of ``disturbances``, or None.
    """

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": []}  # noqa: RUF012  # Gymnasium's own form

    def __init__(
        self,
        num_envs: int = 1,
        *,
        robot: str | RobotSpec = DEFAULT_ROBOT,
        world: str = DEFAULT_WORLD,
        pool_size: int = 64,
        robots_per_world: int = 1,
        problem: PointToPoint | None = None,
        disturbances: Disturbances = IDEAL,
        seed: int = 0,
        device: str = "cpu",
        pool: WorldPool | None = None,
        unit_actions: bool = False,
        autoreset: bool = True,
        randomisation: DomainRandomisation | None = None,
    ) -> None:
        if robots_per_world < 1 or num_envs < 1 or num_envs % robots_per_world:
            raise ConfigError(
                f"num_envs ({num_envs}) must be a positive multiple of robots_per_world ({robots_per_world})."
            )
        if pool is None and pool_size < 1:
            raise ConfigError(f"pool_size must be at least 1, got {pool_size}.")
        if not autoreset:
            self.metadata = {**self.metadata, "autoreset_mode": AutoresetMode.DISABLED}
        self.autoreset = autoreset
        self.unit_actions = unit_actions
        self.started = False
        self.robot = hub().robots.create(robot) if isinstance(robot, str) else robot
        self.problem = problem or PointToPoint()
        self.randomisation = randomisation
        self.disturbances = randomisation.disturbances if randomisation else disturbances
        self.num_envs = num_envs
        self.worlds_count = num_envs // robots_per_world
        self.robots_per_world = robots_per_world
        self.pool = pool or build_pool(world, pool_size, [self.robot], seed=seed)
        shape = (self.worlds_count, robots_per_world)
        gap = 2 * self.robot.footprint_radius + START_GAP
        detours = randomisation.detours if randomisation else 0.0
        self.tasks = NavigationTasks(self.pool, shape, self.problem.goal_distance, gap, detours)
        self.simulator = BatchSimulator([self.robot] * robots_per_world, device=device)
        self.simulator.load(self.pool.worlds, episodes=self.worlds_count)
        # skills see the present only
        self._batch = EpisodeBatch(self.simulator, disturbances=self.disturbances, history=1, keyframes=0)
        self.single_observation_space = observation_space(self.robot, privileged=randomisation is not None)
        self.single_action_space = unit_space() if unit_actions else command_space(self.robot)
        self.observation_space = gym.vector.utils.batch_space(self.single_observation_space, num_envs)
        self.action_space = gym.vector.utils.batch_space(self.single_action_space, num_envs)
        self._seed(seed)

    def _seed(self, seed: int) -> None:
        self.rng = torch_rng(seed, "point-to-point")
        self._seeds = [child_seed(seed, row) for row in range(self.worlds_count)]
        self._reseeded = True

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Start every robot anew.

        Args:
            seed: makes all that follows repeatable; a list of seeds counts as one seed for all robots.
            options: ``"reset_mask"``, booleans (num_envs,): start only these robots, and those who share a
                world with the first robot of their world if that one starts; others are ignored.

        Raises:
            ConfigError: if the mask has the wrong shape or type, or comes before the first reset.
        """
        mask = (options or {}).get("reset_mask")
        if mask is not None and seed is None:
            return self._reset_some(mask)
        if isinstance(seed, Sequence):
            self._seed(child_seed(0, *map(str, seed)))
        elif seed is not None:
            self._seed(int(seed))
        self.started = True
        shape = (self.worlds_count, self.robots_per_world)
        self._touching = torch.zeros(shape, dtype=torch.bool)
        self._late = torch.zeros(shape[0], dtype=torch.bool)
        self._drive = torch.ones(shape[0])
        self._last_commands = torch.zeros(*shape, 2)
        self._dwelt = torch.zeros(shape, dtype=torch.int64)
        self._age = torch.zeros(shape, dtype=torch.int64)
        state = self._restart(torch.ones(shape, dtype=torch.bool), torch.full((*shape, 3), 1e6))
        if self._reseeded:
            self._batch.start(state, self._seeds)
        else:
            # unseeded, disturbances go on from where it is
            self._batch.sensing.reset(state, self._batch.sensing.sensors.rng)
        self._reseeded = False
        self._left = self.tasks.left(state.poses.cpu())
        return self._observe(), {}

    def _reset_some(self, mask: object) -> tuple[dict[str, Any], dict[str, Any]]:
        given = np.asarray(mask)
        if not self.started or given.shape != (self.num_envs,) or given.dtype != np.bool_:
            raise ConfigError(
                f"reset_mask must be {self.num_envs} booleans, one per robot, after a first reset without "
                f"it; got {given.dtype} of shape {given.shape}."
            )
        chosen = torch.from_numpy(given).reshape(self.worlds_count, self.robots_per_world)
        self._begin(chosen | chosen[:, :1], self.simulator.state())
        return self._observe(), {}

    def step(
        self, actions: npt.NDArray[Any]
    ) -> tuple[dict[str, Any], npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any], dict[str, Any]]:
        """Drive all robots for one control period.

        Args:
            actions: (num_envs, 2), in -1..1 or m/s and rad/s.

        Returns:
            Observations, rewards, which robots arrived (or failed, under randomisation), which ran out of
            time, and info: ``touched``, and if an episode ended ``final_obs`` (an array of one observation
            per robot, None where its episode goes on) and ``final_info``.

        Raises:
            SimulatorError: before the first reset, or if actions are not finite or have the wrong shape.
        """
        state = self._batch.step(self._disturbed(self._commands(actions)))
        reward, success, failed = self._score(state)
        terminated = success | failed
        truncated = (self._age >= self.problem.max_steps) & ~terminated
        ended = terminated | truncated
        # a world is redrawn when its first robot ends, which cuts the others short
        truncated |= ended[:, :1] & ~terminated
        ended |= truncated
        info: dict[str, Any] = {"touched": state.collided.reshape(-1).cpu().numpy()}
        if self.autoreset and bool(ended.any()):
            info.update(self._final(ended, success))
            self._begin(ended, state)
        reward_np, terminated_np, truncated_np = (
            flag.reshape(-1).cpu().numpy() for flag in (reward, terminated, truncated)
        )
        return self._observe(), reward_np, terminated_np, truncated_np, info

    def scene(self, index: int) -> tuple[World, npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        """Return the world of one robot, and true poses (m, 3) and goals (m, 2) of all who share it."""
        row = index // self.robots_per_world
        world = self.pool.worlds[int(self.tasks.world_index[row])]
        return world, self.simulator.state().poses[row].cpu().numpy(), self.tasks.goals[row].numpy().copy()

    def _commands(self, actions: npt.NDArray[Any]) -> Tensor:
        if not self.started:
            raise SimulatorError("no episode is running; call reset() first.")
        given = np.asarray(actions, np.float32)
        if given.shape != (self.num_envs, 2):
            raise SimulatorError(
                f"actions must have shape ({self.num_envs}, 2) (robots, [v, omega]), got {given.shape}."
            )
        if self.unit_actions:
            given = from_unit(given, command_space(self.robot))
        return torch.as_tensor(given).reshape(self.worlds_count, self.robots_per_world, 2)

    def _disturbed(self, commands: Tensor) -> Tensor:
        """Return what the drives make of commands."""
        if not self.randomisation:
            return commands
        given = commands
        commands = torch.where(self._late[:, None, None], self._last_commands, commands)
        self._last_commands = given
        drive, share = self.robot.drive, self._drive[:, None, None]
        top = torch.tensor([drive.speed[1], drive.turn_rate]) * share
        change = torch.tensor([drive.acceleration, drive.turn_acceleration]) * share * CONTROL_PERIOD
        now = self._velocities
        return commands.minimum(top).maximum(-top).maximum(now - change).minimum(now + change)

    def _final(self, ended: Tensor, success: Tensor) -> dict[str, Any]:
        """Return what is known of episodes that just ended, in the form Gymnasium's vector wrappers read."""
        observation, over = self._observe(), ended.reshape(-1).numpy()
        final = np.full(self.num_envs, None, dtype=object)
        for index in np.flatnonzero(over):
            final[index] = {name: part[index].copy() for name, part in observation.items()}
        steps = self._age.reshape(-1).numpy().copy()
        return {
            "final_obs": final,
            "final_info": {"success": success.reshape(-1).numpy().copy(), "steps": steps},
            "_final_obs": over.copy(),
            "_final_info": over.copy(),
        }

    def _begin(self, chosen: Tensor, state: State) -> None:
        """Begin new episodes of the chosen robots (worlds, robots)."""
        fresh = self._restart(chosen, state.poses.cpu())
        self._batch.restart(fresh, chosen)
        self._left = self.tasks.left(fresh.poses.cpu())

    def _score(self, state: State) -> tuple[Tensor, Tensor, Tensor]:
        p = self.problem
        self._age += 1
        poses, touching = state.poses.cpu(), state.collided.cpu()
        speed, turn_rate = state.velocities.cpu().abs().unbind(-1)
        left = self.tasks.left(poses)
        at_rest = (self.tasks.straight(poses) < p.goal_radius) & (speed < p.rest_speed)
        self._dwelt = torch.where(at_rest, self._dwelt + 1, 0)
        success = self._dwelt >= p.dwell
        collided = touching & ~self._touching
        failed = torch.zeros_like(collided)
        if self.randomisation:
            ends = torch.rand(collided.shape, generator=self.rng) < self.randomisation.end_on_touch
            failed = collided & ends & ~success
        reward = (
            p.progress * (self._left - left)
            + p.arrival * success
            + p.linger * at_rest
            + p.collision * collided
            + p.touch * touching
            + p.step
            + p.turn * turn_rate
        )
        self._left, self._touching = left, touching
        self._poses, self._velocities = poses, state.velocities.cpu()
        return reward, success, failed

    def _restart(self, chosen: Tensor, poses: Tensor) -> State:
        """Give the chosen robots a new start and goal; a world is redrawn where robot 0 is chosen."""
        poses = self.tasks.draw(chosen, poses, self.rng)
        self._age[chosen] = 0
        self._dwelt[chosen] = 0
        self._touching = self._touching & ~chosen
        self._last_commands[chosen] = 0.0
        if self.randomisation:
            self._draw_disturbances(self.randomisation, chosen[:, 0])
        state = self.simulator.place(self.tasks.world_index.to(torch.int32), chosen, poses)
        self._poses, self._velocities = state.poses.cpu(), state.velocities.cpu()
        return state

    def _draw_disturbances(self, randomisation: DomainRandomisation, worlds: Tensor) -> None:
        strength, late, drive = torch.rand(3, len(worlds), generator=self.rng)
        sensors = self._batch.sensing.sensors
        before = strength if sensors.intensity is None else sensors.intensity
        sensors.intensity = torch.where(worlds, strength, before)
        self._late = torch.where(worlds, late < randomisation.late, self._late)
        weakest = randomisation.weakest_drive
        self._drive = torch.where(worlds, weakest + (1 - weakest) * drive, self._drive)

    def _observe(self) -> dict[str, Any]:
        views = [self._batch.observe(i) for i in range(self.robots_per_world)]
        poses = torch.stack([view.pose for view in views], 1).cpu()
        goal = geometry.polar(poses, self.tasks.goals)
        goal[..., 0].clamp_(max=MAX_GOAL_DISTANCE)

        def flat(parts: list[Tensor]) -> npt.NDArray[np.float32]:
            stacked = torch.stack(parts, 1)
            return stacked.reshape(self.num_envs, -1).cpu().numpy()

        observation = {
            "goal": goal.reshape(self.num_envs, 2).numpy(),
            "scan": flat([view.scan for view in views]),
            "velocity": flat([view.velocity for view in views]),
        }
        if self.randomisation:
            observation["privileged"] = self._privileged().reshape(self.num_envs, PRIVILEGED).numpy()
        return observation

    def _privileged(self) -> Tensor:
        bearing = self.tasks.direction(self._poses)
        time_left = 1 - self._age / self.problem.max_steps
        assert self._batch.sensing.sensors.intensity is not None
        intensity = self._batch.sensing.sensors.intensity[:, None].expand_as(bearing)
        return torch.stack([self._left / 10, bearing.cos(), bearing.sin(), time_left, intensity], -1)
