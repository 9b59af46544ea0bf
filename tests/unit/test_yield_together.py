"""Two robots that meet brake together, no sooner and no later than the task asks for."""

from __future__ import annotations

import math

import pytest
import torch

from hpp_framework.control.stopping import motion
from hpp_framework.control.yield_together import YieldTogether, YieldTogetherConfig, speeds_now
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import Observation
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import ConfigError

TEAM = parse_team("fetch,freight")
TASK = hub().tasks.create("rendezvous", TEAM.robots)
DECELERATION = [robot.drive.acceleration for robot in TEAM.robots]


def approaching(apart, speeds, *, agent=0, gained=0.0, entries=5):
    """Return what one of two robots knows that have driven at each other, each a little faster every step."""
    poses = torch.zeros(1, entries, 2, 3)
    poses[..., 1, 2] = math.pi
    for robot, (sign, middle) in enumerate(((1, -apart / 2), (-1, apart / 2))):
        place, speed = middle, speeds[robot]
        for entry in range(entries - 1, -1, -1):
            poses[0, entry, robot, 0] = place
            place -= sign * (speed - gained / 2) * CONTROL_PERIOD
            speed -= gained
    velocity = torch.tensor([[speeds[agent], 0.0]])
    return Observation(agent, poses, torch.full((1, entries, 8), 25.0), velocity, None)


def layer(agent=0):
    return YieldTogether(TEAM.robots, agent, TASK)


def halt(speed, deceleration):
    return speed**2 / (2 * deceleration)


def test_far_from_each_other_nothing_is_enough():
    assert layer().enough(approaching(6.0, [0.5, 0.5])).tolist() == [math.inf]


def test_where_full_braking_is_enough_it_is_asked_for():
    speed = 0.6
    seen = approaching(2 * halt(speed, DECELERATION[0]) + 0.8, [speed, speed])
    expected = speed - DECELERATION[0] * CONTROL_PERIOD
    assert layer().enough(seen).item() == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("gained", [0.0, 0.08])
@pytest.mark.parametrize("agent", [0, 1])
def test_between_both_drive_on_just_fast_enough(agent, gained):
    speed = 0.6
    braking_now = halt(speed, DECELERATION[0])
    seen = approaching(2 * braking_now + 2 * TASK.radius + 0.1, [speed, speed], agent=agent, gained=gained)
    enough = layer(agent).enough(seen).item()
    assert speed - DECELERATION[0] * CONTROL_PERIOD < enough < speed + DECELERATION[0] * CONTROL_PERIOD
    driven = (speed + enough) / 2 * CONTROL_PERIOD + halt(enough, DECELERATION[0])
    left = 2 * braking_now + 2 * TASK.radius + 0.1 - 2 * driven
    assert 2 * TASK.radius - 4 * YieldTogetherConfig().short - 0.05 < left < 2 * TASK.radius, (
        "fulfilled, and with little to spare"
    )


def test_both_come_to_the_same_share():
    seen = [approaching(3.0, [0.8, 0.8], agent=agent, gained=0.08) for agent in (0, 1)]
    first, second = (layer(agent).enough(each).item() for agent, each in enumerate(seen))
    assert first == pytest.approx(second, abs=1e-4)


def test_a_pose_off_by_a_hand_does_not_make_a_racer():
    seen = approaching(6.0, [0.5, 0.5])
    seen.poses[0, -1, 1, 0] -= 0.3
    speed = speeds_now(seen, motion(seen)[0], torch.tensor(DECELERATION))[0, 1].item()
    assert speed < 0.5 + 0.3 / (2 * CONTROL_PERIOD) + 2 * DECELERATION[1] * CONTROL_PERIOD


def test_histories_of_one_entry_tell_of_no_motion():
    assert layer().enough(approaching(3.0, [0.0, 0.0], entries=1)).tolist() == [math.inf]


def test_the_speed_is_limited_and_the_turn_rate_left():
    near = approaching(2 * halt(0.6, DECELERATION[0]) + 0.8, [0.6, 0.6])
    wanted, nowhere = torch.tensor([[1.0, -0.7]]), torch.zeros(1, 2)
    enough = layer().enough(near).item()
    assert enough < 1.0
    assert layer().filter(near, nowhere, wanted)[0].tolist() == pytest.approx([enough, -0.7])
    assert torch.equal(layer().filter(approaching(6.0, [0.5, 0.5]), nowhere, wanted), wanted)


@pytest.mark.parametrize("names", ["fetch,freight", "fetch,freight,fetch"])
def test_robots_yield_where_a_task_has_a_terminal_phase(names):
    robots = parse_team(names).robots
    assert YieldTogether(robots, 0, hub().tasks.create("rendezvous", robots)).useful
    assert not YieldTogether(robots, 0, hub().tasks.create("formation", robots)).useful


@pytest.mark.parametrize("wrong", [{"choices": 1}, {"short": -0.1}])
def test_wrong_settings_are_refused(wrong):
    with pytest.raises(ConfigError, match="yield-together needs choices"):
        YieldTogetherConfig(**wrong)
