"""Worlds as planar geometry."""

import math

import numpy as np
import pytest
import trimesh

from hpp_framework.core.world import Box, Cylinder, Mesh, World
from hpp_framework.utils.errors import ConfigError
from hpp_framework.worlds.slicing import planar_map, solid_outlines


def total_length(segments):
    return np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1]).sum()


def test_box_outline_is_counter_clockwise_and_turned():
    box = Box(center=(1, 2), size=(2, 1), yaw=math.pi / 2)
    flat = planar_map(World(name="w", walled=False, boxes=(box,)), lidar_heights=(0.3,), body_height=1.0)
    x, y = flat.segments[:, 0], flat.segments[:, 1]
    assert (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2 == pytest.approx(2.0, abs=1e-5)
    assert (x.min(), x.max(), y.min(), y.max()) == pytest.approx((0.5, 1.5, 1.0, 3.0))


def test_what_begins_above_the_robot_is_not_touched():
    world = World(
        name="w",
        walled=False,
        boxes=(Box(center=(0, 0), size=(1, 1), base=0.7),),
        cylinders=(Cylinder(center=(2, 0), radius=0.5, base=0.7),),
    )
    flat = planar_map(world, lidar_heights=(), body_height=1.1)
    assert [len(part) for part in flat.touched_below(1.1)] == [4, 1]
    assert [len(part) for part in flat.touched_below(0.36)] == [0, 0]


@pytest.mark.parametrize("height", [0.3, 1.0])
def test_mesh_cut_has_the_outline_of_the_solid_even_on_its_faces(tmp_path, height):
    trimesh.creation.box((1.0, 2.0, 2.0)).export(tmp_path / "cube.ply")
    world = World(
        name="w", walled=False, meshes=(Mesh(file=tmp_path / "cube.ply", position=(1, 0, 0), yaw=0.4),)
    )
    flat = planar_map(world, lidar_heights=(height - 2e-4,), body_height=0.05)
    seen = flat.segments[flat.segment_flags == 1]
    assert total_length(seen) == pytest.approx(6.0, rel=1e-3)


def test_only_watertight_meshes_are_solid(tmp_path):
    cube = trimesh.creation.box((1.0, 1.0, 1.0))
    cube.export(tmp_path / "closed.ply")
    trimesh.Trimesh(cube.vertices, cube.faces[1:]).export(tmp_path / "open.ply")
    closed, open_ = (World(name="w", meshes=(Mesh(file=tmp_path / n),)) for n in ("closed.ply", "open.ply"))
    assert len(solid_outlines(closed, 0.4)) == 4
    assert solid_outlines(open_, 0.4) == []


def test_missing_mesh_is_an_error(tmp_path):
    world = World(name="w", meshes=(Mesh(file=tmp_path / "gone.ply"),))
    with pytest.raises(ConfigError, match="does not exist"):
        planar_map(world, lidar_heights=(0.3,), body_height=1.0)
