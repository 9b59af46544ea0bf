"""Scripted planners."""

from __future__ import annotations

import pytest
import torch

from hpp_framework.agents.build import AgentConfig, build_agents
from hpp_framework.config.planner_choice import make_planner
from hpp_framework.core.planner import PlannerContext
from hpp_framework.core.types import Observation
from hpp_framework.core.world import Box, World
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.seeding import EpisodeRng

STARTS = torch.tensor([[[0.0, 0.0, 0.0], [-3.0, 3.0, 0.0]]]).repeat(3, 1, 1)
WORLD = World(name="room", bounds=(-6, -6, 6, 6), boxes=(Box(center=(2.0, 0.0), size=(0.5, 2.0)),))


@pytest.fixture(scope="module")
def team():
    return parse_team("fetch,freight")


@pytest.fixture(scope="module")
def sensed(team, begun) -> Observation:
    return begun(team.robots, [WORLD] * 3, STARTS).observe(0)


def make(team, text):
    task = hub().tasks.create("rendezvous", team.robots)
    return make_planner(text, PlannerContext(team=team, agent=0, task=task))


def rng(seed: int = 0) -> EpisodeRng:
    return EpisodeRng(range(seed, seed + 3))


def moved(observation: Observation, place) -> Observation:
    poses = observation.poses.clone()
    poses[:, -1, 0, :2] = place
    return Observation(0, poses, observation.scans, observation.velocity)


def test_a_stubborn_robot_never_gives_up_its_goal(team, sensed):
    given = make(team, "stubborn:x=3:y=-1.5")
    goal = given.plan(sensed, None, rng()).goal
    assert goal.tolist() == [[3.0, -1.5]] * 3
    drawn = make(team, "stubborn")
    first = drawn.plan(sensed, None, rng())
    assert len({tuple(each) for each in first.goal.tolist()}) == 3
    again = drawn.plan(moved(sensed, torch.tensor([5.0, 5.0])), first.belief, rng(1))
    assert torch.equal(first.goal, again.goal)


def test_half_a_goal_is_refused(team):
    with pytest.raises(ConfigError, match="needs both x and y of its goal, or neither"):
        make(team, "stubborn:x=3")


@pytest.mark.parametrize(("loop", "then"), [("true", [0.0, 2.0]), ("false", [4.0, 2.0])])
def test_a_route_goes_from_point_to_point(team, sensed, loop, then):
    planner = make(team, f"route:points=0 2; 4 2:loop={loop}")
    decision = planner.plan(sensed, None, rng())
    assert decision.goal[0].tolist() == [0.0, 2.0]
    far = planner.plan(sensed, decision.belief, rng())
    assert far.goal[0].tolist() == [0.0, 2.0]
    decision = planner.plan(moved(sensed, torch.tensor([0.1, 1.8])), decision.belief, rng())
    assert decision.goal[0].tolist() == [4.0, 2.0]
    decision = planner.plan(moved(sensed, torch.tensor([4.0, 2.2])), decision.belief, rng())
    assert decision.goal[0].tolist() == then


@pytest.mark.parametrize("points", ["''", "1", "1 2 3", "1 a", "1 2;"])
def test_a_route_of_something_else_is_refused(team, points):
    with pytest.raises(ConfigError, match="route"):
        make(team, f"route:points={points}")


def test_places_in_sight_can_be_driven_to_straight(team, sensed):
    planner = make(team, "wander")
    for seed in range(30):
        place = planner.plan(sensed, None, rng(10 * seed)).goal
        x, y = place.unbind(1)
        behind = (x > 1.5) & (y.abs() < x / 2)
        assert not bool(behind.any())
        assert bool((place.abs() < 6 - 0.3).all())
        assert bool((place.norm(dim=1) > 0.5).all())


def test_a_wanderer_goes_elsewhere_once_there_or_out_of_patience(team, sensed):
    planner = make(team, "wander:patience=2")
    first = planner.plan(sensed, None, rng())
    same = planner.plan(sensed, first.belief, rng(10))
    assert torch.equal(first.goal, same.goal)
    there = planner.plan(moved(sensed, first.goal), same.belief, rng(20))
    assert not bool((there.goal == first.goal).all(1).any())
    waiting = planner.plan(sensed, same.belief, rng(30))
    tired = planner.plan(sensed, waiting.belief, rng(40))
    assert not bool((tired.goal == first.goal).all(1).any())


def test_a_change_of_the_team_is_none_of_their_business(team, sensed):
    for text in ("stubborn", "route", "wander"):
        planner = make(team, text)
        belief = planner.plan(sensed, None, rng()).belief
        assert planner.carry_over(belief) is belief


def test_leaders_drive_their_route_and_teammates_rest_at_their_goal(team, play):
    task = hub().tasks.create("rendezvous", team.robots)
    configs = [
        AgentConfig(planner="route:points=0 3; 0 -3", control="safety-filter"),
        AgentConfig(planner="stubborn:x=0:y=3", control="stop-on-success:beyond=0,safety-filter"),
    ]
    agents = build_agents(team, task, configs, WORLD.bounds)
    episodes = play(team, task, [WORLD], STARTS[:1], agents, steps=60)
    assert float((episodes.poses[0, :, 0, :2] - torch.tensor([0.0, 3.0])).norm(dim=1).min()) < 0.7
    assert float((episodes.poses[0, -1, 0, :2] - torch.tensor([0.0, 3.0])).norm()) > 1.0
    assert float((episodes.poses[0, -1, 1, :2] - torch.tensor([0.0, 3.0])).norm()) < 1.0
