"""Stop on success: robots brake in time to rest together, and skills do not slow down before that."""

from __future__ import annotations

import pytest
import torch

from hpp_framework.control.stop_on_success import StopOnSuccess, StopOnSuccessConfig
from hpp_framework.core.types import Observation
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import ConfigError

TEAM = parse_team("fetch,freight")
NOWHERE = torch.zeros(1, 2)


def layer(*, halts=True, **config):
    task = hub().tasks.create("rendezvous", TEAM.robots)
    task.halts = halts
    return StopOnSuccess(task, TEAM.robots, StopOnSuccessConfig(**config))


def seen(gap, speed, aside=0.0, turn=0.0):
    """Return what one of two robots knows that rush at each other."""
    poses = torch.zeros(1, 5, 2, 3)
    steps = torch.arange(-4, 1) * 0.2 * speed
    poses[0, :, 0, 0], poses[0, :, 1, 0] = steps, gap - steps
    poses[0, :, 0, 2], poses[0, :, 1, 2] = aside, torch.pi + aside
    return Observation(0, poses, torch.ones(1, 5, 222), torch.tensor([[speed, turn]]))


def test_robots_brake_in_time_to_rest_together():
    """Two robots that rush at each other begin to brake before they are close."""
    stops = layer().stops
    assert not bool(stops(seen(4.0, 1.0)))
    assert bool(stops(seen(3.0, 1.0)))
    assert not bool(stops(seen(2.5, 0.2)))
    assert bool(stops(seen(0.9, 0.0)))
    # headed away from each other, unless the first turns back in time
    assert not bool(stops(seen(2.0, 1.0, aside=0.9)))
    assert bool(stops(seen(2.0, 1.0, aside=0.9, turn=-1.63)))


def test_a_robot_that_stops_is_sent_no_motion_unless_the_task_keeps_it_moving():
    wanted = torch.tensor([[0.7, -0.3]])
    assert layer().filter(seen(3.0, 1.0), NOWHERE, wanted).tolist() == [[0.0, 0.0]]
    assert torch.equal(layer().filter(seen(4.0, 1.0), NOWHERE, wanted), wanted)
    assert torch.equal(layer(halts=False).filter(seen(3.0, 1.0), NOWHERE, wanted), wanted)


def at_the_origin(count):
    return Observation(0, torch.zeros(count, 5, 2, 3), torch.ones(count, 5, 222), torch.zeros(count, 2))


def test_skills_are_sent_beyond_a_shared_goal_until_they_are_there():
    goal = torch.tensor([[3.0, -4.0], [0.3, -0.4], [3.0, -4.0]])
    own = goal + torch.tensor([[0.0, 0.0], [0.0, 0.0], [0.5, 0.0]])
    sent_to = torch.tensor([[3.6, -4.8], [0.3, -0.4], [3.5, -4.0]])
    torch.testing.assert_close(layer(beyond=1.0).redirect(at_the_origin(3), goal, own), sent_to)
    assert torch.equal(layer(beyond=0.0).redirect(at_the_origin(3), goal, own), own)
    assert torch.equal(layer(halts=False).redirect(at_the_origin(3), goal, own), own)


def test_a_robot_on_its_goal_is_sent_there():
    assert layer().redirect(at_the_origin(1), NOWHERE, NOWHERE).tolist() == [[0.0, 0.0]]


@pytest.mark.parametrize("wrong", [{"beyond": -1.0}, {"arrived": float("nan")}])
def test_wrong_settings_are_refused(wrong):
    with pytest.raises(ConfigError, match="stop-on-success needs beyond >= 0"):
        StopOnSuccessConfig(**wrong)
