"""The scans of the catalogue: as their generator makes them, worn, closed enough, and with room to drive."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from hpp_framework.utils.seeding import numpy_rng
from hpp_framework.worlds.loader import resolve_world
from hpp_framework.worlds.occupancy import free_space
from hpp_framework.worlds.scans.real_room import FOLDER, LAYOUTS, SIZE, scan, write
from hpp_framework.worlds.scans.shapes import TABLE_TOP, box, panel, prism, table
from hpp_framework.worlds.scans.wear import LARGEST_NOISE, wear
from hpp_framework.worlds.slicing import planar_map
from hpp_framework.worlds.spawn import spawn_poses

each_layout = pytest.mark.parametrize("name", LAYOUTS)


def _world(name: str):
    return resolve_world(name)(np.random.default_rng(0))


@each_layout
def test_the_files_are_what_the_generator_makes(name):
    made, kept = scan(name), trimesh.load(FOLDER / f"{name}.ply", process=False)
    np.testing.assert_allclose(kept.vertices, made.vertices, atol=1e-5)
    np.testing.assert_array_equal(kept.faces, made.faces)
    assert (FOLDER / f"{name}.ply").stat().st_size < 300_000


def test_all_layouts_are_written(tmp_path):
    files = write(tmp_path)
    assert [file.read_bytes() for file in files] == [(FOLDER / file.name).read_bytes() for file in files]


@each_layout
def test_a_scan_is_noisy_and_has_holes_and_the_room_stays_where_it_is(name):
    made = scan(name)
    assert not made.is_watertight
    half = np.array([*SIZE, 0.0]) / 2
    beyond = np.abs(made.bounds[:, :2]) - half[:2]
    assert 0 < np.abs(beyond).max() <= LARGEST_NOISE
    floor = made.vertices[made.vertices[:, 2] < 0.05]
    assert 0.002 < floor[:, 2].std() < 0.02


@each_layout
def test_robots_start_five_metres_apart_and_can_meet(name, fetch, freight):
    world, rng = _world(name), np.random.default_rng(1)
    starts = [spawn_poses(world, [fetch, freight], rng) for _ in range(20)]
    apart = [np.hypot(*(poses[0] - poses[1])[:2]) for poses in starts]
    assert apart == pytest.approx([5.0] * 20)
    assert len({round(float(poses[0, 0]), 3) for poses in starts}) == 20


@each_layout
def test_no_robot_gets_out_of_the_room(name, fetch, freight):
    """What a robot of either height touches encloses all of the room, holes or not."""
    for robot in (fetch, freight):
        world = _world(name)
        wide = type(world)(name="wide", bounds=(-8, -7, 8, 7), walled=False, meshes=world.meshes)
        space = free_space(wide, body_height=robot.height, resolution=0.025)
        labels = space.regions(robot.footprint_radius)
        outside, inside = space.look_up(labels, np.array([[-7.5, 0.0], [0.0, 4.4]]))
        assert outside != inside
        assert min(outside, inside) > 0


def test_the_wall_and_the_island_stand_between_the_robots(fetch, freight):
    for name in ("real-wall", "real-roundabout"):
        space = free_space(_world(name), body_height=1.1)
        for seed in range(10):
            poses = spawn_poses(_world(name), [fetch, freight], np.random.default_rng(seed))
            line = poses[0, :2] + np.linspace(0, 1, 101)[:, None] * (poses[1, :2] - poses[0, :2])
            assert space.at(line).min() < 0.03


def test_the_forest_is_narrow_and_can_be_crossed(fetch):
    space = free_space(_world("real-forest"), body_height=fetch.height, resolution=0.025)
    around = np.array([[5.3, 3.2], [-5.3, -2.5], [0.0, 0.0], [1.25, 2.7]])
    with_care = space.look_up(space.regions(fetch.footprint_radius + 0.05), around)
    assert len(set(with_care.tolist())) == 1
    assert with_care[0] > 0
    wide = space.regions(fetch.footprint_radius + 0.15)
    assert wide.max() > 5  # the room falls apart for those who keep more distance


def test_tables_are_seen_by_their_legs_and_driven_under(fetch):
    flat = planar_map(_world("real-forest"), lidar_heights=(fetch.lidar.height,), body_height=fetch.height)
    assert flat.segment_heights[:, 0].max() < fetch.height < TABLE_TOP
    one = table((0.0, 0.0), (1.6, 0.9), 0.3)
    assert one.bounds[1, 2] == pytest.approx(TABLE_TOP + 0.04)


def test_shapes_are_closed_but_for_their_underside():
    def edges_of_one_triangle(mesh):
        joined = trimesh.Trimesh(mesh.vertices, mesh.faces, process=True)
        joined.merge_vertices()
        _, counts = np.unique(joined.edges_sorted, axis=0, return_counts=True)
        return int((counts == 1).sum())

    assert edges_of_one_triangle(box((1, 2), (0.5, 0.7), 1.0, yaw=0.4)) == 4
    assert edges_of_one_triangle(box((1, 2), (0.5, 0.7), 0.1, base=0.5)) == 0
    assert edges_of_one_triangle(box((0, 0), (3.0, 1.0), 1.4)) == 2 * (3 + 1)
    angles = np.arange(6) * np.pi / 3
    hexagon = np.stack([np.cos(angles), np.sin(angles)], -1)
    assert edges_of_one_triangle(prism(hexagon, 0.5)) == 6
    assert prism(hexagon, 0.5, base=1.0).volume == pytest.approx(0.5 * 1.5 * np.sqrt(3))


def test_wear_moves_points_and_takes_triangles_away():
    clean = panel((0, 0, 0), (10, 0, 0), (0, 0, 2))
    worn = wear(clean, numpy_rng(3, "wear"))
    assert 0 < np.abs(worn.vertices[:, 1]).max() <= LARGEST_NOISE
    assert 0.9 * clean.area < worn.area < 0.999 * clean.area
    again = wear(clean, numpy_rng(3, "wear"))
    np.testing.assert_array_equal(worn.vertices, again.vertices)
