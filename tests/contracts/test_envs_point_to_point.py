"""One robot on its way to a goal: the vector environment, and the single one that wraps it."""

from __future__ import annotations

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
import torch

from hpp_framework.core.disturbances import Disturbances
from hpp_framework.core.geometry import polar
from hpp_framework.core.world import World
from hpp_framework.envs import PointToPoint, PointToPointEnv, PointToPointVectorEnv
from hpp_framework.utils.errors import ConfigError, SimulatorError
from hpp_framework.worlds.pool import WorldPool, build_pool

SHORT = PointToPoint(max_steps=6)


@pytest.fixture(scope="module")
def pool(fetch) -> WorldPool:
    return build_pool("training", 3, [fetch], seed=0)


@pytest.fixture(scope="module")
def open_pool() -> WorldPool:
    """Return one large empty world."""
    world = World(name="open", bounds=(-20.0, -20.0, 20.0, 20.0), walled=False)
    points = np.random.default_rng(0).uniform(-10, 10, (1, 256, 2)).astype(np.float32)
    return WorldPool((world,), points)


def steer(observation) -> np.ndarray:
    """Turn towards the goal, then drive and brake."""
    distance, bearing = observation["goal"][..., 0], observation["goal"][..., 1]
    speed = np.clip(0.5 * distance, 0, 1) * (np.abs(bearing) < 0.4)
    return np.stack([speed, np.clip(1.5 * bearing, -3, 3)], -1).astype(np.float32)


def equal(first, second) -> bool:
    return all(np.array_equal(first[name], second[name]) for name in first)


def test_single_equals_a_batch_of_one():
    """Over several episodes, success and noise included: there is one implementation."""
    noise = Disturbances(position_std=0.02, scan_std=0.02)
    problem = replace(SHORT, max_steps=20)
    one = PointToPointEnv(pool_size=2, problem=problem, disturbances=noise, unit_actions=False)
    many = PointToPointVectorEnv(1, pool_size=2, problem=problem, disturbances=noise)
    seen, _ = one.reset(seed=9)
    batch, _ = many.reset(seed=9)
    rng = np.random.default_rng(0)
    ends = 0
    for _ in range(70):
        assert all(np.array_equal(seen[name], batch[name][0]) for name in seen)
        action = rng.uniform((0, -1), (1, 1)).astype(np.float32)
        seen, reward, terminated, truncated, info = one.step(action)
        batch, rewards, terminations, truncations, infos = many.step(action[None])
        assert (reward, terminated, truncated) == (rewards[0], terminations[0], truncations[0])
        assert info["touched"] == infos["touched"][0]
        if terminated or truncated:
            assert equal(seen, infos["final_obs"][0])
            seen, _ = one.reset()
            ends += 1
    assert ends == 3


def test_final_observations_are_those_of_an_environment_that_waits(pool):
    options = {"pool": pool, "problem": SHORT, "robots_per_world": 1}
    resetting, waiting = (
        PointToPointVectorEnv(4, **options),
        PointToPointVectorEnv(4, autoreset=False, **options),
    )
    assert waiting.metadata["autoreset_mode"] == gym.vector.AutoresetMode.DISABLED
    first, _ = resetting.reset(seed=1)
    second, _ = waiting.reset(seed=1)
    for step in range(1, 13):
        action = steer(first)
        first, _, _, truncated, info = resetting.step(action)
        second, *_ = waiting.step(action)
        assert truncated.all() == (step % 6 == 0)
        assert ("final_obs" in info) == truncated.all()
        if truncated.all():
            for index in range(4):
                assert equal(info["final_obs"][index], {name: part[index] for name, part in second.items()})
            assert info["_final_obs"].all()
            np.testing.assert_array_equal(info["final_info"]["steps"], 6)
            assert not equal(first, second)
            second, _ = waiting.reset(options={"reset_mask": np.ones(4, bool)})
            assert equal(first, second)


def test_only_ended_robots_have_a_final_observation(open_pool):
    env = PointToPointVectorEnv(8, pool=open_pool)
    observation, _ = env.reset(seed=0)
    seen = 0
    for _ in range(80):
        observation, _, arrived, truncated, info = env.step(steer(observation))
        ended = arrived | truncated
        assert ended.any() == ("final_obs" in info)
        for index in np.flatnonzero(ended):
            final = info["final_obs"][index]
            assert env.single_observation_space.contains(final)
            assert final["goal"][0] < env.problem.goal_radius
            assert observation["velocity"][index].tolist() == [0, 0]
            seen += 1
        if ended.any():
            assert all(info["final_obs"][index] is None for index in np.flatnonzero(~ended))
    assert seen > 4


def test_a_mask_resets_only_those_it_names(open_pool):
    env = PointToPointVectorEnv(4, pool=open_pool, autoreset=False)
    observation, _ = env.reset(seed=0)
    before, *_ = env.step(steer(observation))
    after, _ = env.reset(options={"reset_mask": np.array([False, True, False, False])})
    changed = (before["goal"] != after["goal"]).any(1)
    assert changed.tolist() == [False, True, False, False]
    with pytest.raises(ConfigError, match="4 booleans"):
        env.reset(options={"reset_mask": [0, 1]})
    with pytest.raises(ConfigError, match="first reset"):
        PointToPointVectorEnv(1, pool=open_pool).reset(options={"reset_mask": np.ones(1, bool)})


def test_reward_is_what_the_problem_says(open_pool):
    env = PointToPointVectorEnv(5, pool=open_pool)
    observation, _ = env.reset(seed=3)
    p = env.problem
    arrivals = 0
    dwelt = np.zeros(5, int)
    for _ in range(60):
        before = observation["goal"][:, 0]
        observation, reward, arrived, _, info = env.step(steer(observation))
        for index in range(5):
            after = {name: part[index] for name, part in observation.items()}
            after = info["final_obs"][index] if arrived[index] else after
            distance, (speed, turn) = after["goal"][0], after["velocity"]
            resting = distance < p.goal_radius and abs(speed) < p.rest_speed
            dwelt[index] = dwelt[index] + 1 if resting else 0
            assert arrived[index] == (dwelt[index] == p.dwell)
            expected = p.progress * (before[index] - distance) + p.step + p.turn * abs(turn)
            expected += p.linger * resting + p.arrival * arrived[index] + p.touch * info["touched"][index]
            assert reward[index] == pytest.approx(expected, abs=1e-5)
            dwelt[index] *= not arrived[index]
        arrivals += arrived.sum()
    assert arrivals > 0


def test_unit_actions_are_scaled_commands(pool):
    unit = PointToPointVectorEnv(2, pool=pool, unit_actions=True)
    plain = PointToPointVectorEnv(2, pool=pool)
    np.testing.assert_array_equal(unit.single_action_space.low, [-1, -1])
    np.testing.assert_array_equal(plain.single_action_space.high, [1, 3])
    unit.reset(seed=0)
    plain.reset(seed=0)
    scaled, *_ = unit.step(np.array([[1.0, 0.5], [-1.0, -9.0]]))
    given, *_ = plain.step(np.array([[1.0, 1.5], [0.0, -3.0]]))
    assert equal(scaled, given)


def test_starts_differ_between_seeds_and_episodes():
    env = PointToPointEnv(pool_size=3)
    goals = [env.reset(seed=seed)[0]["goal"].tolist() for seed in (0, 1, 2, None, None)]
    assert len({tuple(goal) for goal in goals}) == 5
    assert env.reset(seed=0)[0]["goal"].tolist() == goals[0]


def test_unseeded_environments_differ():
    first, second = PointToPointEnv(pool_size=2), PointToPointEnv(pool_size=2)
    assert first.reset()[0]["goal"].tolist() != second.reset()[0]["goal"].tolist()


def test_vector_seeds(pool):
    env = PointToPointVectorEnv(2, pool=pool)
    assert equal(env.reset(seed=4)[0], env.reset(seed=4)[0])
    by_list = env.reset(seed=[1, 2])[0]
    assert equal(by_list, env.reset(seed=[1, 2])[0])
    assert not equal(by_list, env.reset(seed=[1, 3])[0])


def test_goal_is_polar_and_the_world_frame_is_hidden(open_pool):
    env = PointToPointVectorEnv(2, pool=open_pool)
    observation, _ = env.reset(seed=0)
    for index in range(2):
        world, poses, goals = env.scene(index)
        assert world is open_pool.worlds[0]
        np.testing.assert_allclose(observation["goal"][index], polar(poses, goals)[0], rtol=1e-5)


def test_noise_on_request(pool):
    quiet = PointToPointVectorEnv(2, pool=pool)
    noisy = PointToPointVectorEnv(
        2, pool=pool, disturbances=Disturbances(position_std=0.1, scan_std=None, lost_beams=0.3)
    )
    clear, disturbed = quiet.reset(seed=0)[0], noisy.reset(seed=0)[0]
    assert noisy.observation_space.contains(disturbed)
    assert not np.array_equal(clear["goal"], disturbed["goal"])
    far = quiet.robot.lidar.max_range
    lost = (disturbed["scan"] == far) & (clear["scan"] < far)
    assert 0.2 < lost.mean() < 0.4
    torch.testing.assert_close(quiet.simulator.state().poses, noisy.simulator.state().poses, rtol=0, atol=0)


def test_nothing_that_should_vary_is_constant():
    env = PointToPointEnv(pool_size=2, unit_actions=False)
    observation, _ = env.reset(seed=1)
    seen = {name: [part] for name, part in observation.items()}
    rng = np.random.default_rng(1)
    turn = 0.0
    for _ in range(100):
        turn = float(np.clip(turn + rng.normal(), -2, 2))
        observation, *_ = env.step(np.array([1.0, turn]))
        for name, part in observation.items():
            seen[name].append(part)
    for name, history in seen.items():
        assert (np.ptp(np.stack(history), axis=0) > 0).all(), name


def test_neighbours_in_one_world_see_each_other(open_pool):
    env = PointToPointVectorEnv(16, pool=open_pool, robots_per_world=16)
    observation, _ = env.reset(seed=0)
    assert (observation["scan"].min(1) < 25).any()
    alone = PointToPointVectorEnv(16, pool=open_pool)
    assert (alone.reset(seed=0)[0]["scan"] == 25).all()


@pytest.mark.parametrize("action", [[np.nan, 0], [0, np.inf], [0.0], [[0, 0]], "go", None])
def test_bad_actions_are_explained(action):
    env = PointToPointEnv(pool_size=1)
    env.reset(seed=0)
    with pytest.raises(SimulatorError, match="action of the robot"):
        env.step(action)


def test_bad_use_is_explained(pool, open_pool):
    env = PointToPointVectorEnv(2, pool=pool)
    with pytest.raises(SimulatorError, match="reset"):
        env.step(np.zeros((2, 2), np.float32))
    env.reset(seed=0)
    with pytest.raises(SimulatorError, match="shape"):
        env.step(np.zeros((3, 2), np.float32))
    with pytest.raises(SimulatorError, match="not finite"):
        env.step(np.full((2, 2), np.nan, np.float32))
    with pytest.raises(ConfigError, match="multiple"):
        PointToPointVectorEnv(3, pool=pool, robots_per_world=2)
    with pytest.raises(ConfigError, match="pool_size"):
        PointToPointVectorEnv(1, pool_size=0)
    single = PointToPointEnv(pool_size=1, problem=SHORT, render_mode="rgb_array")
    for call in (single.render, lambda: single.step(np.zeros(2))):
        with pytest.raises(SimulatorError, match="reset"):
            call()
    single.reset(seed=0)
    for _ in range(6):
        *_, truncated, _ = single.step(np.array([-1.0, 0.0]))
    assert truncated
    assert single.render().shape == (480, 480, 3)
    with pytest.raises(SimulatorError, match="reset"):
        single.step(np.zeros(2))
