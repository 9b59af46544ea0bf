"""Contact in the batch simulator: stop, slide, push, never pass through."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from hpp_framework.core.world import Box, Cylinder, World
from hpp_framework.sim.batch.simulator import BatchSimulator

SKIN = 2e-3
"""Metres that a robot may be pressed into what it touches."""


def drive(robots, world: World, poses, command, steps: int) -> list:
    """Return the states of one episode under a constant command per robot."""
    simulator = BatchSimulator(robots)
    states = [simulator.reset([world], torch.tensor([poses], dtype=torch.float32))]
    for _ in range(steps):
        states.append(simulator.step(torch.tensor([command], dtype=torch.float32)))
    return states


def wall(yaw: float = 0.0, *, base: float = 0.0) -> World:
    box = Box(center=(2.5, 0.0), size=(1.0, 12.0), yaw=yaw, base=base)
    return World(name="wall", bounds=(-10, -10, 10, 10), walled=False, boxes=(box,))


def gap(world: World, point: np.ndarray) -> float:
    """Return the distance from a point to the nearest obstacle, negative inside."""
    gaps = [math.inf]
    for box in world.solid_boxes():
        cos, sin = math.cos(box.yaw), math.sin(box.yaw)
        dx, dy = point - np.array(box.center)
        local = np.abs([cos * dx + sin * dy, cos * dy - sin * dx]) - np.array(box.size) / 2
        gaps.append(float(np.hypot(*np.maximum(local, 0)) + min(local.max(), 0)))
    gaps += [math.dist(point, c.center) - c.radius for c in world.cylinders]
    return min(gaps)


def test_head_on_it_stops_at_its_footprint(fetch):
    states = drive([fetch], wall(), [(0, 0, 0)], [(1.0, 0.0)], 40)
    last = states[-1]
    assert last.poses[0, 0].tolist() == pytest.approx([2.0 - fetch.footprint_radius, 0, 0], abs=SKIN)
    assert abs(last.velocities[0, 0, 0].item()) < 0.02
    assert bool(last.collided[0, 0])
    assert bool(last.touched_obstacle[0, 0])
    assert not bool(last.touched_robot[0, 0])


def test_it_collides_when_it_arrives_and_not_before(fetch):
    states = drive([fetch], wall(), [(0, 0, 0)], [(1.0, 0.0)], 40)
    reach = 2.0 - fetch.footprint_radius
    for state in states:
        if state.poses[0, 0, 0].item() < reach - 0.01:
            assert not bool(state.collided[0, 0])
    assert not bool(states[0].collided[0, 0])


def test_a_parked_robot_beside_a_wall_has_not_collided(fetch):
    world = wall()
    states = drive([fetch], world, [(2.0 - fetch.footprint_radius - 0.01, 0, 0)], [(0.0, 0.0)], 5)
    assert not any(bool(state.collided.any()) for state in states)


def test_at_an_angle_it_slides(fetch):
    angle = math.radians(10)
    last = drive([fetch], wall(), [(1.6, -4.0, math.pi / 2 - angle)], [(1.0, 0.0)], 60)[-1]
    assert last.poses[0, 0, 0].item() == pytest.approx(2.0 - fetch.footprint_radius, abs=SKIN)
    assert last.poses[0, 0, 1].item() > -1.5
    assert last.poses[0, 0, 2].item() == pytest.approx(math.pi / 2 - angle, abs=1e-5)
    # the contact takes sin^2 of the speed each substep, the motor gives 0.01 m/s on average
    assert last.velocities[0, 0, 0].item() == pytest.approx(0.01 / math.tan(angle) ** 2, rel=0.05)


def test_the_steeper_the_slower_it_slides(fetch):
    def slid(degrees: float) -> float:
        heading = math.pi / 2 - math.radians(degrees)
        return drive([fetch], wall(), [(1.6, -4.0, heading)], [(1.0, 0.0)], 50)[-1].poses[0, 0, 1].item() + 4

    assert slid(5) > slid(15) > slid(45) > 0


def test_it_frees_itself_by_turning_away(fetch):
    simulator = BatchSimulator([fetch])
    simulator.reset([wall()], torch.tensor([[[1.6, 0.0, 0.0]]]))
    for _ in range(10):
        simulator.step(torch.tensor([[[1.0, 0.0]]]))
    for _ in range(12):
        simulator.step(torch.tensor([[[0.0, 1.5]]]))
    for _ in range(15):
        state = simulator.step(torch.tensor([[[1.0, 0.0]]]))
    assert state.poses[0, 0, 0].item() < 1.5
    assert not bool(state.collided[0, 0])


def test_the_heavier_robot_yields_less(fetch, freight):
    # nose to nose in the middle, the same command for both
    states = drive([fetch, freight], _empty(), [(-0.6, 0, 0), (0.6, 0, math.pi)], [(1.0, 0.0)] * 2, 40)
    positions = states[-1].poses[0, :, 0]
    touch = fetch.footprint_radius + freight.footprint_radius
    assert (positions[1] - positions[0]).item() == pytest.approx(touch, abs=0.01)
    assert bool(states[-1].collided.all())


def test_one_robot_pushes_another_out_of_its_way(fetch, freight):
    states = drive([fetch, freight], _empty(), [(0, 0, 0), (1, 0, 0)], [(1.0, 0.0), (0.0, 0.0)], 30)
    early, late = states[-10].poses[0, 1, 0].item(), states[-1].poses[0, 1, 0].item()
    assert late > early > 1.0
    assert late > 1.05
    assert bool(states[-1].collided.all())
    assert bool(states[-1].touched_robot.all())
    assert not any(bool(state.touched_obstacle.any()) for state in states)


def test_a_robot_pushed_against_a_wall_holds_the_other(fetch, freight):
    world = wall()
    states = drive([fetch, freight], world, [(0, 0, 0), (1.3, 0, 0)], [(1.0, 0.0), (0.0, 0.0)], 40)
    first, second = states[-1].poses[0, :, 0].tolist()
    assert second <= 2.0 - freight.footprint_radius + 0.02
    assert second - first >= fetch.footprint_radius + freight.footprint_radius - 0.02


def test_the_low_robot_drives_under_what_stops_the_tall_one(fetch, freight):
    table = wall(base=0.5)
    start, command = [(0, 0, 0)], [(1.0, 0.0)]
    tall = drive([fetch], table, start, command, 40)[-1]
    low = drive([freight], table, start, command, 40)[-1]
    assert tall.poses[0, 0, 0].item() == pytest.approx(2.0 - fetch.footprint_radius, abs=SKIN)
    assert bool(tall.collided[0, 0])
    assert low.poses[0, 0, 0].item() > 3.5
    assert not bool(low.collided[0, 0])


def test_a_mixed_team_each_meets_what_is_at_its_height(fetch, freight):
    last = drive([fetch, freight], wall(base=0.5), [(0, -2, 0), (0, 2, 0)], [(1.0, 0.0)] * 2, 40)[-1]
    assert last.poses[0, 0, 0].item() < 1.8
    assert last.poses[0, 1, 0].item() > 3.5


def test_cylinders_stop_and_deflect(fetch):
    world = dataclasses.replace(_empty(), cylinders=(Cylinder(center=(2, 0), radius=0.5),))
    last = drive([fetch], world, [(0, 0, 0)], [(1.0, 0.0)], 30)[-1]
    assert last.poses[0, 0, 0].item() == pytest.approx(1.5 - fetch.footprint_radius, abs=SKIN)
    past = drive([fetch], world, [(0, 0.7, 0)], [(1.0, 0.0)], 60)[-1]
    assert past.poses[0, 0, 0].item() > 2.0
    assert past.poses[0, 0, 1].item() > 0.75


obstacles = st.lists(
    st.builds(
        lambda x, y, w, d, yaw: Box(center=(x, y), size=(w, d), yaw=yaw),
        st.floats(1.2, 3.0), st.floats(-2.5, 2.5), st.floats(0.1, 1.5), st.floats(0.1, 1.5),
        st.floats(-3.1, 3.1),
    ),
    min_size=1, max_size=4,
)  # fmt: skip


@settings(max_examples=25, deadline=None)
@given(obstacles, st.floats(-3.1, 3.1), st.integers(0, 2**31))
def test_robots_never_enter_obstacles_or_each_other(pair, boxes, heading, seed):
    """Two robots driven at random in a small walled room stay outside everything they could touch."""
    world = World(
        name="room",
        bounds=(-3.5, -3, 3.5, 3),
        boxes=tuple(boxes),
        cylinders=(Cylinder(center=(-2.6, 0.0), radius=0.2),),
    )
    simulator = BatchSimulator(pair)
    state = simulator.reset([world], torch.tensor([[[-1.2, -0.8, heading], [-1.2, 0.8, -heading]]]))
    rng = np.random.default_rng(seed)
    reach = pair[0].footprint_radius
    for _ in range(12):
        command = torch.tensor(rng.uniform((0.2, -3), (1.5, 3), (1, 2, 2)), dtype=torch.float32)
        for _ in range(5):
            state = simulator.step(command)
            spots = state.poses[0, :, :2].double().numpy()
            wedged = any(gap(world, spot) < reach + 0.01 for spot in spots)
            # between a wall and a robot that presses, the discs give a little
            allowed = 0.02 if wedged and math.dist(*spots) < 2 * reach + 0.01 else 0.001
            assert min(gap(world, spot) for spot in spots) > reach - allowed
            assert math.dist(*spots) > 2 * reach - allowed


def _empty() -> World:
    return World(name="empty", bounds=(-10, -10, 10, 10), walled=False)
