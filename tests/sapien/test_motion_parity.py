"""Both simulators move robots alike: in free space, along walls, into walls, into each other."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
import trimesh

from hpp_framework.core.geometry import wrap_angle
from hpp_framework.core.world import Box, Cylinder, Mesh, World
from hpp_framework.plugins.registry import hub
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.seeding import numpy_rng
from hpp_framework.worlds.loader import resolve_world
from hpp_framework.worlds.occupancy import free_space
from hpp_framework.worlds.scans.real_room import LAYOUTS
from hpp_framework.worlds.spawn import spawn_poses

sapien = pytest.importorskip("hpp_framework.sim.sapien.simulator")

pytestmark = pytest.mark.sapien

OPEN = World(name="open", walled=False)
FREE_SPACE = 0.01
"""Metres after 20 s of free driving: the batch simulator's steps of 0.05 s against ticks of 0.01 s."""
CONTACT = 0.02
"""Metres after contact: in PhysX a robot is a prism of 32 sides, 0.7 mm off the disc."""


def robots():
    return [hub().robots.create("fetch"), hub().robots.create("freight")]


def drive_both(team, world, poses, commands):
    """Run commands (t, n, 2) in both; return the largest errors, who collided in each, and the last state."""
    simulators = [BatchSimulator(team), sapien.SapienSimulator(team)]
    start = torch.tensor([poses], dtype=torch.float32)
    states = [simulator.reset([world], start) for simulator in simulators]
    collided = [state.collided for state in states]
    distance = angle = 0.0
    for command in torch.as_tensor(commands, dtype=torch.float32):
        states = [simulator.step(command[None]) for simulator in simulators]
        collided = [before | state.collided for before, state in zip(collided, states, strict=True)]
        error = states[0].poses - states[1].poses
        distance = max(distance, error[..., :2].norm(dim=-1).max().item())
        angle = max(angle, wrap_angle(error[..., 2]).abs().max().item())
    torch.testing.assert_close(states[0].velocities, states[1].velocities, atol=0.02, rtol=0)
    return distance, angle, [c[0].tolist() for c in collided], states[1]


def constant(command, steps):
    return [command] * steps


def test_curved_drive_in_free_space():
    commands = [
        [[0.6 + 0.4 * math.sin(i / 7), 1.2 * math.sin(i / 5)], [0.8, 0.9 * math.cos(i / 6)]]
        for i in range(100)
    ]
    distance, angle, collided, _ = drive_both(robots(), OPEN, [[-4, -4, 0.3], [4, 4, -2.0]], commands)
    assert distance < FREE_SPACE
    assert angle < 1e-4
    assert collided == [[False, False], [False, False]]


def test_commands_beyond_the_limits_are_limited_alike():
    commands = [[[5.0, 9.0], [-5.0, -9.0]] if i % 20 < 10 else [[0.0, -9.0], [2.0, 9.0]] for i in range(60)]
    distance, _, _, state = drive_both(robots(), OPEN, [[-4, -4, 0.3], [4, 4, -2.0]], commands)
    assert distance < FREE_SPACE
    assert state.velocities[..., 0].abs().max() <= 1.0


def test_reverse_drive():
    fetch = robots()[0]
    reverse = replace(fetch, drive=replace(fetch.drive, speed=(-0.6, 1.0)))
    wall = World(name="wall", walled=False, boxes=(Box(center=(-2.0, 0.0), size=(0.2, 4.0)),))
    distance, _, collided, state = drive_both([reverse], wall, [[0, 0, 0]], constant([[-1.0, 0.0]], 30))
    assert distance < CONTACT
    assert collided == [[True], [True]]
    assert state.poses[0, 0, 0].item() == pytest.approx(-1.9 + fetch.footprint_radius, abs=2e-3)


@pytest.mark.parametrize("index", [0, 1])
def test_head_on_stop(index):
    wall = World(name="wall", walled=False, boxes=(Box(center=(2.0, 0.0), size=(0.2, 8.0)),))
    robot = robots()[index]
    distance, _, collided, state = drive_both([robot], wall, [[0, 0, 0]], constant([[1.0, 0.0]], 40))
    assert distance < CONTACT
    assert collided == [[True], [True]]
    assert state.poses[0, 0, 0].item() == pytest.approx(1.9 - robot.footprint_radius, abs=2e-3)
    assert abs(state.velocities[0, 0, 0].item()) < 1e-3


@pytest.mark.parametrize("slant", [0.1, 0.4, 0.8, 1.2])
def test_slide_along_a_wall(slant):
    wall = World(name="wall", walled=False, boxes=(Box(center=(2.0, 0.0), size=(0.2, 20.0)),))
    heading = math.pi / 2 - slant
    distance, _, collided, state = drive_both(
        robots()[:1], wall, [[1.2, -8, heading]], constant([[1.0, 0.0]], 60)
    )
    assert distance < CONTACT
    assert collided == [[True], [True]]
    assert state.poses[0, 0, 1] > -7.9


def test_slide_off_a_pillar():
    world = World(name="pillar", walled=False, cylinders=(Cylinder(center=(2.0, 0.15), radius=0.4),))
    distance, _, collided, _ = drive_both(robots()[:1], world, [[0, 0, 0]], constant([[1.0, 0.0]], 30))
    assert distance < CONTACT
    assert collided == [[True], [True]]


def test_push_a_standing_robot():
    commands = constant([[1.0, 0.0], [0.0, 0.0]], 20)
    distance, _, collided, state = drive_both(robots(), OPEN, [[0, 0, 0], [1.2, 0.05, 1.5]], commands)
    assert distance < CONTACT
    assert collided == [[True, True], [True, True]]
    assert state.poses[0, 1, 0] > 1.25


def test_they_agree_on_who_was_touched():
    """One robot drives against a wall while the other drives into it from behind."""
    wall = World(name="wall", walled=False, boxes=(Box(center=(2, 0), size=(1, 8)),))
    simulators = [BatchSimulator(robots()), sapien.SapienSimulator(robots())]
    start = torch.tensor([[[0.9, 0.0, 0.0], [-0.3, 0.0, 0.0]]])
    states = [simulator.reset([wall], start) for simulator in simulators]
    told = []
    for _ in range(20):
        states = [simulator.step(torch.tensor([[[1.0, 0.0], [1.0, 0.0]]])) for simulator in simulators]
        told.append([(s.touched_obstacle[0].tolist(), s.touched_robot[0].tolist()) for s in states])
    assert told[-1] == [([True, False], [True, True])] * 2
    alone = [first for first, second in told if first == second and first == ([True, False], [False, False])]
    assert alone


def test_two_robots_meet_head_on():
    commands = constant([[1.0, 0.0], [1.0, 0.0]], 30)
    distance, _, collided, state = drive_both(robots(), OPEN, [[0, 0, 0], [2, 0, math.pi]], commands)
    assert distance < CONTACT
    assert collided == [[True, True], [True, True]]
    # the heavier one gives way less
    assert (state.poses[0, :, 0].mean() - 1.0).item() > 0


def test_heights_decide_what_is_touched():
    fetch, freight = robots()
    table = World(name="table", walled=False, boxes=(Box(center=(2, 0), size=(1, 8), base=0.7, height=0.05),))
    for robot, stops in ((fetch, True), (freight, False)):
        distance, _, collided, state = drive_both([robot], table, [[0, 0, 0]], constant([[1.0, 0.0]], 30))
        assert distance < CONTACT
        assert collided == [[stops], [stops]]
        assert (state.poses[0, 0, 0].item() < 1.3) == stops


def test_a_mesh_stops_robots_from_both_sides(tmp_path):
    sheet = trimesh.Trimesh([[0, -2, 0], [0, 2, 0], [0, 2, 1], [0, -2, 1]], [[0, 1, 2], [0, 2, 3]])
    sheet.export(tmp_path / "sheet.ply")
    world = World(name="sheet", walled=False, meshes=(Mesh(file=tmp_path / "sheet.ply"),))
    commands = constant([[1.0, 0.0], [1.0, 0.0]], 30)
    distance, _, collided, state = drive_both(robots(), world, [[-2, 1, 0], [2, -1, math.pi]], commands)
    assert distance < CONTACT
    assert collided == [[True, True], [True, True]]
    torch.testing.assert_close(state.poses[0, :, 0].abs(), torch.full((2,), 0.2877), atol=5e-3, rtol=0)


@pytest.mark.parametrize("name", LAYOUTS)
def test_scanned_rooms_stop_robots_alike_and_let_none_through(name):
    """No robot leaves the part of the room that it began in, in either simulator."""
    world, rng, episodes = resolve_world(name)(np.random.default_rng(0)), numpy_rng(1, name), 6
    start = np.stack([spawn_poses(world, robots(), rng) for _ in range(episodes)])
    simulators = [BatchSimulator(robots()), sapien.SapienSimulator(robots())]
    for simulator in simulators:
        simulator.reset([world] * episodes, torch.tensor(start, dtype=torch.float32))
    space = free_space(world, body_height=robots()[0].height, resolution=0.025)
    # a few centimetres of overlap are left to robots that press
    labels = space.regions(0.2)
    collided = torch.zeros(2, episodes, 2, dtype=torch.bool)
    for _ in range(4):
        speeds = rng.uniform((0.3, -0.8), (1.0, 0.8), (episodes, 2, 2))
        for _ in range(15):
            states = [simulator.step(torch.tensor(speeds, dtype=torch.float32)) for simulator in simulators]
            collided |= torch.stack([state.collided for state in states])
            for state in states:
                now = space.look_up(labels, state.poses[..., :2].numpy())
                assert (now == space.look_up(labels, start[..., :2])).all()
    assert collided.any(dim=(1, 2)).all()
    assert (collided[0] == collided[1]).float().mean() > 0.9


def test_a_floor_that_is_not_level_is_driven_over(tmp_path):
    side = 17
    x, y = (part.ravel() for part in np.meshgrid(np.linspace(-4, 4, side), np.linspace(-4, 4, side)))
    points = np.column_stack([x, y, numpy_rng(0, "floor").uniform(-0.02, 0.04, len(x))])
    low = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    faces = np.stack([low, low + 1, low + side + 1, low, low + side + 1, low + side], -1).reshape(-1, 3)
    trimesh.Trimesh(points, faces).export(tmp_path / "floor.ply")
    world = World(name="floor", walled=False, meshes=(Mesh(file=tmp_path / "floor.ply"),))
    commands = constant([[1.0, 0.0], [1.0, 0.0]], 20)
    distance, _, collided, state = drive_both(robots(), world, [[-3, 1, 0], [3, -1, math.pi]], commands)
    assert distance < FREE_SPACE
    assert collided == [[False, False], [False, False]]
    assert state.poses[0, 0, 0] > -1.0
