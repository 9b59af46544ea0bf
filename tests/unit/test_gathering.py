"""Large teams find room: spots around a shared goal, and docking into them."""

from __future__ import annotations

import math

import pytest
import torch

from hpp_framework.control.safety_filter import Guard
from hpp_framework.control.terminal_approach import GAP, Docking
from hpp_framework.core.disturbances import NoiseModel
from hpp_framework.core.world import Box, World
from hpp_framework.evaluation.rollout import build_agents, run_episodes
from hpp_framework.perception.sensing import Sensing
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import hub
from hpp_framework.sim.batch.simulator import BatchSimulator

ROOM = World(name="room", bounds=(-10.0, -10.0, 10.0, 10.0))


def team_of(count):
    return parse_team(",".join((["fetch", "freight"] * count)[:count]))


def rendezvous(team):
    return hub().tasks.create("rendezvous", team.robots)


def around(count, radius, turn=0.3) -> torch.Tensor:
    angle = turn + torch.arange(count) * (2 * math.pi / count)
    xy = radius * torch.stack([angle.cos(), angle.sin()], -1)
    return torch.cat([xy, torch.remainder(angle + math.pi, 2 * math.pi)[:, None]], -1)


@pytest.mark.parametrize("count", [3, 4, 5, 6, 7, 8, 12, 16, 32])
def test_everybody_has_room_on_its_spot_and_has_met_there(count):
    team = team_of(count)
    task = rendezvous(team)
    goal = torch.tensor([[1.0, -2.0]])
    poses = torch.randn(1, count, 3, generator=torch.Generator().manual_seed(count)) * 3
    spots = task.parking(goal, poses)[0]
    apart = torch.cdist(spots, spots) + 9 * torch.eye(count)
    assert float(apart.min()) > 2 * max(robot.footprint_radius for robot in team.robots) + GAP
    assert bool(task.met(torch.cat([spots, torch.zeros(count, 1)], -1)))
    assert torch.allclose(spots.mean(0), goal[0], atol=0.02)


def test_two_robots_make_for_the_goal_itself():
    team = team_of(2)
    task = rendezvous(team)
    assert task.parking(torch.zeros(1, 2), torch.zeros(1, 2, 3)) is None
    agents = build_agents(team, "centralized-mp", task)
    assert [agent.docking for agent in agents] == [None, None]


def test_spots_keep_the_order_around_the_goal_and_stay_when_reached():
    task = rendezvous(team_of(6))
    poses = around(6, 4.0)[None]
    goal = torch.tensor([[0.2, 0.1]])
    spots = task.parking(goal, poses)
    before, after = (torch.atan2(each[0, :, 1], each[0, :, 0]) for each in (poses, spots))
    assert float(torch.cos(before - after).min()) > 0.9
    again = task.parking(goal, torch.cat([spots, poses[..., 2:]], -1))
    assert torch.allclose(spots, again, atol=1e-4)


def test_spots_do_not_depend_on_who_asks_or_how_the_world_is_turned():
    task = rendezvous(team_of(8))
    poses = torch.randn(1, 8, 3, generator=torch.Generator().manual_seed(1)) * 3
    goal = torch.tensor([[0.5, 0.5]])
    spots = task.parking(goal, poses)
    order = torch.randperm(8, generator=torch.Generator().manual_seed(2))
    assert torch.allclose(task.parking(goal, poses[:, order]), spots[:, order], atol=1e-5)
    turn = torch.tensor([[0.0, 1.0], [-1.0, 0.0]])
    turned = torch.cat([poses[..., :2] @ turn, poses[..., 2:]], -1)
    assert torch.allclose(task.parking(goal @ turn, turned), spots @ turn, atol=1e-4)


def test_who_arrives_makes_room_for_who_comes_behind():
    task = rendezvous(team_of(5))
    poses = torch.tensor([[[-4.0 - 0.7 * place, 0.0, 0.0] for place in range(5)]])
    spots = task.parking(torch.zeros(1, 2), poses)[0]
    assert int(spots[:, 0].argmax()) == 0
    assert int(spots[:, 0].argmin()) == 4


def test_robots_on_one_point_get_spots_of_their_own():
    task = rendezvous(team_of(3))
    spots = task.parking(torch.zeros(1, 2), torch.zeros(1, 3, 3))[0]
    assert float((torch.cdist(spots, spots) + 9 * torch.eye(3)).min()) > 0.6


def docked(starts, spot, world=ROOM):
    """Return the poses of robot 0 as it docks, all others standing."""
    team = team_of(len(starts))
    sensing = Sensing(team.robots, NoiseModel(), torch.Generator())
    simulator = BatchSimulator(team.robots)
    sensing.reset(simulator.reset([world], starts[None]))
    docking = Docking(team.robots, 0, Guard(team.robots[0]), rendezvous(team))
    commands, poses = [], []
    for _ in range(30):
        told = docking(sensing.observe(0), spot, torch.full((1, 2), -0.01))
        commands.append(told)
        state = simulator.step(torch.stack([told, *[torch.zeros(1, 2)] * (len(starts) - 1)], 1))
        sensing.update(state)
        poses.append(state.poses[0, 0])
        assert not bool(state.touched_robot.any())
    return torch.stack(poses), torch.cat(commands)


def test_docking_ends_on_the_spot_between_teammates():
    starts = torch.tensor([[-1.2, 0.0, 0.5], [0.0, 0.7, 0.0], [0.0, -0.7, 0.0], [8.0, 8.0, 0.0]])
    poses, _ = docked(starts, torch.zeros(1, 2))
    assert float(poses[-1, :2].norm()) < 0.05


def test_docking_waits_behind_a_teammate():
    starts = torch.tensor([[-1.2, 0.0, 0.0], [-0.2, 0.0, 0.0], [5.0, 0.0, 0.0]])
    poses, _ = docked(starts, torch.zeros(1, 2))
    assert -0.95 < float(poses[-1, 0]) < -0.2 - 0.57


def test_docking_leaves_obstacles_to_the_skill():
    wall = World(name="wall", bounds=ROOM.bounds, boxes=(Box(center=(-0.6, 0.0), size=(0.1, 3.0)),))
    starts = torch.tensor([[-1.2, 0.0, 0.0], [5.0, 3.0, 0.0], [5.0, 0.0, 0.0]])
    _, commands = docked(starts, torch.zeros(1, 2), wall)
    assert torch.allclose(commands, torch.tensor(-0.01))


def test_agents_that_heed_nobody_do_not_dock():
    team = team_of(3)
    assert all(agent.docking is None for agent in build_agents(team, "stubborn", rendezvous(team)))


@pytest.mark.parametrize("count", [4, 8])
def test_robots_on_all_sides_gather(count):
    team = team_of(count)
    task = rendezvous(team)
    agents = build_agents(team, "centralized-mp", task)
    episodes = run_episodes(BatchSimulator(team.robots), [ROOM], around(count, 2.5)[None], agents, task)
    assert int(episodes.done_step[0]) > 0
    assert not bool(episodes.touched_robot[0])


def gathering(starts, goal, world=ROOM):
    """Return where robot 0 docks and whether it does, when it is told to go somewhere else."""
    team = team_of(len(starts))
    sensing = Sensing(team.robots, NoiseModel(), torch.Generator())
    sensing.reset(BatchSimulator(team.robots).reset([world], starts[None]))
    docking = Docking(team.robots, 0, Guard(team.robots[0]), rendezvous(team))
    stance, docks = docking.stance_among(sensing.observe(0), torch.tensor([goal]))
    assert bool(stance[:, 2].isnan())
    return stance[0, :2], bool(docks)


def test_robots_that_are_near_gather_around_their_middle_whatever_their_goals():
    starts = around(4, 1.2)
    one, other = (gathering(starts, goal) for goal in ([5.0, 0.3], [-0.3, -6.0]))
    assert one[1]
    assert torch.equal(one[0], other[0])
    spots = rendezvous(team_of(4)).parking(starts[None, :, :2].mean(1), starts[None])
    assert torch.allclose(one[0], spots[0, 0], atol=1e-5)


def test_robots_that_are_far_from_each_other_go_where_they_are_told():
    spot, docks = gathering(around(4, 4.0), [-5.0, 0.3])
    assert not docks
    assert spot.tolist() == pytest.approx([-5.0, 0.3])


def test_robots_gather_beside_what_stands_near_their_middle():
    post = Box(center=(0.0, 0.1), size=(0.2, 0.2))
    world = World(name="post", bounds=ROOM.bounds, boxes=(post,))
    starts = torch.tensor([[-1.6, 0.0, 0.0], [1.6, 0.2, math.pi], [0.0, -1.4, 1.57]])
    spot, docks = gathering(starts, [5.0, 0.3], world)
    open_spot, _ = gathering(starts, [5.0, 0.3])
    assert docks
    assert float(spot[1]) < float(open_spot[1]) - 0.1


def test_robots_do_not_gather_through_a_wall():
    wall = World(name="wall", bounds=ROOM.bounds, boxes=(Box(center=(0.0, 0.0), size=(0.4, 6.0)),))
    starts = torch.tensor([[-1.0, 0.5, 0.0], [1.0, 0.5, math.pi], [-1.0, -0.5, 0.0], [1.0, -0.5, math.pi]])
    spot, docks = gathering(starts, [0.0, 4.0], wall)
    assert not docks
    assert spot.tolist() == pytest.approx([0.0, 4.0])


@pytest.mark.parametrize("heading", [0.0, 2.0, -1.0])
def test_two_that_hand_over_turn_to_each_other(heading):
    team = team_of(2)
    task = hub().tasks.create("handover", team.robots, ids=("a", "b"))
    starts = torch.tensor([[[-1.1, 0.0, heading], [1.1, 0.0, 1.5]]])
    agents = build_agents(team, "centralized-mp", task)
    episodes = run_episodes(BatchSimulator(team.robots), [ROOM], starts, agents, task)
    assert 0 < int(episodes.done_step[0]) < 40
    assert not bool(episodes.touched_robot[0])
