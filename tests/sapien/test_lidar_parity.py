"""Both simulators see the same ranges, beam by beam.

Edge rule: where neighbouring beams fall on different things, a micrometre decides which of them a beam meets,
and the ranges may differ by metres although both are right. So a beam is compared if, in both simulators, its
end lies within ``STEP`` of the straight line through the ends of its two neighbours (on a line the inverse
range of a beam is the mean of its neighbours' but for the cosine of the 1 degree between them): the surface
goes on smoothly to both sides. Walls pass at any slant; corners, outlines and thin legs do not.
"""

import numpy as np
import pytest
import torch
import trimesh

from hpp_framework.core.world import Box, Cylinder, Mesh, World
from hpp_framework.plugins.registry import hub
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.seeding import numpy_rng
from hpp_framework.worlds.loader import resolve_world
from hpp_framework.worlds.occupancy import free_space
from hpp_framework.worlds.scans.real_room import LAYOUTS

sapien = pytest.importorskip("hpp_framework.sim.sapien.simulator")

STEP = 0.02
TOLERANCE = 0.01

pytestmark = pytest.mark.sapien


def robots():
    return [hub().robots.create("fetch"), hub().robots.create("freight")]


def away_from_edges(*scans):
    """Return which beams (..., k) continue their neighbours' surface in every one of the scans."""
    smooth = np.ones(scans[0].shape, bool)
    smooth[..., [0, -1]] = False
    for scan in scans:
        expected = 2 / (1 / scan[..., :-2] + 1 / scan[..., 2:])
        smooth[..., 1:-1] &= np.abs(expected - scan[..., 1:-1]) < STEP
    return smooth


def free_pairs(world, count, rng):
    """Draw poses (count, 2, 3); in half of them the robots stand within 3 m of each other."""
    space = free_space(world, body_height=max(robot.height for robot in robots()))
    free = space.sample(space.distance > 0.3, 400, rng)
    gaps = np.linalg.norm(free[:, None] - free[None], axis=-1)
    out = np.zeros((count, 2, 3))
    for index in range(count):
        pairs = np.argwhere((gaps > 0.7) & (gaps < (3.0 if index % 2 == 0 else np.inf)))
        points = free[rng.choice(pairs)]
        out[index] = np.column_stack([points, rng.uniform(-np.pi, np.pi, 2)])
    return torch.tensor(out, dtype=torch.float32)


def both_scans(world, poses):
    worlds = [world] * len(poses)
    flat = BatchSimulator(robots()).reset(worlds, poses).scans.numpy()
    solid = sapien.SapienSimulator(robots()).reset(worlds, poses).scans.numpy()
    return flat, solid


def test_thousand_poses_in_fifty_rooms(capsys):
    flat, solid = [], []
    for seed in range(50):
        rng = numpy_rng(seed, "lidar parity")
        world = hub().worlds.create("training", rng)
        scans = both_scans(world, free_pairs(world, 20, rng))
        flat.append(scans[0])
        solid.append(scans[1])
    flat, solid = np.concatenate(flat), np.concatenate(solid)
    compared = away_from_edges(flat, solid)
    error = np.abs(flat - solid)
    with capsys.disabled():
        print(
            f"\nlidar parity: {len(flat)} poses of two robots, {compared.mean():.2%} of the beams compared, "
            f"max {error[compared].max() * 1e3:.2f} mm, mean {error[compared].mean() * 1e3:.4f} mm; "
            f"all beams: {np.mean(error > TOLERANCE):.4%} differ by more than {TOLERANCE * 1e3:.0f} mm"
        )
    assert compared.mean() > 0.8
    assert error[compared].max() <= TOLERANCE
    assert np.mean(error > TOLERANCE) < 0.002


def test_the_other_robot_is_seen_at_its_profile():
    poses = torch.tensor([[[0.0, 0.0, 0.0], [2.0, 0.0, np.pi]]], dtype=torch.float32)
    flat, solid = both_scans(World(name="empty"), poses)
    ahead = slice(110, 112)
    reach = 2.0 - 0.235 - robots()[1].profile_radius
    np.testing.assert_allclose(solid[0, :, ahead], reach, atol=2e-3)
    np.testing.assert_allclose(flat[0, :, ahead], solid[0, :, ahead], atol=2e-3)


def test_table_mesh_and_large_pillar(tmp_path):
    blob = trimesh.creation.icosphere(subdivisions=3, radius=0.6)
    blob.apply_translation([0, 0, 0.2])
    blob.export(tmp_path / "blob.stl")
    sheet = trimesh.Trimesh([[0, -1, 0], [0, 1, 0], [0, 1, 1], [0, -1, 1]], [[0, 1, 2], [0, 2, 3]])
    sheet.export(tmp_path / "sheet.ply")
    world = World(
        name="mixed",
        bounds=(-6.0, -6.0, 6.0, 6.0),
        # a floating table top on one low box, which the lidar looks between
        boxes=(
            Box(center=(2.0, 2.0), size=(1.6, 1.0), base=0.7, height=0.05),
            Box(center=(2.0, 2.0), size=(0.5, 0.5), height=0.2),
            Box(center=(-2.0, 2.0), size=(0.8, 0.8), yaw=0.4, base=0.25, height=0.3),
        ),
        cylinders=(Cylinder(center=(3.0, -3.0), radius=1.5), Cylinder(center=(-3.5, -3.5), radius=0.3)),
        meshes=(
            Mesh(file=tmp_path / "blob.stl", position=(0.0, -2.5, 0.0), yaw=0.3, scale=1.2),
            Mesh(file=tmp_path / "sheet.ply", position=(-3.0, 0.0, 0.0), yaw=0.2),
        ),
    )
    flat, solid = both_scans(world, free_pairs(world, 40, numpy_rng(0, "mixed")))
    compared = away_from_edges(flat, solid)
    error = np.abs(flat - solid)
    assert compared.mean() > 0.8
    assert error[compared].max() <= TOLERANCE
    assert np.mean(error > TOLERANCE) < 0.005


@pytest.mark.parametrize("name", LAYOUTS)
def test_scanned_rooms(name):
    """The batch simulator leaves out points of a cut that are less than 2 mm off: 1 cm at a grazing angle."""
    world = resolve_world(name)(np.random.default_rng(0))
    flat, solid = both_scans(world, free_pairs(world, 40, numpy_rng(0, name)))
    compared = away_from_edges(flat, solid)
    error = np.abs(flat - solid)
    assert compared.mean() > 0.55
    assert np.mean(error[compared] > TOLERANCE) < 0.001
    assert error[compared].max() <= 3 * TOLERANCE
    assert np.mean(error > TOLERANCE) < 0.003


def test_a_thin_sheet_is_seen_from_both_sides(tmp_path):
    sheet = trimesh.Trimesh([[0, -1, 0], [0, 1, 0], [0, 1, 1], [0, -1, 1]], [[0, 1, 2], [0, 2, 3]])
    sheet.export(tmp_path / "sheet.ply")
    world = World(name="sheet", meshes=(Mesh(file=tmp_path / "sheet.ply"),))
    poses = torch.tensor([[[-2.0, 0.0, 0.0], [2.0, 0.0, np.pi]]], dtype=torch.float32)
    flat, solid = both_scans(world, poses)
    np.testing.assert_allclose(solid[0, :, 110], 2.0 - 0.235, atol=1e-3)
    np.testing.assert_allclose(flat[0, :, 110], 2.0 - 0.235, atol=1e-3)


def test_a_lidar_in_the_middle_of_its_robot_does_not_see_it():
    from dataclasses import replace

    spec = robots()[1]
    inner = replace(
        spec, lidar=replace(spec.lidar, mount=(0.0, 0.0, 0.0), field_of_view=np.pi / 2, beams=5), name="inner"
    )
    simulator = sapien.SapienSimulator([inner])
    world = World(name="room", bounds=(-3.0, -3.0, 3.0, 3.0))
    scan = simulator.reset([world], torch.zeros(1, 1, 3)).scans[0, 0]
    np.testing.assert_allclose(scan[2], 3.0, atol=1e-3)
    assert scan.min() > 2.9
