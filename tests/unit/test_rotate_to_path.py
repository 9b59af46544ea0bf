"""Rotate to path: robots turn round where the path on their local map begins behind them."""

from __future__ import annotations

import math

import pytest
import torch

from hpp_framework.control.rotate_to_path import RotateToPath, RotateToPathConfig
from hpp_framework.core.types import Keyframes, Observation
from hpp_framework.utils.errors import ConfigError

CONFIG = RotateToPathConfig()


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


def waypoint(robot, seen, goal):
    return RotateToPath(robot).redirect(seen, goal, goal)


def test_a_goal_ahead_is_left_to_the_skill(fetch):
    for goal in (torch.tensor([[1.0, -1.0]]), torch.tensor([[3.5, 3.0]])):
        torch.testing.assert_close(waypoint(fetch, before_a_wall(fetch, 0.0), goal), goal)


def test_a_robot_is_sent_back_where_its_path_begins_behind(fetch):
    goal = torch.tensor([[-5.0, 0.0]])
    torch.testing.assert_close(waypoint(fetch, before_a_wall(fetch, math.pi), goal), goal)
    back = waypoint(fetch, before_a_wall(fetch, 0.0), goal)[0]
    assert back.norm() == pytest.approx(CONFIG.back, abs=0.2)
    assert back[0] < 0


@pytest.mark.parametrize(
    ("came", "sent"), [(CONFIG.under_way - 0.1, CONFIG.back), (CONFIG.under_way + 0.1, CONFIG.beginning)]
)
def test_a_robot_under_way_is_sent_to_the_beginning_of_its_path_back(fetch, came, sent):
    seen = before_a_wall(fetch, 0.0)
    poses = seen.poses[:, :1].repeat(1, CONFIG.since, 1, 1)
    poses[:, 0, 0, 0] -= came
    keyframes = Keyframes(poses, seen.scans[:, :1].repeat(1, CONFIG.since, 1))
    seen = Observation(0, seen.poses, seen.scans, seen.velocity, keyframes)
    back = waypoint(fetch, seen, torch.tensor([[-5.0, 0.0]]))[0]
    assert back.norm() == pytest.approx(sent, abs=0.2)
    assert back[0] < 0


def test_a_robot_under_way_turns_to_a_path_beside_it(fetch):
    seen, goal = before_a_wall(fetch, 0.0), torch.tensor([[-1.5, -3.0]])
    torch.testing.assert_close(waypoint(fetch, seen, goal), goal)
    poses = seen.poses[:, :1].repeat(1, CONFIG.since, 1, 1)
    poses[:, 0, 0, 0] -= 2 * CONFIG.under_way
    keyframes = Keyframes(poses, seen.scans[:, :1].repeat(1, CONFIG.since, 1))
    seen = Observation(0, seen.poses, seen.scans, seen.velocity, keyframes)
    assert waypoint(fetch, seen, goal)[0].norm() == pytest.approx(CONFIG.beginning, abs=0.2)


def test_the_path_counts_and_not_where_the_goal_lies(fetch):
    """Looking to the left along the wall with the goal behind it, ahead: round the wall's end is behind."""
    seen = before_a_wall(fetch, math.pi)
    remembered = before_a_wall(fetch, math.pi / 2)
    keyframes = Keyframes(remembered.poses[:, :1], remembered.scans[:, :1])
    seen = Observation(0, seen.poses, seen.scans, seen.velocity, keyframes)
    goal = torch.tensor([[-0.5, 3.0]])
    back = waypoint(fetch, seen, goal)[0]
    assert back[0] > 0.9, "towards the open end"
    assert back[1] < 1.5, "on this side"


def test_the_waypoint_counts_and_not_the_goal_of_the_team(fetch):
    seen, own = before_a_wall(fetch, 0.0), torch.tensor([[1.0, -1.0]])
    behind = torch.tensor([[-5.0, 0.0]])
    torch.testing.assert_close(RotateToPath(fetch).redirect(seen, behind, own), own)


@pytest.mark.parametrize("wrong", [{"beginning": 0.0}, {"back": 0.5}, {"since": 0}])
def test_wrong_settings_are_refused(wrong):
    with pytest.raises(ConfigError, match="rotate-to-path needs 0 < beginning < back"):
        RotateToPathConfig(**wrong)
