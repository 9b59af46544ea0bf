"""Distances to obstacles on a grid, against the analytic ones."""

import numpy as np
import pytest
import trimesh

from hpp_framework.core.world import Box, Cylinder, Mesh, World
from hpp_framework.worlds.occupancy import fill_outlines, free_space


def test_distance_agrees_with_geometry():
    world = World(name="w", bounds=(-5, -5, 5, 5), cylinders=(Cylinder(center=(1, 1), radius=0.5),))
    points = np.random.default_rng(0).uniform(-4.9, 4.9, (500, 2))
    to_disc = np.hypot(*(points - 1).T) - 0.5
    exact = np.maximum(np.minimum(to_disc, 5 - np.abs(points).max(1)), 0)
    np.testing.assert_allclose(free_space(world, body_height=1.0).at(points), exact, atol=0.08)


def test_outside_is_never_free_and_boxes_are_filled():
    space = free_space(World(name="w", boxes=(Box(center=(0, 0), size=(4, 4)),)), body_height=1.0)
    np.testing.assert_array_equal(space.at(np.array([[0.0, 0.0], [1.9, 1.9], [11.0, 0.0], [0.0, -50.0]])), 0)


def test_wall_divides_a_room_and_samples_stay_in_the_larger_part():
    space = free_space(World(name="w", boxes=(Box(center=(3, 0), size=(0.2, 20)),)), body_height=1.0)
    assert space.regions(0.3).max() == 2
    points = space.sample(space.largest_region(0.3), 200, np.random.default_rng(0))
    assert points[:, 0].max() < 2.6
    assert space.look_up(space.largest_region(0.3).astype(np.int32), points).all()


def test_solid_mesh_blocks_its_inside(tmp_path):
    trimesh.creation.box((2.0, 2.0, 2.0)).export(tmp_path / "cube.stl")
    world = World(name="w", meshes=(Mesh(file=tmp_path / "cube.stl", yaw=0.5),))
    space = free_space(world, body_height=1.0)
    assert space.at(np.array([[0.0, 0.0]])) == 0
    assert space.at(np.array([[3.0, 0.0]])) == pytest.approx(
        1.69, abs=0.05
    )  # to the corner at -45 degrees + 0.5 rad


def test_even_odd_fill_leaves_holes_free():
    def square(low, high):
        corners = np.array([[low, low], [high, low], [high, high], [low, high]], float)
        return np.stack([corners, np.roll(corners, -1, 0)], 1)

    filled = fill_outlines(np.concatenate([square(2.5, 17.5), square(6.5, 13.5)]), (20, 20))
    assert filled.sum() == 15**2 - 7**2
    assert filled[10, 10] == 0
