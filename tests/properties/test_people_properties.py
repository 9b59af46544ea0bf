"""Whatever the room: people keep out of walls, of each other and of robots."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.seeding import numpy_rng
from hpp_framework.worlds.loader import resolve_world
from hpp_framework.worlds.occupancy import free_space
from hpp_framework.worlds.people import populate
from hpp_framework.worlds.spawn import spawn_poses

SKIN = 5e-3


def gap_to_obstacles(world, points: np.ndarray) -> float:
    """Return the least distance from points to boxes, walls and cylinders, exactly."""
    gaps = [np.full(len(points), np.inf)]
    for box in world.solid_boxes():
        cos, sin = np.cos(box.yaw), np.sin(box.yaw)
        dx, dy = (points - np.array(box.center)).T
        local = np.abs([cos * dx + sin * dy, cos * dy - sin * dx]) - np.array(box.size)[:, None] / 2
        gaps.append(np.hypot(*np.maximum(local, 0)) + np.minimum(local.max(0), 0))
    for cylinder in world.cylinders:
        gaps.append(np.hypot(*(points - np.array(cylinder.center)).T) - cylinder.radius)
    return float(np.min(gaps))


@given(
    name=st.sampled_from(["crowd:people=10", "corridor-crowd:people=6", "rooms", "navigation", "passages"]),
    seed=st.integers(0, 10_000),
)
@settings(max_examples=25, deadline=None)
def test_people_keep_off_walls_and_robots(fetch, freight, name, seed):
    robots, rng = [fetch, freight], numpy_rng(seed, "property")
    world = resolve_world(name)(rng)
    start = spawn_poses(world, robots, rng)
    world = populate(world, robots, start, rng, more=0 if world.people else 6)
    with BatchSimulator(robots, threads=1) as simulator:
        state = simulator.reset([world], torch.tensor(start[None], dtype=torch.float32))
        walked = torch.zeros(len(world.people))
        for _ in range(60):
            before = state
            command = torch.tensor(rng.uniform((-0.2, -1.0), (1.0, 1.0), (1, 2, 2)), dtype=torch.float32)
            state = simulator.step(command)
            people = state.people.poses[0]
            assert bool(torch.isfinite(people).all())
            assert gap_to_obstacles(world, people[:, :2].numpy()) > 0.25 - SKIN
            apart = torch.cdist(people[:, :2], state.poses[0, :, :2])
            assert bool((apart > 0.25 + torch.tensor([r.footprint_radius for r in robots]) - 0.02).all())
            moved = (people[:, :2] - before.people.poses[0, :, :2]).norm(dim=-1)
            # at most 1.3 times the speed, and pushed by a neighbour besides
            assert moved.max() < 1.3 * 1.9 * 0.2 + 0.3
            walked += moved
    assert walked.median() > 2


@pytest.mark.parametrize("name", ["navigation", "real-forest", "rooms", "corridor-crowd"])
def test_routes_lie_in_free_space(name):
    world = resolve_world(name)(numpy_rng(0, name))
    world = populate(world, (), np.zeros((0, 2)), numpy_rng(1, name), more=8)
    space = free_space(world, body_height=1.7, resolution=0.05)
    for person in world.people:
        route = np.array([*person.route, person.route[0]])
        for start, end in pairwise(route):
            line = np.linspace(start, end, 2 + int(np.hypot(*(end - start)) / 0.05))
            assert space.at(line).min() > 0.25 - 0.1
