"""The robot drives as its numbers say, in a team with another."""

from __future__ import annotations

import pytest
import torch

from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.world import World
from hpp_framework.plugins.build import parse_team
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.testing import check_robot


def test_it_drives_as_fast_as_its_limits_allow():
    team = parse_team("my-pkg/sample-rover,fetch")
    robot = team.robots[0]
    steps = round(2 * robot.drive.speed[1] / robot.drive.acceleration / CONTROL_PERIOD)
    with BatchSimulator(team.robots) as simulator:
        world = World(name="open", bounds=(-20, -20, 20, 20), walled=False)
        simulator.reset([world], torch.tensor([[[0.0, 0.0, 0.0], [0.0, 5.0, 0.0]]]))
        for _ in range(steps):
            state = simulator.step(torch.tensor([[[99.0, 0.0], [0.0, 0.0]]]))
    assert state.velocities[0, 0, 0].item() == pytest.approx(robot.drive.speed[1], rel=1e-3)
    assert not state.collided.any()


def test_its_numbers_can_be_true():
    check_robot("my-pkg/sample-rover")
    (robot,) = parse_team("my-pkg/sample-rover").robots
    assert robot.sources
