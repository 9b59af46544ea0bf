"""The worlds of reports and the walls for tuning: one world a seed, all reachable, robots kept apart."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from hpp_framework.core.world import Box, World
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import ConfigError
from hpp_framework.worlds.generators.recipe import one_region
from hpp_framework.worlds.generators.walls import walls
from hpp_framework.worlds.loader import resolve_world
from hpp_framework.worlds.occupancy import free_space
from hpp_framework.worlds.spawn import spawn_poses

HELD_OUT = ("u-trap", "two-doors", "l-room", "maze")
ALL = (*HELD_OUT, "walls")
SEEDS = range(12)
each_world = pytest.mark.parametrize("name", ALL)


@cache
def _world(name: str, seed: int) -> World:
    return resolve_world(name)(np.random.default_rng(seed))


def _between(world: World, poses: np.ndarray) -> np.ndarray:
    """Return the distance to obstacles along the straight line between two robots."""
    line = poses[0, :2] + np.linspace(0, 1, 101)[:, None] * (poses[1, :2] - poses[0, :2])
    return free_space(world, body_height=1.1).at(line)


@each_world
def test_a_state_of_the_generator_gives_one_world(name):
    first, second = np.random.default_rng(3), np.random.default_rng(3)
    assert resolve_world(name)(first) == resolve_world(name)(second)
    assert first.integers(2**32) == second.integers(2**32)
    assert len({_world(name, seed) for seed in SEEDS}) == len(SEEDS)


@each_world
def test_all_of_it_can_be_reached(name):
    assert all(one_region(_world(name, seed), 0.15) for seed in SEEDS)


@each_world
def test_robots_start_five_metres_apart_and_differ(name, fetch, freight):
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        first, second = (spawn_poses(_world(name, seed), [fetch, freight], rng) for _ in range(2))
        assert np.hypot(*(first[0] - first[1])[:2]) == pytest.approx(5.0)
        assert not np.allclose(first, second)


@pytest.mark.parametrize("name", [name for name in ALL if name != "maze"])
def test_something_stands_between_the_robots(name, fetch, freight):
    leads = []
    for seed in SEEDS:
        poses = spawn_poses(_world(name, seed), [fetch, freight], np.random.default_rng(seed))
        assert _between(_world(name, seed), poses).min() == 0
        leads.append(poses[0, 0] > poses[1, 0])
    assert set(leads) == {True, False} or name == "walls"


@pytest.mark.parametrize("name", HELD_OUT)
def test_held_out_worlds_say_so(name):
    assert "held out" in hub().worlds.entry(name).summary


def test_a_robot_starts_in_the_trap_or_before_it(fetch, freight):
    """Three walls of four around it, or none."""
    walled_in = set()
    for seed in SEEDS:
        world = _world("u-trap", seed)
        back = world.boxes[0]
        poses = spawn_poses(world, [fetch, freight], np.random.default_rng(seed))
        turn = np.array([np.cos(back.yaw), np.sin(back.yaw)])
        depths = (poses[:, :2] - np.array(back.center)) @ turn
        assert depths.min() < -0.8
        walled_in.add(bool(depths.max() < world.boxes[1].size[0]))
    assert walled_in == {True, False}


def test_passages_of_mazes_and_doors_are_wide_enough():
    for seed in SEEDS:
        for name in ("maze", "two-doors"):
            space = free_space(_world(name, seed), body_height=1.1, resolution=0.05)
            assert space.regions(0.6).max() == 1


def test_harder_walls_are_longer():
    def length(difficulty: float) -> float:
        worlds = [walls(np.random.default_rng(seed), difficulty=difficulty) for seed in SEEDS]
        return float(np.mean([sum(box.size[0] for box in world.boxes) for world in worlds]))

    assert length(0.0) + 3 < length(1.0)
    lengths = [box.size[0] for seed in SEEDS for box in _world("walls", seed).boxes]
    assert 3 <= min(lengths) <= max(lengths) <= 10


def test_walls_that_leave_no_room_are_refused(monkeypatch):
    with pytest.raises(ConfigError, match="from 0"):
        walls(np.random.default_rng(0), difficulty=2.0)
    closed = World(name="walls", boxes=(Box(center=(0, 0), size=(1, 25)),))
    monkeypatch.setattr("hpp_framework.worlds.generators.walls._layout", lambda rng, difficulty: closed)
    with pytest.raises(ConfigError, match="hung together"):
        walls(np.random.default_rng(0))
