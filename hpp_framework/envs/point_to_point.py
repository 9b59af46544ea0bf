"""Point-to-point navigation as a ``gymnasium.vector.VectorEnv`` over the batch simulator.

One sub-environment is one robot with its own goal. With ``robots_per_world`` above one, several
sub-environments share a world and are moving obstacles to each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt
import torch
from gymnasium.vector import AutoresetMode
from torch import Tensor

from hpp_framework import geometry
from hpp_framework.errors import ConfigError
from hpp_framework.registry import hub
from hpp_framework.robot import RobotSpec
from hpp_framework.seeding import torch_rng
from hpp_framework.sensing import NoiseModel, Sensing
from hpp_framework.sim.batch import BatchSimulator
from hpp_framework.types import State
from hpp_framework.worlds.pool import WorldPool, build_pool

CANDIDATES = 16
MAX_GOAL_DISTANCE = 60.0


@dataclass(frozen=True, kw_only=True)
class PointToPoint:
    """The navigation problem: what counts as arriving, and what is rewarded.

    Attributes:
        goal_distance: nearest and farthest goal, straight line, in metres.
        goal_radius: distance at which a goal is reached, in metres.
        rest_speed: forward speed below which the robot is at rest, m/s.
        dwell: consecutive steps at rest at the goal that end an episode with success.
        max_steps: control steps before an episode is truncated (150 are 30 s).
        progress: reward for each metre of straight-line progress.
        arrival: reward for success.
        touch: reward for each step in contact.
        step: reward for each step.
        turn: reward for each rad/s of turn rate and step.
        linger: reward for each step at rest at the goal.
    """

    goal_distance: tuple[float, float] = (1.0, 10.0)
    goal_radius: float = 0.3
    rest_speed: float = 0.15
    dwell: int = 5
    max_steps: int = 150
    progress: float = 1.0
    arrival: float = 3.0
    touch: float = -0.4
    step: float = -0.02
    turn: float = -0.005
    linger: float = 0.3


def observation_space(robot: RobotSpec) -> gym.spaces.Dict:
    """Return the space of one robot: scan (m), goal (distance m, bearing rad), velocity (m/s, rad/s)."""
    lidar, drive = robot.lidar, robot.drive
    wide = np.float32(np.pi)
    return gym.spaces.Dict(
        {
            "scan": gym.spaces.Box(lidar.min_range, lidar.max_range, (lidar.beams,), np.float32),
            "goal": gym.spaces.Box(
                np.array([0, -wide], np.float32), np.array([MAX_GOAL_DISTANCE, wide], np.float32), dtype=np.float32
            ),
            "velocity": gym.spaces.Box(
                np.array([drive.speed[0], -drive.turn_rate], np.float32),
                np.array([drive.speed[1], drive.turn_rate], np.float32),
                dtype=np.float32,
            ),
        }
    )


def action_space(robot: RobotSpec) -> gym.spaces.Box:
    """Return the space of commands: forward speed (m/s) and turn rate (rad/s)."""
    drive = robot.drive
    return gym.spaces.Box(
        np.array([drive.speed[0], -drive.turn_rate], np.float32),
        np.array([drive.speed[1], drive.turn_rate], np.float32),
        dtype=np.float32,
    )


class PointToPointVectorEnv(gym.vector.VectorEnv[dict[str, Any], Any, Any]):
    """Many robots, each on its way to its own goal; autoresets in the same step.

    Args:
        num_envs: number of robots.
        robot: registered robot or its data.
        world: registered world that the pool is drawn from.
        pool_size: number of different worlds.
        robots_per_world: robots that share a world.
        problem: arrival and rewards.
        noise: disturbances of scans and poses.
        seed: of the pool of worlds.
        device: torch device.
    """

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": []}  # noqa: RUF012  # Gymnasium's own form

    def __init__(
        self,
        num_envs: int = 1,
        *,
        robot: str | RobotSpec = "fetch",
        world: str = "training",
        pool_size: int = 64,
        robots_per_world: int = 1,
        problem: PointToPoint | None = None,
        noise: NoiseModel | None = None,
        seed: int = 0,
        device: str = "cpu",
        pool: WorldPool | None = None,
    ) -> None:
        if num_envs < 1 or num_envs % robots_per_world:
            raise ConfigError(f"num_envs ({num_envs}) must be a positive multiple of robots_per_world.")
        self.robot = hub().robots.create(robot) if isinstance(robot, str) else robot
        self.problem = problem or PointToPoint()
        self.noise = noise or NoiseModel()
        self.num_envs = num_envs
        self.worlds_count = num_envs // robots_per_world
        self.robots_per_world = robots_per_world
        self.pool = pool or build_pool(world, pool_size, [self.robot], seed=seed)
        self._points = torch.from_numpy(self.pool.points)
        self.simulator = BatchSimulator([self.robot] * robots_per_world, device=device)
        self.simulator.load(self.pool.worlds, episodes=self.worlds_count)
        self.single_observation_space = observation_space(self.robot)
        self.single_action_space = action_space(self.robot)
        self.observation_space = gym.vector.utils.batch_space(self.single_observation_space, num_envs)
        self.action_space = gym.vector.utils.batch_space(self.single_action_space, num_envs)
        self._seed(seed)

    def _seed(self, seed: int) -> None:
        self.rng = torch_rng(seed, "point-to-point")
        self._sensing = Sensing(self.simulator.robots, self.noise, torch_rng(seed, "sensing"))

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Start every robot anew; an integer seed makes all that follows repeatable."""
        del options
        if isinstance(seed, int):
            self._seed(seed)
        shape = (self.worlds_count, self.robots_per_world)
        self._world_index = torch.zeros(shape[0], dtype=torch.int64)
        self._goals = torch.zeros(*shape, 2)
        self._dwelt = torch.zeros(shape, dtype=torch.int64)
        self._age = torch.zeros(shape, dtype=torch.int64)
        state = self._restart(torch.ones(shape, dtype=torch.bool), torch.full((*shape, 3), 1e6))
        self._sensing.reset(state)
        self._distance = self._goal_distance(state)
        return self._observe(), {}

    def step(
        self, actions: npt.NDArray[np.float32]
    ) -> tuple[dict[str, Any], npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any], dict[str, Any]]:
        """Drive everybody for one control period; ``final_obs`` and ``final_info`` hold ended episodes."""
        commands = torch.as_tensor(np.asarray(actions, np.float32))
        state = self.simulator.step(commands.reshape(self.worlds_count, self.robots_per_world, 2))
        reward, success = self._score(state)
        truncated = (self._age >= self.problem.max_steps) & ~success
        ended = success | truncated
        # a world is redrawn when its first robot ends, which cuts the others short
        truncated |= ended[:, :1] & ~success
        ended |= truncated
        self._sensing.update(state)
        info: dict[str, Any] = {}
        flags = (reward, success, truncated)
        if bool(ended.any()):
            observation = self._observe()
            info = {
                "final_obs": observation,
                "final_info": {"success": success.reshape(-1).numpy(), "steps": self._age.reshape(-1).numpy().copy()},
                "_final_obs": ended.reshape(-1).numpy(),
                "_final_info": ended.reshape(-1).numpy(),
            }
            fresh_state = self._restart(ended, state.poses.cpu())
            self._refresh(fresh_state, ended)
            self._distance = self._goal_distance(fresh_state)
        info["touched"] = state.collided.reshape(-1).cpu().numpy()
        reward_np, success_np, truncated_np = (flag.reshape(-1).cpu().numpy() for flag in flags)
        return self._observe(), reward_np, success_np, truncated_np, info

    def _score(self, state: State) -> tuple[Tensor, Tensor]:
        p = self.problem
        self._age += 1
        distance = self._goal_distance(state)
        at_rest = (distance < p.goal_radius) & (state.velocities[..., 0].abs().cpu() < p.rest_speed)
        self._dwelt = torch.where(at_rest, self._dwelt + 1, 0)
        success = self._dwelt >= p.dwell
        reward = (
            p.progress * (self._distance - distance)
            + p.arrival * success
            + p.linger * at_rest
            + p.touch * state.collided.cpu()
            + p.step
            + p.turn * state.velocities[..., 1].abs().cpu()
        )
        self._distance = distance
        return reward, success

    def _goal_distance(self, state: State) -> Tensor:
        return (state.poses[..., :2].cpu() - self._goals).norm(dim=-1)

    def _restart(self, chosen: Tensor, poses: Tensor) -> State:
        """Give the chosen robots a new start and goal; a world is redrawn where robot 0 is chosen."""
        redraw = chosen[:, 0]
        index = torch.randint(len(self.pool), (self.worlds_count,), generator=self.rng)
        self._world_index = torch.where(redraw, index, self._world_index)
        points = self._points[self._world_index]
        poses = poses.clone()
        for i in range(self.robots_per_world):
            pick = chosen[:, i]
            if not bool(pick.any()):
                continue
            start = self._draw_start(points, poses, i)
            heading = (torch.rand(self.worlds_count, generator=self.rng) * 2 - 1) * torch.pi
            poses[:, i] = torch.where(pick[:, None], torch.cat([start, heading[:, None]], 1), poses[:, i])
            self._goals[:, i] = torch.where(pick[:, None], self._draw_goal(points, start), self._goals[:, i])
        self._age[chosen] = 0
        self._dwelt[chosen] = 0
        return self.simulator.place(self._world_index.to(torch.int32), chosen, poses)

    def _candidates(self, points: Tensor) -> Tensor:
        chosen = torch.randint(points.shape[1], (len(points), CANDIDATES), generator=self.rng)
        return points.gather(1, chosen[..., None].expand(-1, -1, 2))

    def _draw_start(self, points: Tensor, poses: Tensor, robot: int) -> Tensor:
        candidates = self._candidates(points)
        others = torch.cat([poses[:, :robot, :2], poses[:, robot + 1 :, :2]], 1)
        if others.shape[1] == 0:
            return candidates[:, 0]
        gap = (candidates[:, :, None] - others[:, None]).norm(dim=-1).amin(-1)
        first = (gap > 2 * self.robot.footprint_radius + 0.3).to(torch.uint8).argmax(1)
        return candidates[torch.arange(len(candidates)), first]

    def _draw_goal(self, points: Tensor, start: Tensor) -> Tensor:
        candidates = self._candidates(points)
        distance = (candidates - start[:, None]).norm(dim=-1)
        low, high = self.problem.goal_distance
        first = ((distance >= low) & (distance <= high)).to(torch.uint8).argmax(1)
        return candidates[torch.arange(len(candidates)), first]

    def _refresh(self, state: State, fresh: Tensor) -> None:
        self._sensing.restart(state, fresh)

    def _observe(self) -> dict[str, Any]:
        views = [self._sensing.observe(i) for i in range(self.robots_per_world)]
        poses = torch.stack([view.pose for view in views], 1).cpu()
        goal = geometry.polar(poses, self._goals)
        goal[..., 0].clamp_(max=MAX_GOAL_DISTANCE)

        def flat(parts: list[Tensor]) -> npt.NDArray[np.float32]:
            stacked = torch.stack(parts, 1)
            return stacked.reshape(self.num_envs, -1).cpu().numpy()

        return {
            "goal": goal.reshape(self.num_envs, 2).numpy(),
            "scan": flat([view.scan for view in views]),
            "velocity": flat([view.velocity for view in views]),
        }
