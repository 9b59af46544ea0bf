"""Stable-Baselines3 learns to choose goals: PPO on hpp/Rendezvous-v0, where the action is a goal.

    python examples/sb3_goals.py --steps 4000
    python examples/sb3_goals.py --steps 4000 --options p2p,pure-pursuit    # chooses the skill as well

One environment step is a goal: two seconds of driving, or as long as an option lasts. A wall stands between
the learner, Fetch, and Freight, which plans by HPP. Who has learnt nothing goes to the middle, into the wall.
"""

from __future__ import annotations

import argparse

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from hpp_framework.envs import HierarchyConfig  # importing it registers hpp/Rendezvous-v0

GAMMA = 0.95
"""An episode is at most ten goals."""


def make_env(options: tuple[str, ...]) -> gym.Env:
    """Return a room in which Freight plans for itself, and Fetch is told where to go."""
    config = HierarchyConfig(options=options)
    return Monitor(gym.make("hpp/Rendezvous-v0", world="wall", teammates="hpp", config=config))


def main() -> None:
    """Train, and compare with the untrained policy on the same episodes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--steps", type=int, default=4000, help="goals to learn from")
    parser.add_argument("--episodes", type=int, default=10, help="episodes to judge by")
    parser.add_argument("--options", default="", help="skills to choose among, separated by commas")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()

    torch.set_num_threads(1)  # small networks are not faster with more
    options = tuple(filter(None, given.options.split(",")))
    env = VecNormalize(DummyVecEnv([lambda: make_env(options)]), norm_obs=False, gamma=GAMMA)
    rollout = max(2, min(256, given.steps))
    model = PPO(
        "MultiInputPolicy", env, n_steps=rollout, batch_size=min(64, rollout), gamma=GAMMA, seed=given.seed,
        policy_kwargs={"log_std_init": -1.0}, device="cpu",
    )  # fmt: skip
    before = judge(model, options, given.episodes)
    model.learn(given.steps)
    after = judge(model, options, given.episodes)
    print(f"mean return: {before:.0f} untrained, {after:.0f} after {given.steps} goals")
    env.close()


def judge(model: PPO, options: tuple[str, ...], episodes: int) -> float:
    """Return the mean return without exploration, always on the same episodes."""
    env = make_env(options)
    env.reset(seed=1)
    returns, _ = evaluate_policy(model, env, n_eval_episodes=episodes, return_episode_rewards=True)
    env.close()
    return float(np.mean(returns))


if __name__ == "__main__":
    main()
