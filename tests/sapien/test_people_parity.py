"""People walk alike, are seen alike and block alike in both simulators."""

import numpy as np
import pytest
import torch

from hpp_framework.core.world import MovingObstacle, Person, World
from hpp_framework.plugins.registry import hub
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.seeding import numpy_rng
from hpp_framework.worlds.loader import resolve_world
from hpp_framework.worlds.people import populate
from hpp_framework.worlds.spawn import spawn_poses

sapien = pytest.importorskip("hpp_framework.sim.sapien.simulator")

pytestmark = pytest.mark.sapien

TOLERANCE = 0.01


def robots():
    return [hub().robots.create("fetch"), hub().robots.create("freight")]


def both(worlds, poses):
    poses = torch.as_tensor(np.array(poses), dtype=torch.float32)
    flat, solid = BatchSimulator(robots()), sapien.SapienSimulator(robots())
    return flat, solid, flat.reset(worlds, poses), solid.reset(worlds, poses)


def test_people_walk_alike_around_robots_that_stand_and_are_seen_alike(capsys):
    worlds, starts = [], []
    for seed in range(8):
        rng = numpy_rng(seed, "people parity")
        world = resolve_world("crowd:people=6" if seed % 2 else "corridor-crowd")(rng)
        start = spawn_poses(world, robots(), rng)
        worlds.append(populate(world, robots(), start, rng))
        starts.append(start)
    flat, solid, one, two = both(worlds, starts)
    still = torch.zeros(8, 2, 2)
    shares, places = [], []
    for _ in range(40):
        one, two = flat.step(still), solid.step(still)
        places.append((one.people.poses - two.people.poses)[..., :2].abs().nan_to_num().max())
        shares.append(((one.scans - two.scans).abs() > TOLERANCE).float().mean())
    with capsys.disabled():
        print(f"\npeople: at most {max(places) * 1e3:.3f} mm apart, {np.mean(shares):.3%} of beams differ")
    assert max(places) < 1e-3
    assert np.mean(shares) < 0.004
    assert not bool(two.touched_person.any())


def test_a_person_ahead_is_seen_at_its_radius():
    world = World(name="one", people=(Person(start=(2.0, 0.0), speed=0.0),))
    _, _, one, two = both([world], [[(0, 0, 0), (-4, 0, 0)]])
    expected = 2.0 - 0.25 - robots()[0].lidar.mount[0]
    for state in (one, two):
        np.testing.assert_allclose(state.scans[0, 0, 110:112], expected, atol=2e-3)


def test_a_robot_is_blocked_alike():
    world = World(name="one", people=(Person(start=(2.0, 0.0), speed=0.0),))
    flat, solid, *_ = both([world], [[(0, 0, 0), (-4, 0, 0)]])
    command = torch.tensor([[[0.8, 0.0], [0.0, 0.0]]])
    ones = [flat.step(command) for _ in range(30)]
    twos = [solid.step(command) for _ in range(30)]
    reach = 2.0 - 0.25 - robots()[0].footprint_radius
    for states in (ones, twos):
        assert states[-1].poses[0, 0, 0].item() == pytest.approx(reach, abs=4e-3)
        assert any(bool(state.touched_person[0, 0]) for state in states)
        assert not any(bool(state.touched_person[0, 1]) for state in states)
        assert not any(bool(state.touched_obstacle.any()) for state in states)


def test_a_door_moves_alike():
    door = MovingObstacle(size=(0.1, 1.2), yaw=0.2, path=((0, 2, 0), (1, 2, 0), (2, 2, 1.5)))
    drum = MovingObstacle(radius=0.4, path=((0, -2, 2), (3, 2, 2)))
    world = World(name="door", bounds=(-5, -5, 5, 5), moving=(door, drum))
    flat, solid, *_ = both([world], [[(0, 0, 0), (-2, -1, 0.3)]])
    still = torch.zeros(1, 2, 2)
    for _ in range(12):
        one, two = flat.step(still), solid.step(still)
        differ = (one.scans - two.scans).abs() > TOLERANCE
        assert differ.float().mean() < 0.01


def test_worlds_with_and_without_people_side_by_side():
    worlds = [World(name="none"), World(name="one", people=(Person(start=(2.0, 0.0), speed=0.0),))]
    _, _, one, two = both(worlds, [[(0, 0, 0), (-4, 0, 0)]] * 2)
    for state in (one, two):
        assert state.people.poses[0].isnan().all()
        assert not state.people.poses[1].isnan().any()
