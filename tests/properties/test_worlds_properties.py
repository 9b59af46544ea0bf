"""Laws of worlds: files round trip, distances are distances, starts keep the rule."""

from __future__ import annotations

import math

import numpy as np
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hpp_framework.core.world import Box, Cylinder, SpawnRule, World
from hpp_framework.plugins.registry import hub
from hpp_framework.worlds.loader import load_world
from hpp_framework.worlds.occupancy import free_space
from hpp_framework.worlds.spawn import spawn_poses

QUICK = settings(
    max_examples=25,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
    derandomize=True,
)
coordinate = st.floats(-3.5, 3.5, allow_nan=False).map(lambda v: round(v, 3))
size = st.floats(0.1, 1.5, allow_nan=False).map(lambda v: round(v, 3))
boxes = st.builds(
    lambda x, y, a, b, yaw: {"center": [x, y], "size": [a, b], "yaw_deg": yaw},
    coordinate, coordinate, size, size, st.integers(-180, 180),
)  # fmt: skip
cylinders = st.builds(lambda x, y, r: {"center": [x, y], "radius": r}, coordinate, coordinate, size)


@QUICK
@given(st.lists(boxes, max_size=3), st.lists(cylinders, max_size=2))
def test_a_world_file_says_what_it_means(tmp_path, some_boxes, some_cylinders):
    file = tmp_path / "room.yaml"
    file.write_text(
        yaml.safe_dump({"bounds": [-9, -9, 9, 9], "boxes": some_boxes, "cylinders": some_cylinders})
    )
    world = load_world(file)
    assert [list(b.center) for b in world.boxes] == [b["center"] for b in some_boxes]
    assert np.allclose([b.yaw for b in world.boxes], [math.radians(b["yaw_deg"]) for b in some_boxes])
    assert [c.radius for c in world.cylinders] == [c["radius"] for c in some_cylinders]


@QUICK
@given(coordinate, coordinate, size, coordinate, coordinate)
def test_clearance_is_the_distance_to_the_pillar(x, y, radius, at_x, at_y):
    world = World(name="w", bounds=(-9, -9, 9, 9), cylinders=(Cylinder(center=(x, y), radius=radius),))
    space = free_space(world, body_height=0.5)
    exact = max(math.hypot(at_x - x, at_y - y) - radius, 0.0)
    found = float(space.at(np.array([[at_x, at_y]]))[0])
    assert abs(found - exact) < 2 * space.resolution


@QUICK
@given(st.integers(0, 10_000), st.integers(2, 5), st.lists(boxes, max_size=4))
def test_starts_are_apart_free_and_mutually_reachable(seed, count, some_boxes):
    robots = [hub().robots.create("fetch")] * count
    world = World(
        name="w",
        bounds=(-9, -9, 9, 9),
        boxes=tuple(Box(center=tuple(b["center"]), size=tuple(b["size"])) for b in some_boxes),
        spawn=SpawnRule(distance=5.0, clearance=0.1),
    )
    poses = spawn_poses(world, robots, np.random.default_rng(seed))
    gaps = np.linalg.norm(poses[:, None, :2] - poses[None, :, :2], axis=-1)[np.triu_indices(count, 1)]
    assert gaps.min() > 2 * robots[0].footprint_radius
    assert gaps.max() <= 5.0 + 1e-6
    clear = free_space(world, body_height=1.1).at(poses[:, :2])
    assert clear.min() > robots[0].footprint_radius
