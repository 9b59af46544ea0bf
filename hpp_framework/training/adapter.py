"""The navigation environment as Stable-Baselines3 wants it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv

from hpp_framework.envs.point_to_point import PointToPointVectorEnv

WINDOW = 2000
"""Episodes that a point of the learning curve is the mean of."""


class Sb3Adapter(VecEnv):
    """Shows a :class:`PointToPointVectorEnv` to Stable-Baselines3, actions scaled to [-1, 1]."""

    def __init__(self, env: PointToPointVectorEnv, seed: int) -> None:
        self.env = env
        space = env.single_action_space
        assert isinstance(space, spaces.Box)
        self._middle, self._half = (space.high + space.low) / 2, (space.high - space.low) / 2
        self._start_seed: int | None = seed
        self._actions: npt.NDArray[np.float32] = np.zeros(0, np.float32)
        self.recent: deque[bool] = deque(maxlen=WINDOW)
        self.touch_share: deque[float] = deque(maxlen=500)
        self.critic: Callable[[dict[str, torch.Tensor]], torch.Tensor] | None = None
        self._infos: list[dict[str, Any]] = [{} for _ in range(env.num_envs)]
        super().__init__(
            env.num_envs, env.single_observation_space, spaces.Box(-1, 1, space.shape, np.float32)
        )

    def reset(self) -> Any:
        """Start every robot anew; seeded the first time."""
        observation, _ = self.env.reset(seed=self._start_seed)
        self._start_seed = None
        return observation

    def step_async(self, actions: npt.NDArray[np.float32]) -> None:
        """Take actions in [-1, 1] for the next :meth:`step_wait`."""
        self._actions = np.asarray(self._middle + self._half * np.clip(actions, -1, 1), np.float32)

    def step_wait(self) -> Any:
        """Step all robots and keep count of successes."""
        observation, reward, over, truncated, info = self.env.step(self._actions)
        done = over | truncated
        if done.any():
            # robots cut short by their neighbour's end say nothing about success
            told = over | (info["final_info"]["steps"] >= self.env.problem.max_steps)
            self.recent.extend(info["final_info"]["success"][done & told].tolist())
        if truncated.any():
            reward = reward + truncated * self._worth(info["final_obs"], truncated)
        self.touch_share.append(float(info["touched"].mean()))
        return observation, reward.astype(np.float32), done, self._infos

    def _worth(
        self, final: npt.NDArray[np.object_], truncated: npt.NDArray[np.bool_]
    ) -> npt.NDArray[np.float32]:
        """Return what was still to come where an episode was cut short, all in one call of the critic."""
        worth = np.zeros(self.num_envs, np.float32)
        if self.critic:
            rows = final[truncated]
            stacked = {name: torch.from_numpy(np.stack([row[name] for row in rows])) for name in rows[0]}
            worth[truncated] = self.critic(stacked).flatten().numpy()
        return worth

    def close(self) -> None:
        """Do nothing: the simulator frees itself."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of the batch, once a robot."""
        return [getattr(self.env, attr_name, None)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refuse: robots of a batch have no attributes of their own."""
        raise AttributeError(f"'{attr_name}' cannot be set on a batch of robots.")

    def env_method(
        self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any
    ) -> list[Any]:
        """Refuse: robots of a batch have no methods of their own."""
        raise AttributeError(f"'{method_name}' cannot be called on one robot of a batch.")

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Return that no robot has a wrapper."""
        return [False] * self.num_envs
