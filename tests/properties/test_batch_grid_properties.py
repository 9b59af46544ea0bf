"""The grids of the batch simulator against plain loops over all obstacles, in crowded worlds and teams."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.world import Box, Cylinder, World
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.worlds.slicing import planar_map

EDGE = 1e-3
"""Beams whose range differs this many radians to either side are left out: rounding decides there."""
TOLERANCE = 2e-4
"""Metres, for ranges of up to 25 m in single precision; more where a surface is seen at a flat angle."""


def furnished(seed: int, boxes: int, cylinders: int, side: float = 10.0) -> World:
    rng = np.random.default_rng(seed)
    low, high = (-side, -side, 0.2, 0.2, -math.pi), (side, side, 0.6, 0.6, math.pi)
    return World(
        name="crowded",
        bounds=(-side, -side, side, side),
        boxes=tuple(
            Box(center=(x, y), size=(w, d), yaw=yaw, base=base)
            for (x, y, w, d, yaw), base in zip(
                rng.uniform(low, high, (boxes, 5)).tolist(),
                rng.choice([0.0, 0.2, 0.5], boxes, p=[0.8, 0.1, 0.1]).tolist(),
                strict=True,
            )
        ),
        cylinders=tuple(
            Cylinder(center=(x, y), radius=r)
            for x, y, r in rng.uniform((-side, -side, 0.05), (side, side, 0.4), (cylinders, 3)).tolist()
        ),
    )


def plain_scan(robots, poses, world: World, agent: int, turn: float = 0.0) -> np.ndarray:
    """Return the ranges (beams,) of one robot by trying all obstacles, in double precision."""
    lidar = robots[agent].lidar
    flat = planar_map(world, lidar_heights=[lidar.height], body_height=2.0)
    x, y, theta = poses[agent].astype(float)
    eye = np.array([x, y]) + np.array(
        [[math.cos(theta), -math.sin(theta)], [math.sin(theta), math.cos(theta)]]
    ) @ np.array(lidar.mount[:2])
    angles = lidar.angles() + theta + lidar.mount[2] + turn
    rays = np.stack([np.cos(angles), np.sin(angles)], -1)

    def at_height(heights):
        return (heights[:, 0] <= lidar.height) & (lidar.height < heights[:, 1])

    segments = flat.segments[at_height(flat.segment_heights)].astype(float)
    start, along = segments[:, :2] - eye, segments[:, 2:] - segments[:, :2]
    across = rays[:, :1] * along[:, 1] - rays[:, 1:] * along[:, 0]
    facing = start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0] < 0
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0]) / across
        share = (start[:, 0] * rays[:, 1:] - start[:, 1] * rays[:, :1]) / across
    hits = np.where(facing & (distance > 0) & (share >= 0) & (share <= 1), distance, math.inf)
    others = [
        (*poses[j, :2], robot.profile_radius)
        for j, robot in enumerate(robots)
        if j != agent and robot.height > lidar.height
    ]
    discs = np.concatenate([flat.discs[at_height(flat.disc_heights)], np.array(others).reshape(-1, 3)])
    center = discs[:, :2].astype(float) - eye
    nearest = rays @ center.T
    depth = discs[:, 2] ** 2 - ((center**2).sum(1) - nearest**2)
    with np.errstate(invalid="ignore"):
        rounds = np.where((nearest > 0) & (depth > 0), nearest - np.sqrt(depth), math.inf)
    rounds[:, (center**2).sum(1) <= discs[:, 2] ** 2] = math.inf
    nearest_hit = np.concatenate([hits, rounds], 1).min(1, initial=math.inf)
    return np.clip(nearest_hit, lidar.min_range, lidar.max_range)


def compare(robots: tuple[RobotSpec, ...], world: World, poses: np.ndarray) -> None:
    scans = BatchSimulator(robots).reset([world], torch.from_numpy(poses)[None]).scans[0].numpy()
    for agent in range(len(robots)):
        wanted, left, right = (plain_scan(robots, poses, world, agent, turn) for turn in (0, EDGE, -EDGE))
        steepness = np.maximum(np.abs(left - wanted), np.abs(right - wanted)) / EDGE
        clear = steepness < 20
        assert clear.mean() > 0.5
        error = np.abs(scans[agent, : robots[agent].lidar.beams] - wanted)
        # the eye's place is rounded too, which a flat surface shows most
        assert (error <= TOLERANCE + 5e-5 * steepness)[clear].all()


def random_poses(seed: int, count: int, side: float = 9.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.uniform((-side, -side, -math.pi), (side, side, math.pi), (count, 3)).astype(np.float32)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from([(0, 3), (5, 0), (60, 20), (500, 0), (300, 150)]))
def test_scans_equal_plain_loops(pair, seed, amount):
    compare(pair, furnished(seed, *amount), random_poses(seed, 2))


@pytest.mark.parametrize("view", [0.3, 1.0, math.pi, 4.0, 2 * math.pi])
@pytest.mark.parametrize("mount", [0.0, 3.0])
def test_every_field_of_view_sees_all_that_lies_in_it(fetch, view, mount):
    lidar = dataclasses.replace(fetch.lidar, beams=181, field_of_view=view, mount=(0.235, 0.0, mount))
    robot = dataclasses.replace(fetch, lidar=lidar)
    for seed in range(5):
        compare((robot,), furnished(seed, 300, 50), random_poses(seed, 1))


def test_eyes_outside_the_grid_look_in(fetch):
    world = furnished(1, 200, 30, side=4.0)
    lidar = dataclasses.replace(fetch.lidar, field_of_view=2 * math.pi)
    robot = dataclasses.replace(fetch, lidar=lidar)
    for place in ((-12.0, 1.0), (5.0, 13.0), (9.0, -9.0)):
        compare((robot,), world, np.array([[*place, 0.4]], np.float32))


@pytest.mark.parametrize("yaw", [0.0, math.pi / 2, math.pi])
def test_an_eye_on_the_axis_of_a_box_sees_its_face(fetch, yaw):
    lidar = dataclasses.replace(fetch.lidar, field_of_view=2 * math.pi)
    robot = dataclasses.replace(fetch, lidar=lidar)
    sides = tuple(
        Box(center=center, size=(0.5, 1.0), yaw=yaw) for center in ((2.0, 0.0), (-2.0, 0.0), (0.0, 2.0))
    )
    world = World(name="axes", bounds=(-4, -4, 4, 4), boxes=sides)
    compare((robot,), world, np.array([[-lidar.mount[0], 0.0, 0.0]], np.float32))


def test_a_robot_inside_a_box_leaves_it_by_the_nearest_side(fetch):
    box = Box(center=(0.0, 0.0), size=(2.0, 2.0))
    simulator = BatchSimulator([fetch])
    simulator.reset([World(name="box", walled=False, boxes=(box,))], torch.tensor([[[0.9, 0.1, 0.0]]]))
    state = simulator.step(torch.zeros(1, 1, 2))
    assert state.poses[0, 0].tolist() == pytest.approx([1.0 + fetch.footprint_radius, 0.1, 0.0], abs=1e-4)
    assert bool(state.collided[0, 0])


def test_thirty_two_robots_see_each_other(pair):
    robots = tuple(pair[index % 2] for index in range(32))
    compare(robots, furnished(3, 30, 10), random_poses(5, 32))


def test_mixed_lidars_each_see_their_own_plane(fetch, freight):
    high = dataclasses.replace(
        freight, lidar=dataclasses.replace(freight.lidar, beams=61, height=0.6, max_range=6.0), height=1.3
    )
    compare((fetch, high), furnished(4, 200, 20), random_poses(6, 2))


def test_a_crowded_world_is_left_by_nobody(fetch):
    """Robots among 500 boxes end a drive as far from all of them as a plain loop over all demands."""
    world = furnished(8, 500, 0)
    flat = planar_map(world, lidar_heights=[], body_height=fetch.height)
    segments, _ = flat.touched_below(fetch.height)
    rng = np.random.default_rng(9)

    def gaps(points: np.ndarray) -> np.ndarray:
        start, along = segments[:, :2], segments[:, 2:] - segments[:, :2]
        away = points[:, None] - start
        share = np.clip((away * along).sum(-1) / (along**2).sum(-1), 0, 1)
        return np.linalg.norm(away - share[..., None] * along, axis=-1).min(1)

    spots = rng.uniform(-9.5, 9.5, (4000, 2))
    spots = spots[gaps(spots) > fetch.footprint_radius + 0.01][:64]
    assert len(spots) == 64
    heading = rng.uniform(-math.pi, math.pi, (64, 1))
    poses = torch.tensor(np.concatenate([spots, heading], 1), dtype=torch.float32)[:, None]
    simulator = BatchSimulator([fetch])
    simulator.reset([world] * 64, poses)
    touched = torch.zeros(64, 1, dtype=torch.bool)
    for _ in range(40):
        move = torch.tensor(rng.uniform((0.5, -2), (1, 2), (64, 1, 2)), dtype=torch.float32)
        state = simulator.step(move)
        touched |= state.collided
        clear = gaps(state.poses[:, 0, :2].double().numpy())
        # wedged between boxes, a disc gives a little
        assert clear.min() > fetch.footprint_radius - 0.02
        assert (clear > fetch.footprint_radius - 1e-3).mean() > 0.9
        # no robot that is clear of everything has touched anything
        assert not state.collided[torch.from_numpy(clear > fetch.footprint_radius + 0.25), 0].any()
    assert touched.float().mean() > 0.3
