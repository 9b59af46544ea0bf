"""Planners of partners and strangers."""

from __future__ import annotations

import pytest
import torch

from hpp_framework.config.planner_choice import make_planner
from hpp_framework.core.disturbances import NoiseModel
from hpp_framework.core.planner import PlannerContext
from hpp_framework.core.types import Observation
from hpp_framework.core.world import Box, World
from hpp_framework.evaluation.rollout import build_agents, run_episodes
from hpp_framework.perception.sensing import Sensing
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import hub
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.seeding import torch_rng

STARTS = torch.tensor([[[0.0, 0.0, 0.0], [-3.0, 3.0, 0.0]]]).repeat(3, 1, 1)
WORLD = World(name="room", bounds=(-6, -6, 6, 6), boxes=(Box(center=(2.0, 0.0), size=(0.5, 2.0)),))


@pytest.fixture(scope="module")
def team():
    return parse_team("fetch,freight")


@pytest.fixture(scope="module")
def sensed(team) -> Observation:
    sensing = Sensing(team.robots, NoiseModel(), torch_rng(0, "none"))
    sensing.reset(BatchSimulator(team.robots).reset([WORLD] * 3, STARTS))
    return sensing.observe(0)


def make(team, text):
    task = hub().tasks.create("rendezvous", team.robots)
    return make_planner(text, PlannerContext(team=team, agent=0, task=task))


def moved(observation: Observation, place) -> Observation:
    poses = observation.poses.clone()
    poses[:, -1, 0, :2] = place
    return Observation(0, poses, observation.scans, observation.velocity)


def test_a_stubborn_robot_never_gives_up_its_goal(team, sensed):
    given = make(team, "stubborn:x=3:y=-1.5")
    goal, belief = given.plan(sensed, None, torch_rng(0, "a"))
    assert goal.tolist() == [[3.0, -1.5]] * 3
    drawn = make(team, "stubborn")
    goal, belief = drawn.plan(sensed, None, torch_rng(0, "a"))
    assert len({tuple(each) for each in goal.tolist()}) == 3
    again, _ = drawn.plan(moved(sensed, torch.tensor([5.0, 5.0])), belief, torch_rng(1, "b"))
    assert torch.equal(goal, again)


def test_half_a_goal_is_refused(team):
    with pytest.raises(ConfigError, match="needs both x and y of its goal, or neither"):
        make(team, "stubborn:x=3")


@pytest.mark.parametrize(("loop", "then"), [("true", [0.0, 2.0]), ("false", [4.0, 2.0])])
def test_a_route_goes_from_point_to_point(team, sensed, loop, then):
    planner = make(team, f"route:points=0 2; 4 2:loop={loop}")
    goal, belief = planner.plan(sensed, None, torch_rng(0, "a"))
    assert goal[0].tolist() == [0.0, 2.0]
    far, _ = planner.plan(sensed, belief, torch_rng(0, "a"))
    assert far[0].tolist() == [0.0, 2.0]
    goal, belief = planner.plan(moved(sensed, torch.tensor([0.1, 1.8])), belief, torch_rng(0, "a"))
    assert goal[0].tolist() == [4.0, 2.0]
    goal, belief = planner.plan(moved(sensed, torch.tensor([4.0, 2.2])), belief, torch_rng(0, "a"))
    assert goal[0].tolist() == then


@pytest.mark.parametrize("points", ["''", "1", "1 2 3", "1 a", "1 2;"])
def test_a_route_of_something_else_is_refused(team, points):
    with pytest.raises(ConfigError, match="route"):
        make(team, f"route:points={points}")


def test_places_in_sight_can_be_driven_to_straight(team, sensed):
    planner = make(team, "wander")
    for seed in range(30):
        place, _ = planner.plan(sensed, None, torch_rng(seed, "a"))
        x, y = place.unbind(1)
        behind = (x > 1.5) & (y.abs() < x / 2)
        assert not bool(behind.any())
        assert bool((place.abs() < 6 - 0.3).all())
        assert bool((place.norm(dim=1) > 0.5).all())


def test_a_wanderer_goes_elsewhere_once_there_or_out_of_patience(team, sensed):
    planner = make(team, "wander:patience=2")
    first, belief = planner.plan(sensed, None, torch_rng(0, "a"))
    same, belief = planner.plan(sensed, belief, torch_rng(1, "a"))
    assert torch.equal(first, same)
    there, _ = planner.plan(moved(sensed, first), belief, torch_rng(2, "a"))
    assert not bool((there == first).all(1).any())
    _, belief = planner.plan(sensed, belief, torch_rng(3, "a"))
    tired, _ = planner.plan(sensed, belief, torch_rng(4, "a"))
    assert not bool((tired == first).all(1).any())


def test_leaders_drive_their_route_and_do_not_rest_where_the_team_meets(team):
    task = hub().tasks.create("rendezvous", team.robots)
    leader = build_agents(team, "route:points=0 3; 0 -3", task)[0]
    teammate = build_agents(team, "stubborn:x=0:y=3", task)[1]
    assert leader.rest is None
    assert teammate.rest is not None
    with BatchSimulator(team.robots) as simulator:
        episodes = run_episodes(simulator, [WORLD], STARTS[:1], [leader, teammate], task, steps=60)
    assert float((episodes.poses[0, :, 0, :2] - torch.tensor([0.0, 3.0])).norm(dim=1).min()) < 0.7
    assert float((episodes.poses[0, -1, 1, :2] - torch.tensor([0.0, 3.0])).norm()) < 1.0
