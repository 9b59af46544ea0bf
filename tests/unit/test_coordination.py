"""How teams get along, on tracks drawn by hand."""

from __future__ import annotations

import math

import pytest
import torch

from hpp_framework.evaluation.coordination import coordination
from hpp_framework.evaluation.rollout import Episodes

FAR = [(9.0, 0.0)]
"""A goal that both robots share."""


def episode(tracks, goals, *, done=-1):
    """Return one episode: a track of (x, y) per robot, and a row of (x, y) goals per robot, one per step."""
    poses = torch.zeros(1, len(tracks[0]), len(tracks), 3)
    poses[0, :, :, :2] = torch.tensor(tracks).transpose(0, 1)
    return Episodes(
        poses=poses, goals=torch.tensor(goals).transpose(0, 1)[None], done_step=torch.tensor([done]),
        contact_step=torch.tensor([-1]), touched_obstacle=torch.tensor([False]),
        touched_robot=torch.tensor([False]), plan_seconds=[],
    )  # fmt: skip


def at_rest(goals, *, starts=((0.0, 0.0), (4.0, 0.0)), done=-1):
    """Return how robots that stand get along with their goals."""
    return coordination(episode([[start] * (len(goals[0]) + 1) for start in starts], goals, done=done))


def moving(*tracks, done=-1):
    """Return how robots that share a goal get along on their tracks."""
    return coordination(episode(tracks, [FAR * (len(tracks[0]) - 1)] * len(tracks), done=done))


def test_goals_agree_from_the_step_after_which_they_never_differ():
    own = [(2.0, 0.0)] * 5
    found = at_rest([own, [(2.0, 3.0), (2.0, 0.0), (2.0, 1.0), (2.0, 0.4), (2.0, 0.0)]])
    assert float(found.agreement) == pytest.approx(3 * 0.2)
    assert float(found.goal_gap) == pytest.approx((3 + 0 + 1 + 0.4 + 0) / 5)


def test_goals_that_differ_in_the_end_never_agreed():
    own = [(2.0, 0.0)] * 3
    assert math.isnan(float(at_rest([own, [(2.0, 0.0), (2.0, 0.0), (2.0, 0.6)]]).agreement))
    assert float(at_rest([own, own]).agreement) == 0


def test_what_comes_after_success_does_not_count():
    own, other = [(2.0, 1.0)] * 4, [(2.0, 1.0), (2.0, 1.0), (2.0, -3.0), (2.0, -3.0)]
    found = at_rest([own, other], done=2)
    assert float(found.agreement) == float(found.goal_gap) == float(found.side_flips) == 0
    assert math.isnan(float(at_rest([own, other]).agreement))


def test_every_pair_must_agree():
    starts = ((0.0, 0.0), (4.0, 0.0), (2.0, 4.0))
    found = at_rest([[(2.0, 0.0)] * 2, [(2.0, 0.4)] * 2, [(2.0, 0.8)] * 2], starts=starts)
    assert math.isnan(float(found.agreement))
    assert float(found.goal_gap) == pytest.approx((0.4 + 0.8 + 0.4) / 3)


def test_a_lone_robot_agrees_with_itself():
    found = coordination(episode([[(0.0, 0.0), (1.0, 0.0)]], [[(5.0, 2.0)]]))
    assert [float(value) for value in vars(found).values()] == [0, 0, 0, 0]


def test_a_flip_is_a_change_from_one_side_to_the_other():
    """Left of the line to the other is y > 0 for the first robot; in between it keeps its side."""
    calm = [(2.0, 0.0)] * 6
    left, between, right = (2.0, 1.0), (2.0, -0.3), (2.0, -1.0)
    assert int(at_rest([[left, between, left, between, between, left], calm]).side_flips) == 0
    assert int(at_rest([[left, between, between, right, between, right], calm]).side_flips) == 1
    assert int(at_rest([[left, right, between, left, between, right], calm]).side_flips) == 3
    assert int(at_rest([[between, between, right, right, right, right], calm]).side_flips) == 0


def test_flips_of_all_robots_are_added():
    turns = [(2.0, 1.0), (2.0, -1.0)]
    assert int(at_rest([turns, turns]).side_flips) == 2


def test_sides_are_of_the_line_between_starts_not_of_the_world():
    """The line is x = y; both goals lie above the x axis, the first left of the line, the second right."""
    turns, calm = [(1.0, 3.0), (3.0, 1.0)], [(2.0, 2.0)] * 2
    assert int(at_rest([turns, calm], starts=((0.0, 0.0), (4.0, 4.0))).side_flips) == 1
    along = [(1.0, 1.4), (3.0, 2.6)]  # 0.28 m left, 0.28 m right
    assert int(at_rest([along, calm], starts=((0.0, 0.0), (4.0, 4.0))).side_flips) == 0


def test_following_at_equal_speed_is_all_chase():
    assert float(moving([(0.0, 0.0), (1.0, 0.0)], [(3.0, 0.0), (4.0, 0.0)]).chase) == pytest.approx(1)
    assert float(moving([(1.0, 0.0), (0.0, 0.0)], [(4.0, 0.0), (3.0, 0.0)]).chase) == pytest.approx(1)


def test_meeting_and_parting_are_no_chase():
    assert float(moving([(0.0, 0.0), (1.0, 0.0)], [(4.0, 0.0), (3.0, 0.0)]).chase) == 0
    assert float(moving([(1.0, 0.0), (0.0, 0.0)], [(3.0, 0.0), (4.0, 0.0)]).chase) == 0
    assert float(moving([(0.0, 0.0), (0.0, 0.0)], [(4.0, 0.0), (4.0, 0.0)]).chase) == 0


def test_side_by_side_is_no_chase():
    assert float(moving([(0.0, 0.0), (1.0, 0.0)], [(0.0, 3.0), (1.0, 3.0)]).chase) == 0


def test_the_slower_of_two_sets_the_chase():
    """The first drives 3 m after the second, which gets away 1 m: 2 * 1 of 4 m."""
    assert float(moving([(0.0, 0.0), (3.0, 0.0)], [(5.0, 0.0), (6.0, 0.0)]).chase) == pytest.approx(0.5)


def test_chase_is_weighed_by_the_way_driven():
    """A step of 1 m after each other, then a step of 2 m towards each other: 2 of 2 m, 0 of 4 m."""
    found = moving([(0.0, 0.0), (1.0, 0.0), (3.0, 0.0)], [(9.0, 0.0), (10.0, 0.0), (8.0, 0.0)])
    assert float(found.chase) == pytest.approx(2 / 6)
    alone = moving([(0.0, 0.0), (1.0, 0.0), (3.0, 0.0)], [(9.0, 0.0), (10.0, 0.0), (8.0, 0.0)], done=1)
    assert float(alone.chase) == pytest.approx(1)


def test_only_what_lies_along_the_line_is_chase():
    """Both drive at 45 degrees to the line between them: 1 m of sqrt(2) m each."""
    found = moving([(0.0, 0.0), (1.0, 1.0)], [(4.0, 0.0), (5.0, 1.0)])
    assert float(found.chase) == pytest.approx(1 / math.sqrt(2))
