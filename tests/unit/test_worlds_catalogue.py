"""The catalogue keeps what its worlds promise: starts apart, a wall between, wide paths in the clutter."""

import math

import numpy as np
import pytest

from hpp_framework.plugins.registry import hub
from hpp_framework.worlds.loader import resolve_world
from hpp_framework.worlds.occupancy import free_space
from hpp_framework.worlds.spawn import spawn_poses

NAMES = ("training", "simple", "wall", "navigation")


@pytest.fixture
def robots():
    return [hub().robots.create("fetch"), hub().robots.create("freight")]


@pytest.mark.parametrize("name", NAMES)
def test_starts_are_five_metres_apart_in_the_open_and_differ(name, robots):
    rng = np.random.default_rng(0)
    world = resolve_world(name)(rng)
    space = free_space(world, body_height=1.1)
    starts = [spawn_poses(world, robots, rng) for _ in range(10)]
    for poses in starts:
        assert np.hypot(*(poses[0] - poses[1])[:2]) == pytest.approx(5.0)
        assert space.at(poses[:, :2]).min() > robots[0].footprint_radius
    assert not np.allclose(starts[0], starts[1])


def test_wall_stands_between_the_robots(robots):
    rng = np.random.default_rng(1)
    world = resolve_world("wall")(rng)
    sides = set()
    for _ in range(20):
        poses = spawn_poses(world, robots, rng)
        assert poses[0, 0] > 2
        assert poses[1, 0] < -2
        (x0, y0), (x1, y1) = poses[:, :2]
        crossing = y0 + (y1 - y0) * x0 / (x0 - x1)
        # at least 2 m from both ends of the wall, now nearer to this one and now to that
        assert abs(crossing) < 2
        sides.add(crossing > 0)
    assert sides == {True, False}


def test_navigation_has_wide_ways_to_everywhere_and_hides_pairs():
    world = resolve_world("navigation")(np.random.default_rng(0))
    assert 25 <= len(world.boxes) + len(world.cylinders) <= 40
    space = free_space(world, body_height=1.1)
    assert space.regions(0.6).max() == 1
    rng = np.random.default_rng(2)
    start = space.sample(space.distance > 0.44, 2000, rng)
    angle = rng.uniform(-math.pi, math.pi, 2000)
    end = start + 5 * np.stack([np.cos(angle), np.sin(angle)], -1)
    pairs = space.at(end) > 0.44
    line = start[pairs, None] + np.linspace(0, 1, 51)[:, None] * (end - start)[pairs, None]
    assert (space.at(line).min(1) < 0.29).mean() > 0.85
