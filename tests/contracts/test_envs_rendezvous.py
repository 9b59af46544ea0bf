"""Meta-planning as an environment: the action is a goal, skills drive, teammates plan."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from hpp_framework.core.planner import Decision, MetaPlanner, certain
from hpp_framework.core.team import Team
from hpp_framework.core.world import World
from hpp_framework.envs import EpisodeConfig, HierarchyConfig, RendezvousEnv, TeamEnv
from hpp_framework.plugins.builtin import DEFAULT_CONTROL
from hpp_framework.utils.errors import ConfigError, SimulatorError, UnknownNameError


class Recorder(MetaPlanner):
    """Sends all robots to one point and keeps what it saw."""

    def __init__(self, context, goal=(3.0, 3.0)):
        self.context = context
        self.goal = torch.tensor([goal])
        self.seen = []

    def plan(self, observation, belief, rng):
        self.seen.append((observation, belief))
        return Decision(self.goal, certain(self.goal))


def test_centralised_midpoint_meets_in_an_empty_room(straight_team):
    env = RendezvousEnv(straight_team, world="simple")
    env.reset(seed=0)
    for _ in range(9):
        *_, terminated, truncated, info = env.step(np.zeros(2))
        if terminated or truncated:
            break
    assert terminated
    assert not truncated
    assert info["success_now"]
    with pytest.raises(SimulatorError, match="reset"):
        env.step(np.zeros(2))


def test_truncates_after_a_hundred_control_steps(straight_team):
    env = RendezvousEnv(straight_team, world="simple", config=HierarchyConfig(plan_every=30))
    env.reset(seed=0, options={"poses": [[-9, -9, 0], [9, 9, 3]]})
    steps, truncated = [], False
    while not truncated:
        _, _, terminated, truncated, info = env.step(np.array([-1.0, -1.0]))
        steps.append(info["steps"])
        assert not terminated
    assert steps == [30, 30, 30, 10]
    assert not info["success_now"]


def test_action_is_an_offset_from_the_midpoint_in_the_world_frame(straight_team):
    env = RendezvousEnv(straight_team, world="simple", config=HierarchyConfig(reach=4.0))
    for action, expected in (
        ([0.5, -0.25], [2.0, 1.0]),
        ([1, 1], [4.0, 6.0]),
        ([-30, 0], [-4.0, 2.0]),
    ):
        env.reset(seed=0, options={"poses": [[-2, 2, 0], [2, 2, 1]]})
        *_, info = env.step(np.array(action))
        np.testing.assert_allclose(info["goal"], expected, atol=1e-6)
    env.reset(seed=0, options={"poses": [[7, 9, 0], [9, 9, 1]]})
    *_, info = env.step(np.array([1.0, 1.0]))
    np.testing.assert_allclose(info["goal"], [10, 10])


def test_learner_drives_to_the_given_goal_and_teammates_to_their_own(straight_team):
    planners = []

    def factory(context):
        planners.append(Recorder(context))
        return planners[-1]

    for learner in (0, 1):
        planners.clear()
        env = RendezvousEnv(straight_team, world="simple", learner=learner, teammates=factory)
        starts = np.array([[-3, -3, 0.7], [4, -3, 1.2]])
        env.reset(seed=0, options={"poses": starts if learner == 0 else starts[::-1]})
        assert [planner.context.agent for planner in planners] == [1 - learner]
        assert planners[0].context.bounds == env.episode.world.bounds
        goal = None
        for _ in range(6):
            offset = np.array([-4.0, 2.0]) - env.episode.poses[:, :2].mean(0)
            *_, info = env.step(offset / env.config.reach)
            goal = info["goal"]
        poses = env.episode.poses
        assert np.hypot(*(poses[learner, :2] - goal)) < 0.5
        assert np.hypot(*(poses[1 - learner, :2] - [3, 3])) < 3
        assert len(planners[0].seen) == 6
        assert planners[0].seen[0][1] is None
        assert planners[0].seen[1][1] is not None
        assert planners[0].seen[0][0].agent == 1 - learner


def test_return_is_that_of_the_team_environment(straight_team):
    """The reward is summed over control steps, so how often goals are given does not change the return."""
    returns = []
    for plan_every in (5, 10):
        config = HierarchyConfig(plan_every=plan_every, teammates_control="safety-filter")
        env = RendezvousEnv(straight_team, world="simple", teammates=Recorder, config=config)
        env.reset(seed=0, options={"poses": [[-3, -3, 0.7], [5, -3, 1.2]]})
        team = TeamEnv(straight_team, world="simple")
        team.reset(seed=0, options={"poses": [[-3, -3, 0.7], [5, -3, 1.2]]})
        _, reward, *_ = env.step(np.zeros(2))
        expected = 0.0
        goal = np.array([1.0, -3.0])
        team.set_goals({"fetch": goal, "freight": (3, 3)})
        for _ in range(plan_every):
            actions = {}
            for agent in team.agents:
                distance, bearing = team.observe(agent)["goal"]
                speed = np.clip(distance, 0, 1) * (abs(bearing) < 0.5)
                actions[agent] = np.array([speed, np.clip(2 * bearing, -3, 3)])
            _, rewards, *_ = team.step(actions)
            expected += rewards["fetch"]
        assert reward == pytest.approx(expected, rel=1e-4)
        returns.append(reward)
    assert returns[0] != returns[1]


def test_observation_is_the_learners_own(straight_team):
    env = RendezvousEnv(straight_team, world="wall", learner=1)
    observation, _ = env.reset(seed=0)
    np.testing.assert_array_equal(observation["poses"], env.episode.poses)
    np.testing.assert_array_equal(observation["scan"], env.episode.state.scans[0, 1].numpy())
    assert {name: part.shape for name, part in observation.items()} == {
        "scan": (222,), "poses": (2, 3), "velocity": (2,),
    }  # fmt: skip


def test_noise_reaches_observation_and_midpoint(straight_team):
    noisy = HierarchyConfig(episode=EpisodeConfig(disturbances="ideal:position_std=0.2"))
    env = RendezvousEnv(straight_team, world="simple", config=noisy)
    observation, _ = env.reset(seed=0)
    assert not np.allclose(observation["poses"], env.episode.poses)
    *_, info = env.step(np.zeros(2))
    np.testing.assert_allclose(info["goal"], observation["poses"][:, :2].mean(0), atol=1e-5)


def test_episodes_differ(straight_team):
    env = RendezvousEnv(straight_team)
    starts = [env.reset(seed=seed)[0]["poses"] for seed in (0, 1, None)]
    assert not np.allclose(starts[0], starts[1])
    assert not np.allclose(starts[1], starts[2])
    np.testing.assert_array_equal(env.reset(seed=0)[0]["poses"], starts[0])


def test_nothing_that_should_vary_is_constant(straight_team):
    env = RendezvousEnv(straight_team, config=HierarchyConfig(plan_every=2))
    observation, _ = env.reset(seed=3)
    seen = {name: [part] for name, part in observation.items()}
    rng = np.random.default_rng(0)
    over = False
    while not over:
        observation, _, terminated, truncated, _ = env.step(rng.uniform(-1, 1, 2))
        over = terminated or truncated
        for name, part in observation.items():
            seen[name].append(part)
    for name, history in seen.items():
        assert (np.ptp(np.stack(history), axis=0) > 0).all(), name


def test_a_new_world_size_means_new_planners(straight_team):
    """Planners know the bounds of the world they plan in."""
    made = []

    def factory(context):
        made.append(context.bounds)
        return Recorder(context)

    env = RendezvousEnv(straight_team, world="simple", teammates=factory)
    env.reset(seed=0)
    env.reset(seed=1)
    assert len(made) == 1
    env.episode._draw_world = lambda rng: World(name="wide", bounds=(-15.0, -15.0, 15.0, 15.0))
    env.reset(seed=2)
    assert made[-1] == (-15.0, -15.0, 15.0, 15.0)


def test_centralised_planners_share_their_randomness(straight_team):
    others = [replace(member, id=f"{member.id}-2") for member in straight_team.members]
    members = (*straight_team.members, *others)
    env = RendezvousEnv(Team(members), world="simple", teammates="centralized-rp")
    env.reset(seed=0)
    env.step(np.zeros(2))
    goals = [agent.belief.goal for agent in env._agents[1:]]
    assert all(torch.equal(goals[0], goal) for goal in goals)


@pytest.mark.parametrize("action", [[np.nan, 0], [0, np.inf], [0.0], "there", None])
def test_bad_actions_are_explained(straight_team, action):
    env = RendezvousEnv(straight_team, world="simple")
    env.reset(seed=0)
    with pytest.raises(SimulatorError, match="action of the learner"):
        env.step(action)


def test_bad_use_is_explained(straight_team):
    env = RendezvousEnv(straight_team, world="simple", render_mode="rgb_array")
    with pytest.raises(SimulatorError, match="reset"):
        env.step(np.zeros(2))
    with pytest.raises(SimulatorError, match="reset"):
        env.render()
    for options, message in (
        ({"learner": 2}, "learner"),
        ({"learner": -1}, "learner"),
        ({"render_mode": "human"}, "rgb_array"),
    ):
        with pytest.raises(ConfigError, match=message):
            RendezvousEnv(straight_team, **options)
    with pytest.raises(UnknownNameError, match="Did you mean 'centralized-mp'"):
        RendezvousEnv(straight_team, teammates="centralised-mp")
    for options in ({"plan_every": 0}, {"reach": 0.0}, {"reach": float("nan")}):
        with pytest.raises(ConfigError, match=next(iter(options))):
            HierarchyConfig(**options)


@pytest.mark.parametrize("learner", [0, 1])
def test_runs_with_the_shipped_skills(learner):
    """Told to go to the middle of an empty room, either robot meets the other there, and stays with it."""
    env = RendezvousEnv(world="simple", learner=learner)
    env.reset(seed=0)
    met = []
    for _ in range(10):
        observation, _, terminated, truncated, info = env.step(np.zeros(2))
        assert env.observation_space.contains(observation)
        met.append(info["success_now"])
        if terminated or truncated:
            break
    assert all(met[3:])


def test_a_learner_that_stops_on_success_ends_the_episode():
    env = RendezvousEnv(world="simple", config=HierarchyConfig(control=DEFAULT_CONTROL))
    env.reset(seed=0)
    assert any(env.step(np.zeros(2))[2] for _ in range(10))
