"""The terminal approach: teams find room around a shared goal, and two that see each other drive together."""

from __future__ import annotations

import math

import pytest
import torch

from hpp_framework.control.terminal_approach import TerminalApproach, TerminalApproachConfig
from hpp_framework.core.world import Box, World
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import ConfigError

ROOM = World(name="room", bounds=(-10.0, -10.0, 10.0, 10.0))


def team_of(count):
    return parse_team(",".join((["fetch", "freight"] * count)[:count]))


def rendezvous(team):
    return hub().tasks.create("rendezvous", team.robots)


def targets(task, goal, poses):
    found = task.targets(goal, poses)
    assert bool(found[..., 2].isnan().all()), "at which robots look anywhere"
    return found[..., :2]


def around(count, radius, turn=0.3) -> torch.Tensor:
    angle = turn + torch.arange(count) * (2 * math.pi / count)
    xy = radius * torch.stack([angle.cos(), angle.sin()], -1)
    return torch.cat([xy, torch.remainder(angle + math.pi, 2 * math.pi)[:, None]], -1)


@pytest.mark.parametrize("count", [3, 4, 5, 6, 7, 8, 12, 16, 32])
def test_all_have_room_on_their_targets_and_succeed_there(count):
    team = team_of(count)
    task = rendezvous(team)
    goal = torch.tensor([[1.0, -2.0]])
    poses = torch.randn(1, count, 3, generator=torch.Generator().manual_seed(count)) * 3
    slots = targets(task, goal, poses)[0]
    apart = torch.cdist(slots, slots) + 9 * torch.eye(count)
    assert (
        float(apart.min())
        > 2 * max(robot.footprint_radius for robot in team.robots) + TerminalApproachConfig().gap
    )
    assert bool(task.success(torch.cat([slots, torch.zeros(count, 1)], -1)))
    assert torch.allclose(slots.mean(0), goal[0], atol=0.02)


def test_two_robots_make_for_the_goal_itself():
    team = team_of(2)
    task = rendezvous(team)
    assert task.targets(torch.zeros(1, 2), torch.zeros(1, 2, 3)) is None
    assert not TerminalApproach(team.robots, 0, task).own_targets


def test_targets_keep_the_order_around_the_goal_and_stay_when_reached():
    task = rendezvous(team_of(6))
    poses = around(6, 4.0)[None]
    goal = torch.tensor([[0.2, 0.1]])
    slots = targets(task, goal, poses)
    before, after = (torch.atan2(each[0, :, 1], each[0, :, 0]) for each in (poses, slots))
    assert float(torch.cos(before - after).min()) > 0.9
    again = targets(task, goal, torch.cat([slots, poses[..., 2:]], -1))
    assert torch.allclose(slots, again, atol=1e-4)


def test_targets_do_not_depend_on_who_asks_or_how_the_world_is_turned():
    task = rendezvous(team_of(8))
    poses = torch.randn(1, 8, 3, generator=torch.Generator().manual_seed(1)) * 3
    goal = torch.tensor([[0.5, 0.5]])
    slots = targets(task, goal, poses)
    order = torch.randperm(8, generator=torch.Generator().manual_seed(2))
    assert torch.allclose(targets(task, goal, poses[:, order]), slots[:, order], atol=1e-5)
    turn = torch.tensor([[0.0, 1.0], [-1.0, 0.0]])
    turned = torch.cat([poses[..., :2] @ turn, poses[..., 2:]], -1)
    assert torch.allclose(targets(task, goal @ turn, turned), slots @ turn, atol=1e-4)


def test_who_arrives_makes_room_for_who_comes_behind():
    task = rendezvous(team_of(5))
    poses = torch.tensor([[[-4.0 - 0.7 * place, 0.0, 0.0] for place in range(5)]])
    slots = targets(task, torch.zeros(1, 2), poses)[0]
    assert int(slots[:, 0].argmax()) == 0
    assert int(slots[:, 0].argmin()) == 4


def test_robots_on_one_point_get_targets_of_their_own():
    task = rendezvous(team_of(3))
    slots = targets(task, torch.zeros(1, 2), torch.zeros(1, 3, 3))[0]
    assert float((torch.cdist(slots, slots) + 9 * torch.eye(3)).min()) > 0.6


def approached(begun, starts, target, world=ROOM):
    """Return the poses of robot 0 as it approaches its target, all others at rest."""
    team = team_of(len(starts))
    batch = begun(team.robots, [world], starts[None])
    layer = TerminalApproach(team.robots, 0, rendezvous(team))
    commands, poses = [], []
    for _ in range(30):
        told = layer.filter(batch.observe(0), target, torch.full((1, 2), -0.01))
        commands.append(told)
        state = batch.step(torch.stack([told, *[torch.zeros(1, 2)] * (len(starts) - 1)], 1))
        poses.append(state.poses[0, 0])
        assert not bool(state.touched_robot.any())
    return torch.stack(poses), torch.cat(commands)


def test_it_ends_on_the_target_between_teammates(begun):
    starts = torch.tensor([[-1.2, 0.0, 0.5], [0.0, 0.7, 0.0], [0.0, -0.7, 0.0], [8.0, 8.0, 0.0]])
    poses, _ = approached(begun, starts, torch.zeros(1, 2))
    assert float(poses[-1, :2].norm()) < 0.05


def test_it_waits_behind_a_teammate(begun):
    starts = torch.tensor([[-1.2, 0.0, 0.0], [-0.2, 0.0, 0.0], [5.0, 0.0, 0.0]])
    poses, _ = approached(begun, starts, torch.zeros(1, 2))
    assert -0.95 < float(poses[-1, 0]) < -0.2 - 0.57


def test_it_leaves_obstacles_to_the_skill(begun):
    wall = World(name="wall", bounds=ROOM.bounds, boxes=(Box(center=(-0.6, 0.0), size=(0.1, 3.0)),))
    starts = torch.tensor([[-1.2, 0.0, 0.0], [5.0, 3.0, 0.0], [5.0, 0.0, 0.0]])
    _, commands = approached(begun, starts, torch.zeros(1, 2), wall)
    assert torch.allclose(commands, torch.tensor(-0.01))


@pytest.mark.parametrize("count", [4, 8])
def test_robots_on_all_sides_gather(play, count):
    team = team_of(count)
    task = rendezvous(team)
    episodes = play(team, task, [ROOM], around(count, 2.5)[None])
    assert int(episodes.done_step[0]) > 0
    assert not bool(episodes.touched_robot[0])


def gathering(begun, starts, goal, world=ROOM):
    """Return where robot 0 takes over and whether it does, when it is told to go somewhere else."""
    team = team_of(len(starts))
    seen = begun(team.robots, [world], starts[None]).observe(0)
    layer = TerminalApproach(team.robots, 0, rendezvous(team))
    target, approaches = layer.target_among(seen, torch.tensor([goal]))
    assert bool(target[:, 2].isnan())
    return target[0, :2], bool(approaches)


def test_robots_that_are_near_gather_around_their_middle_whatever_their_goals(begun):
    starts = around(4, 1.2)
    one, other = (gathering(begun, starts, goal) for goal in ([5.0, 0.3], [-0.3, -6.0]))
    assert one[1]
    assert torch.equal(one[0], other[0])
    slots = targets(rendezvous(team_of(4)), starts[None, :, :2].mean(1), starts[None])
    assert torch.allclose(one[0], slots[0, 0], atol=1e-5)


def test_robots_that_are_far_from_each_other_go_where_they_are_told(begun):
    target, approaches = gathering(begun, around(4, 4.0), [-5.0, 0.3])
    assert not approaches
    assert target.tolist() == pytest.approx([-5.0, 0.3])


def test_robots_gather_beside_what_stands_near_their_middle(begun):
    post = Box(center=(0.0, 0.1), size=(0.2, 0.2))
    world = World(name="post", bounds=ROOM.bounds, boxes=(post,))
    starts = torch.tensor([[-1.6, 0.0, 0.0], [1.6, 0.2, math.pi], [0.0, -1.4, 1.57]])
    target, approaches = gathering(begun, starts, [5.0, 0.3], world)
    open_target, _ = gathering(begun, starts, [5.0, 0.3])
    assert approaches
    assert float(target[1]) < float(open_target[1]) - 0.1


def test_robots_do_not_gather_through_a_wall(begun):
    wall = World(name="wall", bounds=ROOM.bounds, boxes=(Box(center=(0.0, 0.0), size=(0.4, 6.0)),))
    starts = torch.tensor([[-1.0, 0.5, 0.0], [1.0, 0.5, math.pi], [-1.0, -0.5, 0.0], [1.0, -0.5, math.pi]])
    target, approaches = gathering(begun, starts, [0.0, 4.0], wall)
    assert not approaches
    assert target.tolist() == pytest.approx([0.0, 4.0])


@pytest.mark.parametrize("heading", [0.0, 2.0, -1.0])
def test_two_that_hand_over_turn_to_each_other(play, heading):
    team = team_of(2)
    task = hub().tasks.create("handover", team.robots, ids=("a", "b"))
    starts = torch.tensor([[[-1.1, 0.0, heading], [1.1, 0.0, 1.5]]])
    episodes = play(team, task, [ROOM], starts)
    assert 0 < int(episodes.done_step[0]) < 40
    assert not bool(episodes.touched_robot[0])


FAR_FROM_EACH_OTHER = [[-4.0, -0.5, 0.3], [4.0, 0.5, -2.8]]
NEAR_EACH_OTHER = [[-1.3, 0.0, 0.4], [1.3, 0.0, 2.8]]
EMPTY = World(name="room")
WALL = World(name="wall", boxes=(Box(center=(0.0, 0.0), size=(0.2, 3.0)),))


def observed(begun, starts, world=EMPTY):
    """Return the team, and what its first robot knows at its start."""
    team = team_of(len(starts))
    return team, begun(team.robots, [world], [starts]).observe(0)


def layer_of(team):
    return TerminalApproach(team.robots, 0, rendezvous(team))


def test_two_that_see_each_other_drive_at_each_other_whatever_their_skills_want(begun):
    skill, waypoint = torch.tensor([[0.3, 1.0]]), torch.tensor([[-4.0, 3.0]])
    team, seen = observed(begun, [[-4.0, -0.5, 0.1], [4.0, 0.5, -2.8]])
    command = layer_of(team).filter(seen, waypoint, skill)[0]
    assert float(command[0]) == pytest.approx(team.robots[0].drive.speed[1])
    assert abs(float(command[1])) < 0.2, "it faces its mate"
    for starts, world in ((FAR_FROM_EACH_OTHER, WALL), ([*FAR_FROM_EACH_OTHER, [0.0, 5.0, 0.0]], EMPTY)):
        team, seen = observed(begun, starts, world)
        torch.testing.assert_close(layer_of(team).filter(seen, waypoint, skill), skill)


def test_from_afar_two_do_not_slow_down_to_turn_to_each_other(begun):
    team, seen = observed(begun, [[-4.0, -0.5, 1.7], [4.0, 0.5, -2.8]])
    command = layer_of(team).filter(seen, torch.tensor([[-4.0, 3.0]]), torch.zeros(1, 2))[0]
    assert float(command[0]) == pytest.approx(team.robots[0].drive.speed[1])
    assert float(command[1]) < -1.0


def test_near_each_other_two_drive_to_their_middle_and_turn_meanwhile(begun):
    team, seen = observed(begun, NEAR_EACH_OTHER)
    layer = layer_of(team)
    target, near = layer.target_among(seen, torch.tensor([[-9.0, -9.0]]))
    assert bool(near)
    assert target[0, :2].tolist() == pytest.approx([0.0, 0.0], abs=1e-5)
    assert not layer.own_targets
    command = layer.filter(seen, torch.tensor([[-9.0, -9.0]]), torch.zeros(1, 2))[0]
    assert command[0] > 0
    assert command[1] < 0, "it looks to the left of its mate"


def test_a_wall_before_the_other_counts_as_much_as_one_before_oneself(begun):
    beside = World(name="wall", boxes=(Box(center=(0.75, 0.0), size=(0.1, 3.0)),))
    team, seen = observed(begun, NEAR_EACH_OTHER, beside)
    assert not bool(layer_of(team).target_among(seen, torch.tensor([[-9.0, -9.0]]))[1])


def test_two_have_no_targets_of_their_own(begun):
    team, seen = observed(begun, [[-4.0, -0.5, 0.3], [4.0, 0.5, -2.8]], WALL)
    assert not bool(layer_of(team).target_among(seen, seen.pose[:, :2])[1])


@pytest.mark.parametrize("task", ["handover", "formation", "dispersion", "region"])
def test_tasks_in_which_two_do_not_meet_anywhere_send_no_robot_to_the_other(begun, task):
    team, seen = observed(begun, FAR_FROM_EACH_OTHER)
    objective = hub().tasks.create(task, team.robots)
    skill = torch.tensor([[0.3, 1.0]])
    layer = TerminalApproach(team.robots, 0, objective)
    assert torch.equal(layer.filter(seen, torch.tensor([[-4.0, 3.0]]), skill), skill)


@pytest.mark.parametrize("count", [2, 3])
def test_formations_are_left_to_the_skill(count):
    robots = team_of(count).robots
    assert not TerminalApproach(robots, 0, hub().tasks.create("formation", robots)).useful


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"near": -1.0}, "near must be 0 m or more"), ({"gap": math.inf}, "gap must be 0 m or more"),
        ({"slows": 1.6}, "slow down before it stops"), ({"careful": 0.0}, "careful is a share above 0"),
    ],
)  # fmt: skip
def test_wrong_settings_are_refused(wrong, words):
    with pytest.raises(ConfigError, match=words):
        TerminalApproachConfig(**wrong)
