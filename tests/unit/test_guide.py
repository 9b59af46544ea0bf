"""The guide: way-points on the way that an agent's chart shows."""

from __future__ import annotations

import math

import pytest
import torch

from hpp_framework.agents.hierarchical import make_agent
from hpp_framework.config.planner_choice import parse_planner
from hpp_framework.control.rotate_to_path import BACK, BEGINNING, BEYOND, SINCE, UNDER_WAY, Guide
from hpp_framework.core.skill import Skill
from hpp_framework.core.types import Keyframes, Observation
from hpp_framework.plugins.registry import hub


def before_a_wall(robot, heading):
    """Return a robot at the origin that sees a wall along y = 1.5 m, which ends at x = 3 m."""
    angles = torch.from_numpy(robot.lidar.angles()).float() + heading
    x = robot.lidar.mount[0] * math.cos(heading)
    y = robot.lidar.mount[0] * math.sin(heading)
    away = (1.5 - y) / angles.sin()
    hit = (away > 0) & (away < robot.lidar.max_range) & (x + away * angles.cos() < 3.0)
    scan = torch.where(hit, away, robot.lidar.max_range)
    poses = torch.tensor([[0.0, 0.0, heading], [0.0, -9.0, -math.pi / 2]]).expand(1, 5, 2, 3)
    return Observation(0, poses, scan.expand(1, 5, -1), torch.zeros(1, 2))


def test_a_goal_ahead_is_left_to_the_skill(fetch):
    for goal in (torch.tensor([[1.0, -1.0]]), torch.tensor([[3.5, 3.0]])):
        torch.testing.assert_close(Guide(fetch)(before_a_wall(fetch, 0.0), goal), goal)


def test_skills_are_sent_beyond_a_place_to_meet_until_they_are_there(fetch):
    goals = torch.tensor([[3.0, -4.0], [0.3, -0.4], [3.0, -4.0], [-5.0, 0.0]])
    sent_to = torch.tensor([[3.6, -4.8], [0.3, -0.4], [3.0, -4.0]])
    one = before_a_wall(fetch, 0.0)
    seen = Observation(
        0, one.poses.expand(4, -1, -1, -1), one.scans.expand(4, -1, -1), one.velocity.expand(4, 2)
    )
    waypoints = Guide(fetch, beyond=1.0)(seen, goals, torch.tensor([False, False, True, False]))
    torch.testing.assert_close(waypoints[:3], sent_to)
    assert waypoints[3].norm() == pytest.approx(BACK, abs=0.2), "a way back is no goal to run through"
    torch.testing.assert_close(
        Guide(fetch, beyond=0.0)(seen, goals, torch.zeros(4, dtype=torch.bool))[0], goals[0]
    )


def test_a_robot_is_sent_back_where_the_way_begins_behind(fetch):
    goal = torch.tensor([[-5.0, 0.0]])
    torch.testing.assert_close(Guide(fetch)(before_a_wall(fetch, math.pi), goal), goal)
    back = Guide(fetch)(before_a_wall(fetch, 0.0), goal)[0]
    assert back.norm() == pytest.approx(BACK, abs=0.2)
    assert back[0] < 0


@pytest.mark.parametrize(("came", "sent"), [(UNDER_WAY - 0.1, BACK), (UNDER_WAY + 0.1, BEGINNING)])
def test_a_robot_under_way_is_sent_to_the_beginning_of_its_way_back(fetch, came, sent):
    seen = before_a_wall(fetch, 0.0)
    poses = seen.poses[:, :1].repeat(1, SINCE, 1, 1)
    poses[:, 0, 0, 0] -= came
    keyframes = Keyframes(poses, seen.scans[:, :1].repeat(1, SINCE, 1))
    seen = Observation(0, seen.poses, seen.scans, seen.velocity, keyframes)
    back = Guide(fetch)(seen, torch.tensor([[-5.0, 0.0]]))[0]
    assert back.norm() == pytest.approx(sent, abs=0.2)
    assert back[0] < 0


def test_a_robot_under_way_turns_to_a_way_beside_it(fetch):
    seen, goal = before_a_wall(fetch, 0.0), torch.tensor([[-1.5, -3.0]])
    torch.testing.assert_close(Guide(fetch)(seen, goal), goal)
    poses = seen.poses[:, :1].repeat(1, SINCE, 1, 1)
    poses[:, 0, 0, 0] -= 2 * UNDER_WAY
    keyframes = Keyframes(poses, seen.scans[:, :1].repeat(1, SINCE, 1))
    seen = Observation(0, seen.poses, seen.scans, seen.velocity, keyframes)
    assert Guide(fetch)(seen, goal)[0].norm() == pytest.approx(BEGINNING, abs=0.2)


def test_the_way_counts_and_not_where_the_goal_lies(fetch):
    """Looking to the left along the wall with the goal behind it, ahead: round the wall's end is behind."""
    seen = before_a_wall(fetch, math.pi)
    remembered = before_a_wall(fetch, math.pi / 2)
    keyframes = Keyframes(remembered.poses[:, :1], remembered.scans[:, :1])
    seen = Observation(0, seen.poses, seen.scans, seen.velocity, keyframes)
    goal = torch.tensor([[-0.5, 3.0]])
    back = Guide(fetch)(seen, goal)[0]
    assert back[0] > 0.9, "towards the open end"
    assert back[1] < 1.5, "on this side"


def test_agents_drive_to_the_way_point_and_keep_the_goal(fetch, freight, fixed_goal):
    task = hub().tasks.create("rendezvous", [fetch, freight])
    seen = before_a_wall(fetch, 0.0)

    class Notes(Skill):
        def act(self, observation, goal):
            self.goal = goal
            return torch.zeros(1, 2)

    for guide in (True, False):
        skill = Notes()
        agent = make_agent(
            0, skill, fixed_goal(-5.0, 0.0), task, [fetch, freight], 0, guard=False, guide=guide
        )
        agent.act(seen)
        assert agent.goal.tolist() == [[-5.0, 0.0]]
        assert (skill.goal.tolist() == [[-5.0, 0.0]]) is not guide


@pytest.mark.parametrize("halts", [True, False])
def test_only_who_rests_may_run_through_a_goal(fetch, freight, halts, fixed_goal):
    task = hub().tasks.create("rendezvous", [fetch, freight])
    task.halts = halts
    agent = make_agent(
        0, hub().skills.create("p2p", fetch), fixed_goal(-5.0, 0.0), task, [fetch, freight], 0, guide=True
    )
    agent.plan(before_a_wall(fetch, math.pi))
    expected = [[-5.0 - BEYOND, 0.0]] if halts else [[-5.0, 0.0]]
    torch.testing.assert_close(agent.waypoint, torch.tensor(expected), atol=1e-4, rtol=0)


def test_planners_say_whether_agents_have_a_guide(fetch, freight, fixed_goal):
    task = hub().tasks.create("rendezvous", [fetch, freight])
    assert (
        make_agent(
            0, hub().skills.create("p2p", fetch), fixed_goal(-5.0, 0.0), task, [fetch, freight], 0
        ).guide
        is None
    )
    assert parse_planner("hpp").guide is None
    assert parse_planner("hpp:guide=false").guide is False
    assert parse_planner("centralized-oa:guide=true").guide is True
