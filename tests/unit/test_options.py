"""Skills as options: where they start, when they end, and who chooses among them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from hpp_framework.agents.hierarchical import HierarchicalAgent
from hpp_framework.core.control import ControlStack
from hpp_framework.core.option import Option, anywhere, arrived
from hpp_framework.core.planner import PlannerContext
from hpp_framework.core.predictor import Predictor
from hpp_framework.core.skill import Skill
from hpp_framework.core.types import Trajectories
from hpp_framework.core.world import Box, World
from hpp_framework.envs import HierarchyConfig, RendezvousEnv
from hpp_framework.episodes.core import EpisodeBatch
from hpp_framework.perception.visibility import clear_way
from hpp_framework.planning.hpp.lattice import LatticePlanner
from hpp_framework.planning.options import OptionsConfig, OptionsPlanner, OwnMotion, score_of
from hpp_framework.plugins.build import make_option, parse_team
from hpp_framework.plugins.registry import hub
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.errors import ConfigError, SimulatorError, UnknownNameError
from hpp_framework.utils.seeding import EpisodeRng


class Constant(Skill):
    def __init__(self, speed):
        self.speed = speed

    def act(self, observation, goal):
        return torch.tensor([self.speed, 0.0]).expand(len(goal), 2)


class Straight(Predictor):
    """All robots move straight to the goal at one speed, one step per second."""

    def __init__(self, speed, step=1.0):
        self.speed, self.step = speed, step

    def rollout(self, observation, goals, horizon):
        times = torch.arange(1, horizon + 1) * self.step
        start = observation.team_poses[:, None, None, :, :2]
        offset = goals[:, :, None, None] - start
        distance = offset.norm(dim=-1, keepdim=True).clamp(min=1e-6)
        gone = torch.minimum(times[:, None, None] * self.speed, distance)
        positions = start + offset / distance * gone
        return Trajectories(torch.cat([positions, torch.zeros_like(positions[..., :1])], -1), times)


def observe(robots, world, poses):
    with BatchSimulator(robots) as simulator:
        batch = EpisodeBatch(simulator, keyframes=0)
        batch.begin([world] * len(poses), torch.tensor(poses), range(len(poses)))
        return batch.observe(0)


def test_an_option_is_over_at_its_goal_or_when_its_budget_is_spent(fetch, empty_world):
    seen = observe([fetch], empty_world, [[[0.0, 0, 0]], [[0.0, 0, 0]]])
    goal = torch.tensor([[0.2, 0.0], [2.0, 0.0]])
    option = Option(name="x", skill=Constant(0.0), ends=arrived(0.3), budget=7)
    assert option.is_over(seen, goal, 0).tolist() == [True, False]
    assert option.is_over(seen, goal, 7).tolist() == [True, True]
    assert option.is_over(seen, goal, torch.tensor([0, 8])).tolist() == [True, True]
    assert option.may_start(seen, goal).tolist() == [True, True]
    with pytest.raises(ConfigError, match="'budget' must be at least 1"):
        replace(option, budget=0)


def test_a_way_is_clear_if_it_is_seen_and_free(fetch):
    world = World(name="box", bounds=(-6, -6, 6, 6), boxes=(Box(center=(2.0, 0.0), size=(0.4, 1.0)),))
    seen = observe([fetch], world, [[[0.0, 0, 0]]] * 5)
    goals = torch.tensor([[4.0, 0.0], [1.0, 0.0], [3.0, 3.0], [-2.0, 0.0], [0.0, 7.0]])
    # behind the box, before it, beside it, behind the robot, beyond the wall of the room
    assert clear_way(fetch)(seen, goals).tolist() == [False, True, True, False, False]


def test_options_are_made_of_registered_skills_or_by_functions(fetch):
    made = make_option("pure-pursuit", fetch, budget=9)
    assert (made.name, made.budget, made.starts) == ("pure-pursuit", 9, anywhere)
    assert make_option(lambda robot: replace(made, name=robot.name), fetch).name == "fetch"
    with pytest.raises(UnknownNameError, match="pure-pursuit"):
        make_option("pure-pursuitt", fetch)


def test_one_models_motion_of_the_agent_joins_anothers_of_the_rest(pair, empty_world):
    seen = observe(pair, empty_world, [[[0.0, 0, 0], [4.0, 0, 0]]])
    goals = torch.tensor([[[10.0, 0.0]]])
    both = OwnMotion(Straight(1.0), Straight(0.5)).rollout(seen, goals, 2).poses
    torch.testing.assert_close(both[0, 0, :, :, 0], torch.tensor([[0.5, 5.0], [1.0, 6.0]]))
    with pytest.raises(ConfigError, match="same times"):
        OwnMotion(Straight(1.0), Straight(0.5, step=0.2)).rollout(seen, goals, 2)


def chooser(pair, starts, hysteresis=0.1, budget=50):
    task = hub().tasks.create("rendezvous", pair)
    config = OptionsConfig(hysteresis=hysteresis, budget=budget)
    made = [
        Option(name=f"{speed}", skill=Constant(speed), starts=start, budget=budget)
        for speed, start in zip((0.2, 0.8), starts, strict=True)
    ]
    planners = [LatticePlanner(Straight(option.skill.speed), task, config.lattice) for option in made]
    return OptionsPlanner(made, planners, config)


def never(observation, goal):
    return torch.zeros(len(goal), dtype=torch.bool)


@pytest.mark.parametrize(
    ("starts", "speed"), [((anywhere, anywhere), 0.8), ((anywhere, never), 0.2), ((never, never), 0.0)]
)
def test_the_pair_that_scores_best_among_those_that_may_start_drives(pair, empty_world, starts, speed):
    seen = observe(pair, empty_world, [[[-3.0, 0, 0], [3.0, 1, 3]]] * 2)
    planner = chooser(pair, starts)
    agent = HierarchicalAgent(planner, Constant(9.0), ControlStack(), 0)
    agent.reset([0, 1])
    assert agent.act(seen)[:, 0].tolist() == pytest.approx([speed, speed])
    belief = agent.belief
    best = score_of(belief.parts[1]) - score_of(belief.parts[0])
    assert bool((best > 0).all())


def test_a_skill_is_kept_until_another_is_clearly_better_or_its_budget_is_spent(pair, empty_world):
    seen = observe(pair, empty_world, [[[-3.0, 0, 0], [3.0, 1, 3]]])
    planner = chooser(pair, (anywhere, anywhere), hysteresis=100.0, budget=10)
    belief = planner.plan(seen, None, EpisodeRng([0])).belief
    slow = replace(belief, choice=torch.tensor([0]), steps=torch.tensor([0]))
    chosen = []
    for _ in range(2):
        slow = planner.plan(seen, slow, EpisodeRng([0])).belief
        chosen.append(int(slow.choice))
    assert chosen == [0, 1]  # 5 steps are within the budget, 10 are not
    assert int(slow.steps) == 0


def test_the_registered_planner_drives_blindly_only_where_it_sees_the_way(pair):
    context = PlannerContext(
        team=parse_team("fetch,freight"), agent=0, task=hub().tasks.create("rendezvous", pair),
        settings={"lattice.reach": 1.6, "lattice.horizon": 6},
    )  # fmt: skip
    planner = hub().planners.create("hpp-options", context)
    wall = World(name="wall", bounds=(-6, -6, 6, 6), boxes=(Box(center=(0.0, 0.0), size=(0.6, 8.0)),))
    seen = observe(pair, wall, [[[-2.0, 0, 0], [2.0, 0, 3.1]]])
    belief = planner.plan(seen, None, EpisodeRng([0])).belief
    assert planner.options[int(belief.choice)].name == "p2p"
    assert [option.name for option in planner.options] == ["p2p", "pure-pursuit"]
    with pytest.raises(ConfigError, match="every skill needs a predictor"):
        OptionsConfig(skills="p2p,dwa", predictors="far-sighted")


@pytest.fixture
def blind_team():
    return parse_team("fetch,freight", skill="pure-pursuit")


def test_an_environment_lets_an_option_run_until_it_is_over(blind_team):
    quick = Option(name="stand", skill=Constant(0.0), budget=3)
    barred = Option(name="barred", skill=Constant(1.0), starts=never)
    options = ("pure-pursuit", lambda robot: quick, lambda robot: barred)
    config = HierarchyConfig(options=options, budget=40, plan_every=6)
    env = RendezvousEnv(blind_team, world="simple", config=config, teammates="centralized-rp")
    env.reset(seed=1, options={"poses": [[-8, -8, 0.8], [8, 8, 0]]})
    assert env.action_space.shape == (3,)
    goal = (np.array([-3.0, -3.0]) - env.episode.poses[:, :2].mean(0)) / config.reach
    *_, info = env.step(np.array([-1.0, -1.0, -1.0]))
    assert (info["option"], info["started"]) == ("pure-pursuit", True)
    assert 5 < info["steps"] <= 40
    *_, info = env.step(np.array([*goal.clip(-1, 1), 0.0]))
    assert (info["option"], info["steps"]) == ("stand", 3)
    before = env.episode.poses[0]
    *_, info = env.step(np.array([0.0, 0.0, 1.0]))
    assert (info["option"], info["started"], info["steps"]) == ("barred", False, 6)
    assert np.hypot(*(env.episode.poses[0] - before)[:2]) < 0.7
    with pytest.raises(SimulatorError, match="three numbers"):
        env.step(np.zeros(2))


def test_an_option_ends_at_its_goal(blind_team):
    config = HierarchyConfig(options=("pure-pursuit",), budget=60)
    env = RendezvousEnv(blind_team, world="simple", teammates="centralized-rp", config=config)
    assert env.action_space.shape == (2,)
    env.reset(seed=1, options={"poses": [[-1, 0, 0], [5, 0, 0]]})
    *_, info = env.step(np.zeros(2))
    assert info["steps"] < 60
    assert np.hypot(*(env.episode.poses[0, :2] - info["goal"])) <= 0.3
