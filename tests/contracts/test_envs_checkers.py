"""The environments pass the checkers of the libraries they are written for, without a warning."""

from __future__ import annotations

import warnings

import gymnasium as gym
import pytest
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import parallel_api_test, parallel_seed_test, render_test
from pettingzoo.utils.conversions import parallel_to_aec
from stable_baselines3.common.env_checker import check_env as check_env_sb3

import hpp_framework.envs  # registers the ids
from hpp_framework.envs import TeamEnv
from hpp_framework.envs.registration import POINT_TO_POINT, RENDEZVOUS

SHAPE_ADVICE = "Your observation poses has an unconventional shape"


@pytest.fixture
def make(straight_team):
    def build(name: str, **options):
        small = {"pool_size": 3} if name == POINT_TO_POINT else {"team": straight_team}
        return gym.make(name, **small, **options)

    return build


@pytest.mark.parametrize("name", [POINT_TO_POINT, RENDEZVOUS])
@pytest.mark.parametrize("render_mode", [None, "rgb_array"])
def test_gymnasium(make, name, render_mode):
    env = make(name, render_mode=render_mode)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)
    env.close()


@pytest.mark.parametrize("name", [POINT_TO_POINT, RENDEZVOUS])
def test_stable_baselines(make, name):
    env = make(name, render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # advice, not a fault: one row per robot is easier to read, and Stable-Baselines3 flattens it itself
        warnings.filterwarnings("ignore", message=SHAPE_ADVICE)
        check_env_sb3(env.unwrapped, skip_render_check=False)
    env.close()


def test_pettingzoo_api():
    env = TeamEnv()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        parallel_api_test(env, num_cycles=220)


def test_pettingzoo_seed():
    parallel_seed_test(TeamEnv, num_cycles=60)


def test_pettingzoo_render():
    render_test(lambda render_mode=None: parallel_to_aec(TeamEnv(render_mode=render_mode)))


def test_gymnasium_with_the_shipped_skills():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gym.make(RENDEZVOUS).unwrapped)


def test_registering_twice_changes_nothing():
    before = dict(gym.registry)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        hpp_framework.envs.register_envs()
    assert gym.registry == before


def test_vector_env_is_made_by_name():
    env = gym.make_vec(POINT_TO_POINT, num_envs=4, vectorization_mode="vector_entry_point", pool_size=2)
    assert isinstance(env, hpp_framework.envs.PointToPointVectorEnv)
    recorded = gym.wrappers.vector.RecordEpisodeStatistics(env)
    recorded.reset(seed=0)
    recorded.action_space.seed(0)
    lengths: list[int] = []
    for _ in range(160):
        observation, *_, info = recorded.step(recorded.action_space.sample())
        assert observation in env.observation_space
        if "episode" in info:
            lengths += info["episode"]["l"][info["_episode"]].tolist()
    assert lengths
    assert max(lengths) <= 150
