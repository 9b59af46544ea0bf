"""Stable-Baselines3 learns to choose goals: PPO on hpp/Rendezvous-v0, where the action is a goal.

    python examples/sb3_goals.py --steps 2000
    python examples/sb3_goals.py --steps 2000 --options p2p,pure-pursuit    # chooses the skill as well

One environment step is a goal: two seconds of driving, or as long as an option lasts.
"""

from __future__ import annotations

import argparse

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor

from hpp_framework.envs import HierarchyConfig  # importing it registers hpp/Rendezvous-v0


def make_env(options: tuple[str, ...], reach: float) -> gym.Env:
    """Return a room in which Freight heads for the midpoint, and Fetch is told where to go."""
    config = HierarchyConfig(options=options, reach=reach)
    env = gym.make("hpp/Rendezvous-v0", world="simple", teammates="centralized-mp", config=config)
    return Monitor(env)


def main() -> None:
    """Train, and compare with the untrained policy on the same episodes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--steps", type=int, default=2000, help="goals to learn from")
    parser.add_argument("--episodes", type=int, default=10, help="episodes to judge by")
    parser.add_argument("--options", default="", help="skills to choose among, separated by commas")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()

    torch.set_num_threads(1)  # small networks are not faster with more
    options = tuple(filter(None, given.options.split(",")))
    env = make_env(options, reach=5.0)
    rollout = max(2, min(128, given.steps))
    model = PPO(
        "MultiInputPolicy", env, n_steps=rollout, batch_size=min(64, rollout), seed=given.seed, device="cpu"
    )
    before = judge(model, options, given.episodes)
    model.learn(given.steps)
    after = judge(model, options, given.episodes)
    print(f"mean return: {before:.0f} untrained, {after:.0f} after {given.steps} goals")
    env.close()


def judge(model: PPO, options: tuple[str, ...], episodes: int) -> float:
    """Return the mean return without exploration, always on the same episodes."""
    env = make_env(options, reach=5.0)
    env.reset(seed=1)
    returns, _ = evaluate_policy(model, env, n_eval_episodes=episodes, return_episode_rewards=True)
    env.close()
    return float(np.mean(returns))


if __name__ == "__main__":
    main()
