"""What the team environment promises beyond the PettingZoo interface."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from hpp_framework.core.geometry import polar
from hpp_framework.core.world import Box, SpawnRule, World
from hpp_framework.envs import EpisodeConfig, TeamEnv
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import ConfigError, HppError, SimulatorError, UnknownNameError
from hpp_framework.worlds.occupancy import free_space

FORWARD = {"fetch": np.array([1.0, 0.3]), "freight": np.array([0.6, -0.4])}
REST = {"fetch": np.zeros(2), "freight": np.zeros(2)}


def test_spaces_and_agents_are_the_teams():
    env = TeamEnv("alice=fetch,bob=freight,carol=fetch")
    observations, _ = env.reset(seed=0)
    assert env.agents == ["alice", "bob", "carol"]
    for agent, observation in observations.items():
        assert env.observation_space(agent).contains(observation)
        assert {name: part.shape for name, part in observation.items()} == {
            "scan": (222,), "poses": (3, 3), "goal": (2,), "velocity": (2,),
        }  # fmt: skip
    np.testing.assert_array_equal(env.action_space("bob").high, [1, 3])


def test_reward_is_shared_and_that_of_the_true_poses():
    noisy = EpisodeConfig(disturbances="ideal:position_std=0.3")
    env = TeamEnv(config=noisy)
    env.reset(seed=1)
    task = hub().tasks.create("rendezvous", env.episode.team.robots)
    for _ in range(5):
        _, rewards, *_ = env.step(FORWARD)
        expected = float(task.reward(torch.from_numpy(env.episode.poses)))
        assert rewards == {"fetch": expected, "freight": expected}


def test_observations_match_the_state_without_noise():
    env = TeamEnv()
    env.reset(seed=2)
    goals = {"fetch": (1.0, -2.0), "freight": (-3.0, 4.0)}
    env.set_goals(goals)
    observations, *_ = env.step(FORWARD)
    for i, (agent, seen) in enumerate(observations.items()):
        np.testing.assert_array_equal(seen["poses"], env.episode.poses)
        np.testing.assert_array_equal(seen["scan"], env.episode.state.scans[0, i].numpy())
        expected = polar(env.episode.poses[i], np.array(goals[agent], np.float32))
        np.testing.assert_allclose(seen["goal"], expected, rtol=1e-5)
        assert env.goals[agent] == goals[agent]


def test_noise_disturbs_what_is_seen_but_not_what_happens():
    quiet = TeamEnv()
    noisy = TeamEnv(config=EpisodeConfig(disturbances="ideal:position_std=0.1:heading_std=0.5:scan_std=0.05"))
    (clear, _), (disturbed, _) = quiet.reset(seed=3), noisy.reset(seed=3)
    for _ in range(3):
        clear, *_ = quiet.step(FORWARD)
        disturbed, *_ = noisy.step(FORWARD)
    np.testing.assert_array_equal(quiet.episode.poses, noisy.episode.poses)
    for agent in quiet.agents:
        assert noisy.observation_space(agent).contains(disturbed[agent])
        assert not np.allclose(clear[agent]["scan"], disturbed[agent]["scan"])
        assert not np.allclose(clear[agent]["poses"], disturbed[agent]["poses"])
    # a robot's error is the same for all that receive it
    assert np.allclose(disturbed["fetch"]["poses"], disturbed["freight"]["poses"])


def test_terminates_once_the_task_is_sustained():
    env = TeamEnv(world="simple")
    side = env.episode.team.robots[0].footprint_radius
    env.reset(seed=0, options={"poses": [[-side - 0.01, 0, 0], [side + 0.01, 0, math.pi]]})
    for step in range(1, env.episode.task.sustain_steps + 1):
        _, rewards, terminated, truncated, infos = env.step(REST)
        assert infos["fetch"]["success_now"]
        assert rewards["fetch"] == 0
        over = step == env.episode.task.sustain_steps
        assert terminated == {"fetch": over, "freight": over}
        assert truncated == {"fetch": False, "freight": False}
    assert env.agents == []
    assert infos["freight"]["success"]
    with pytest.raises(SimulatorError, match="reset"):
        env.step(REST)


def test_truncates_when_time_runs_out():
    env = TeamEnv(config=EpisodeConfig(max_steps=7))
    env.reset(seed=0)
    for step in range(1, 8):
        *_, terminated, truncated, _ = env.step(REST)
        assert truncated["fetch"] == (step == 7)
        assert not terminated["fetch"]
    assert env.agents == []
    assert TeamEnv().episode.config.max_steps == 100


def test_worlds_and_starts_differ_between_episodes_and_seeds():
    env = TeamEnv()
    poses, worlds = [], []
    for seed in (0, 1, None, None):
        env.reset(seed=seed)
        poses.append(env.episode.poses)
        worlds.append(env.episode.world)
    for i in range(len(poses)):
        for j in range(i):
            assert not np.allclose(poses[i], poses[j])
            assert worlds[i] != worlds[j]


def test_unseeded_environments_differ():
    first, second = TeamEnv(world="simple"), TeamEnv(world="simple")
    first.reset()
    second.reset()
    assert not np.allclose(first.episode.poses, second.episode.poses)


def test_a_world_object_is_used_as_it_is(small_world):
    room = World(
        name="room", bounds=small_world.bounds, boxes=small_world.boxes, spawn=SpawnRule(distance=2.0)
    )
    env = TeamEnv(world=room)
    env.reset(seed=0)
    env.reset()
    assert env.episode.world is room


def test_drawn_goals_are_common_and_reachable():
    env = TeamEnv()
    for seed in range(5):
        env.reset(seed=seed)
        assert env.goals["fetch"] == env.goals["freight"]
        goal = np.array([env.goals["fetch"]])
        space = free_space(env.episode.world, body_height=1.1)
        assert space.at(goal)[0] > env.episode.team.robots[0].footprint_radius


def test_nothing_that_should_vary_is_constant():
    env = TeamEnv(world="training")
    observations, _ = env.reset(seed=4)
    seen = {agent: {name: [part] for name, part in parts.items()} for agent, parts in observations.items()}
    rng = np.random.default_rng(0)
    turn = dict.fromkeys(env.agents, 0.0)
    for _ in range(60):
        turn = {agent: float(np.clip(turn[agent] + rng.normal(), -2, 2)) for agent in turn}
        observations, *_ = env.step({agent: np.array([1.0, turn[agent]]) for agent in turn})
        for agent, parts in observations.items():
            for name, part in parts.items():
                seen[agent][name].append(part)
    for agent, parts in seen.items():
        for name, history in parts.items():
            assert (np.ptp(np.stack(history), axis=0) > 0).all(), f"{agent}: {name} has constant elements"


def test_out_of_range_commands_are_limited():
    fast, allowed = TeamEnv(), TeamEnv()
    fast.reset(seed=5)
    allowed.reset(seed=5)
    wild, *_ = fast.step({"fetch": np.array([50.0, -80.0]), "freight": np.array([-4.0, 0.0])})
    tame, *_ = allowed.step({"fetch": np.array([1.0, -3.0]), "freight": np.zeros(2)})
    np.testing.assert_array_equal(wild["fetch"]["poses"], tame["fetch"]["poses"])


BAD_ACTIONS = [
    ({"fetch": np.array([np.nan, 0]), "freight": np.zeros(2)}, "agent 'fetch' is not finite"),
    ({"fetch": np.zeros(2), "freight": np.array([0, np.inf])}, "agent 'freight' is not finite"),
    ({"fetch": np.zeros(3), "freight": np.zeros(2)}, "two numbers"),
    ({"fetch": 1.0, "freight": np.zeros(2)}, "two numbers"),
    ({"fetch": "go", "freight": np.zeros(2)}, "two numbers"),
    ({"fetch": np.zeros(2)}, "no action for agent 'freight'"),
    ({**REST, "carol": np.zeros(2)}, "no agent 'carol'"),
    ({}, "no action for agent 'fetch'"),
]


@pytest.mark.parametrize(("actions", "message"), BAD_ACTIONS)
def test_bad_actions_are_explained(actions, message):
    env = TeamEnv(world="simple")
    env.reset(seed=0)
    with pytest.raises(SimulatorError, match=message):
        env.step(actions)


def test_bad_use_is_explained():
    env = TeamEnv(world="simple")
    with pytest.raises(SimulatorError, match="reset"):
        env.step(REST)
    with pytest.raises(SimulatorError, match="reset"):
        TeamEnv(render_mode="rgb_array").render()
    with pytest.raises(ConfigError, match="window"):
        TeamEnv(render_mode="human").render()
    with pytest.raises(ConfigError, match="rgb_array"):
        TeamEnv(render_mode="rgb")
    with pytest.raises(UnknownNameError, match="batch"):
        TeamEnv(config=EpisodeConfig(backend="bach"))
    with pytest.raises(UnknownNameError, match="Did you mean 'wall'"):
        TeamEnv(world="wal")
    with pytest.raises(ConfigError, match="max_steps"):
        EpisodeConfig(max_steps=0)
    env.reset(seed=0)
    with pytest.raises(UnknownNameError, match="Did you mean 'fetch'"):
        env.set_goals({"fech": (0, 0)})
    with pytest.raises(ConfigError, match="two finite numbers"):
        env.set_goals({"fetch": (0, math.nan)})
    with pytest.raises(ConfigError, match="two finite numbers"):
        env.set_goals({"fetch": "there"})
    with pytest.raises(ConfigError, match="shape"):
        env.reset(options={"poses": [[0, 0, 0]]})
    with pytest.raises(ConfigError, match="shape"):
        env.reset(options={"poses": [[0, 0], [0]]})


def test_worlds_without_room_or_too_far_away_are_refused():
    full = World(name="full", bounds=(-1, -1, 1, 1), boxes=(Box(center=(0, 0), size=(2, 2)),))
    far = World(name="far", bounds=(5000, 5000, 5020, 5020))
    for world, message in ((full, "room"), (far, "positions up to")):
        with pytest.raises(HppError, match=message):
            TeamEnv(world=world).reset(seed=0)


def test_pictures_show_the_moment():
    env = TeamEnv(world="wall", render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    for _ in range(10):
        env.step(FORWARD)
    second = env.render()
    assert first.shape == second.shape
    assert first.dtype == np.uint8
    assert (first != second).any()
    assert TeamEnv().render() is None


@pytest.mark.sapien
def test_runs_on_sapien():
    pytest.importorskip("sapien")
    env = TeamEnv(world="simple", config=EpisodeConfig(backend="sapien"))
    observations, _ = env.reset(seed=0)
    for _ in range(3):
        observations, rewards, *_ = env.step(FORWARD)
    assert all(env.observation_space(agent).contains(seen) for agent, seen in observations.items())
    assert rewards["fetch"] < 0
    env.close()
    env.close()
