"""The task means what it says."""

from __future__ import annotations

import pytest
import torch
from my_pkg.meet_at_door import DOOR

from hpp_framework.plugins.registry import hub
from hpp_framework.testing import check_task


@pytest.fixture
def task():
    team = [hub().robots.create("fetch"), hub().robots.create("freight")]
    return hub().tasks.create("my-pkg/meet-at-door", team)


def team_at(*places):
    """Return the poses of a team in one episode, all facing along x."""
    return torch.tensor([[[x, y, 0.0] for x, y in places]])


def test_it_is_a_sound_task():
    check_task("my-pkg/meet-at-door")


def test_nearer_to_the_door_is_better_until_everybody_is_there(task):
    x, y = DOOR
    rewards = [task.reward(team_at((x + away, y), (x, y + away))).item() for away in (4.0, 2.0, 0.5)]
    assert rewards == sorted(rewards)
    assert rewards[-1] == 0.0


def test_it_is_done_when_everybody_rests_there(task):
    x, y = DOOR
    there, one_away = team_at((x + 0.5, y), (x - 0.5, y)), team_at((x, y), (x + 3.0, y))
    resting, driving = torch.zeros(1, 2, 2), torch.ones(1, 2, 2)
    assert task.success(there, resting).all()
    assert not task.success(there, driving).any()
    assert not task.success(one_away, resting).any()
