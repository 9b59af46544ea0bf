"""The batch simulator's lidar against a slow, obvious one: every beam with every obstacle."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import torch
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.world import Box, Cylinder, World
from hpp_framework.sim.batch.simulator import BatchSimulator

EDGE = 2e-3
"""Beams that see something else this many radians to either side are left out: rounding decides there."""


def first_hits(origin, directions, world: World, others, height: float) -> np.ndarray:
    """Return the nearest range along each ray (k, 2), metres; infinite for a miss."""
    hits = [np.full(len(directions), math.inf)]
    for box in world.solid_boxes():
        if box.base <= height < box.base + box.height:
            corners = box.corners()
            for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
                hits.append(_segment(origin, directions, a, b))
    for cylinder in world.cylinders:
        if cylinder.base <= height < cylinder.base + cylinder.height:
            hits.append(_disc(origin, directions, np.array(cylinder.center), cylinder.radius))
    for robot, pose in others:
        if robot.height > height:
            hits.append(_disc(origin, directions, pose[:2], robot.profile_radius))
    return np.min(hits, axis=0)


def _segment(origin, directions, a, b) -> np.ndarray:
    edge, offset = b - a, a - origin
    across = directions[:, 0] * edge[1] - directions[:, 1] * edge[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (offset[0] * edge[1] - offset[1] * edge[0]) / across
        share = (offset[0] * directions[:, 1] - offset[1] * directions[:, 0]) / across
    return np.where((along > 0) & (share >= 0) & (share <= 1), along, math.inf)


def _disc(origin, directions, center, radius) -> np.ndarray:
    offset = center - origin
    nearest = directions @ offset
    miss = offset @ offset - nearest**2
    depth = np.sqrt(np.maximum(radius**2 - miss, 0))
    return np.where((nearest > 0) & (miss < radius**2), nearest - depth, math.inf)


def reference(robots: tuple[RobotSpec, ...], poses: np.ndarray, world: World, agent: int, shift: float = 0.0):
    """Return the scan (beams,) of one robot, every beam turned by ``shift`` radians."""
    lidar = robots[agent].lidar
    x, y, theta = poses[agent]
    mount_x, mount_y, mount_theta = lidar.mount
    cos, sin = math.cos(theta), math.sin(theta)
    origin = np.array([x + cos * mount_x - sin * mount_y, y + sin * mount_x + cos * mount_y])
    angles = lidar.angles() + theta + mount_theta + shift
    directions = np.stack([np.cos(angles), np.sin(angles)], -1)
    others = [(robot, poses[j]) for j, robot in enumerate(robots) if j != agent]
    return np.clip(
        first_hits(origin, directions, world, others, lidar.height), lidar.min_range, lidar.max_range
    )


def clear_of_edges(robots, poses, world: World, agent: int, scan: np.ndarray) -> np.ndarray:
    """Return which beams (beams,) see the same thing a little to either side."""
    near = [reference(robots, poses, world, agent, shift) for shift in (-EDGE, EDGE)]
    slack = 0.05 + 0.02 * scan
    return np.all([np.abs(other - scan) < slack for other in near], axis=0)


def cast(robots: tuple[RobotSpec, ...], poses: np.ndarray, world: World) -> np.ndarray:
    simulator = BatchSimulator(robots)
    return simulator.reset([world], torch.tensor(poses[None], dtype=torch.float32)).scans[0].numpy()


def agree(robots: tuple[RobotSpec, ...], poses: np.ndarray, world: World) -> None:
    scans = cast(robots, poses, world)
    for agent in range(len(robots)):
        wanted = reference(robots, poses, world, agent)
        clear = clear_of_edges(robots, poses, world, agent, wanted)
        assert clear.mean() > 0.5
        assert np.abs(scans[agent] - wanted)[clear].max() < 2e-3 + 2e-4 * wanted.max()


coordinate = st.floats(-6, 6)
heading = st.floats(-math.pi, math.pi)
boxes = st.builds(
    lambda x, y, w, d, yaw, base, height: Box(
        center=(x, y), size=(w, d), yaw=yaw, base=base, height=height
    ),
    coordinate, coordinate, st.floats(0.1, 4), st.floats(0.1, 4), heading,
    st.sampled_from([0.0, 0.2, 0.6]), st.sampled_from([0.25, 1.0]),
)  # fmt: skip
cylinders = st.builds(
    lambda x, y, radius, base: Cylinder(center=(x, y), radius=radius, base=base),
    coordinate, coordinate, st.floats(0.04, 1.0), st.sampled_from([0.0, 0.5]),
)  # fmt: skip
worlds = st.builds(
    lambda some_boxes, some_cylinders, walled: World(
        name="random",
        bounds=(-7, -7, 7, 7),
        boxes=tuple(some_boxes),
        cylinders=tuple(some_cylinders),
        walled=walled,
    ),
    st.lists(boxes, max_size=5), st.lists(cylinders, max_size=4), st.booleans(),
)  # fmt: skip
pose = st.tuples(coordinate, coordinate, heading)


def is_free(point: np.ndarray, world: World, gap: float) -> bool:
    """Return whether no obstacle, at any height, is nearer than ``gap`` to a point."""
    for box in world.boxes:
        cos, sin = math.cos(box.yaw), math.sin(box.yaw)
        dx, dy = point - np.array(box.center)
        local = np.abs([cos * dx + sin * dy, cos * dy - sin * dx]) - np.array(box.size) / 2
        if np.hypot(*np.maximum(local, 0)) < gap:
            return False
    return all(math.dist(point, c.center) > c.radius + gap for c in world.cylinders)


@settings(max_examples=150, deadline=None)
@given(worlds, pose, pose)
def test_scans_equal_the_all_pairs_reference(pair, world, first, second):
    poses = np.array([first, second])
    assume(math.dist(first[:2], second[:2]) > 0.6)
    assume(all(is_free(xy, world, 0.3) for xy in poses[:, :2]))
    agree(pair, poses, world)


@settings(max_examples=80, deadline=None)
@given(worlds, pose, st.floats(-math.pi, math.pi))
def test_all_round_lidars_close_at_the_wrap(fetch, world, place, mount):
    """360 degrees, mounted at any angle: obstacles behind lie across the wrap at +-pi."""
    lidar = dataclasses.replace(fetch.lidar, beams=181, field_of_view=2 * math.pi, mount=(0.235, 0.0, mount))
    robot = dataclasses.replace(fetch, lidar=lidar)
    poses = np.array([place])
    assume(is_free(poses[0, :2], world, 0.3))
    agree((robot,), poses, world)


@pytest.mark.parametrize("side", [-1, 1])
def test_a_wall_straight_behind_is_seen_on_both_sides_of_the_wrap(fetch, side):
    lidar = dataclasses.replace(
        fetch.lidar, field_of_view=2 * math.pi, beams=361, mount=(0.235, 0.0, math.pi * side)
    )
    robot = dataclasses.replace(fetch, lidar=lidar)
    world = World(
        name="behind", bounds=(-9, -9, 9, 9), walled=False, boxes=(Box(center=(3, 0), size=(0.2, 4)),)
    )
    scan = cast((robot,), np.zeros((1, 3)), world)[0]
    # the mount faces away from the wall: the first and the last beam look the same way, straight at it
    assert scan[0] == pytest.approx(2.9 - 0.235, abs=1e-4)
    assert scan[-1] == pytest.approx(2.9 - 0.235, abs=1e-4)
    assert scan[180] == lidar.max_range


def test_an_empty_world_reads_the_maximum(pair, empty_world):
    scans = cast(pair, np.array([[0.0, 0, 0], [-5, 0, math.pi]]), empty_world)
    assert np.all(scans == pair[0].lidar.max_range)


def test_the_other_robot_is_seen_at_its_place(pair, empty_world):
    # the other stands 3 m ahead; the laser is 0.235 m ahead of the centre
    scans = cast(pair, np.array([[0.0, 0, 0], [3, 0, 0]]), empty_world)
    # half a beam off its middle the disc is 1.3 mm farther
    assert scans[0, 110:112] == pytest.approx(3 - 0.235 - pair[1].profile_radius, abs=2e-3)
    assert np.sum(scans[0] < 25) == pytest.approx(2 * math.degrees(math.asin(0.21 / 2.765)), abs=1.5)
    # the other looks away and sees no robot
    assert np.all(scans[1] == 25)


def test_beam_zero_is_the_most_clockwise(fetch, empty_world):
    world = dataclasses.replace(empty_world, cylinders=(Cylinder(center=(0.5, -3), radius=0.4),))
    scan = cast((fetch,), np.zeros((1, 3)), world)[0]
    seen = np.nonzero(scan < 25)[0]
    assert len(seen) > 0
    assert seen.max() < 111  # to the right


def test_near_hits_read_the_minimum_range(fetch, empty_world):
    front = 0.235 + 0.02
    world = dataclasses.replace(empty_world, boxes=(Box(center=(front + 0.5, 0), size=(1, 2)),))
    scan = cast((fetch,), np.zeros((1, 3)), world)[0]
    assert scan.min() == pytest.approx(fetch.lidar.min_range)


def test_a_floating_box_is_seen_only_at_its_height(fetch, empty_world):
    for base, height, seen in ((0.0, 0.25, False), (0.2, 0.3, True), (0.5, 0.5, False)):
        box = Box(center=(2, 0), size=(0.5, 1), base=base, height=height)
        scan = cast((fetch,), np.zeros((1, 3)), dataclasses.replace(empty_world, boxes=(box,)))[0]
        assert (scan.min() < 25) == seen


def test_narrower_lidars_of_a_mixed_team_are_padded_with_their_maximum(fetch, freight, small_world):
    coarse = dataclasses.replace(freight, lidar=dataclasses.replace(freight.lidar, beams=30, max_range=7.0))
    poses = np.array([[0.0, 0, 0], [1, 1, 2]])
    scans = cast((fetch, coarse), poses, small_world)
    assert np.all(scans[1, 30:] == 7.0)
    wanted = reference((fetch, coarse), poses, small_world, 1)
    clear = clear_of_edges((fetch, coarse), poses, small_world, 1, wanted)
    assert np.abs(scans[1, :30] - wanted)[clear].max() < 2e-3
