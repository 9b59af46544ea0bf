"""Multi-agent learning with outside tools: SuperSuit turns our PettingZoo team into what any PPO can train.

    pip install "hpp-framework[examples]"
    python examples/marl_pettingzoo.py --steps 20000

All robots share one policy (parameter sharing): from a robot's own observation to that robot's command.
"""

from __future__ import annotations

import argparse

import gymnasium as gym
import numpy as np
import supersuit
import torch
from pettingzoo.utils import BaseParallelWrapper
from stable_baselines3 import PPO
from stable_baselines3.common.utils import set_random_seed
from supersuit.vector.sb3_vector_wrapper import SB3VecEnvWrapper

from hpp_framework.envs import EpisodeConfig, TeamEnv


class Flat(BaseParallelWrapper):
    """One flat vector for each agent instead of a dictionary, as SuperSuit wants it; lidar thinned out."""

    def observation_space(self, agent: str) -> gym.Space:
        """Return the space of the flat vector."""
        size = len(self._flatten(self.env.observation_space(agent).sample()))
        return gym.spaces.Box(-np.inf, np.inf, (size,), np.float32)

    def reset(self, seed: int | None = None, options: dict | None = None) -> tuple[dict, dict]:
        """Start an episode."""
        observations, infos = self.env.reset(seed, options)
        return {agent: self._flatten(seen) for agent, seen in observations.items()}, infos

    def step(self, actions: dict) -> tuple[dict, dict, dict, dict, dict]:
        """Drive all robots for one control step."""
        observations, *rest = self.env.step(actions)
        return {agent: self._flatten(seen) for agent, seen in observations.items()}, *rest

    @staticmethod
    def _flatten(seen: dict[str, np.ndarray]) -> np.ndarray:
        parts = (seen["scan"][::8] / 10, seen["poses"].ravel() / 10, seen["goal"] / 10, seen["velocity"])
        return np.concatenate(parts).astype(np.float32)


def main() -> None:
    """Train for a while and say how the reward went."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--steps", type=int, default=20_000, help="control steps of all robots together")
    parser.add_argument("--team", default="fetch,freight", help="robots with equally many lidar beams")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()

    torch.set_num_threads(1)  # small networks are not faster with more
    team = Flat(TeamEnv(given.team, world="simple", config=EpisodeConfig(max_steps=100)))
    team.reset(seed=given.seed)  # SuperSuit hands no seeds on; episodes go on from this one
    set_random_seed(given.seed)
    env = SB3VecEnvWrapper(supersuit.pettingzoo_env_to_vec_env_v1(team))  # one robot, one row
    rollout = max(2, min(256, given.steps // env.num_envs))
    model = PPO("MlpPolicy", env, n_steps=rollout, batch_size=64, device="cpu")
    model.learn(given.steps)
    reward = model.rollout_buffer.rewards.mean()
    print(f"{given.steps} steps of {env.num_envs} robots; mean reward a step at the end: {reward:.2f}")


if __name__ == "__main__":
    main()
