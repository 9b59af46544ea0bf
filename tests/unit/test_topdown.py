"""Top-down pictures and figures: things appear where they are, in their colour, and inputs stay untouched."""

import numpy as np
import pytest
import trimesh

from hpp_framework.core.world import Box, Mesh, World
from hpp_framework.evaluation.figures import plot_distance
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import ConfigError, HppError
from hpp_framework.viz.marks import robot_colors
from hpp_framework.viz.topdown import TopDown, close_view

POSES = np.array([[-2.0, 1.0, 0.0], [2.0, 1.0, 3.0]])


@pytest.fixture
def robots():
    return [hub().robots.create("fetch"), hub().robots.create("freight")]


@pytest.fixture
def view(robots):
    return TopDown(
        World(name="room", bounds=(-5, -5, 5, 5), boxes=(Box(center=(0, -3), size=(2, 1)),)), robots
    )


def at(view, frame, x, y):
    column, row = view.canvas.pixels(np.array([[x, y]]))[0] // (1 << view.canvas.SHIFT)
    return tuple(int(value) for value in frame[row, column])


def test_robots_and_obstacles_appear_where_they_are(view):
    frame = view.frame(POSES)
    assert frame.shape == (720, 720, 3)
    assert frame.dtype == np.uint8
    assert at(view, frame, -2.0, 1.2) == view.colors[0]
    assert at(view, frame, 2.0, 1.2) == view.colors[1]
    assert max(at(view, frame, 0.0, -3.0)) < 140
    assert min(at(view, frame, 0.3, 3.2)) > 220


def test_frames_do_not_share_the_background(view):
    first = view.frame(POSES)
    again = first.copy()
    view.frame(POSES + 1)
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(view.frame(POSES), again)


def test_every_layer_changes_the_picture_and_bears_missing_values(view):
    goals = np.array([[0.0, 2.0], [np.nan, np.nan]])
    layers = {
        "scans": [np.full(222, 1.5), np.full(222, 25.0)],
        "goals": goals,
        "trails": np.stack([POSES - 1, POSES]),
        "clock": 3.0,
        "title": "room",
    }
    plain = view.frame(POSES)
    for name, value in layers.items():
        assert (view.frame(POSES, **{name: value}) != plain).any(), name
    assert at(view, view.frame(POSES, goals=goals), 0.0, 2.0) == view.colors[0]


def test_solid_mesh_is_filled(tmp_path, robots):
    trimesh.creation.box((2.0, 2.0, 2.0)).export(tmp_path / "cube.stl")
    view = TopDown(World(name="m", bounds=(-5, -5, 5, 5), meshes=(Mesh(file=tmp_path / "cube.stl"),)), robots)
    assert max(at(view, view.frame(POSES), 0.3, 0.3)) < 140


def test_colors_are_distinct_and_views_hold_the_robots(robots):
    colors = robot_colors(robots + robots)
    assert len(set(colors)) == 4
    x_min, y_min, x_max, y_max = close_view(World(name="room"), POSES)
    assert x_min < -2 < 2 < x_max
    assert y_min < 1 < y_max


def test_bad_sizes_and_views_are_refused(robots):
    with pytest.raises(ConfigError, match="64"):
        TopDown(World(name="room"), robots, size=(10, 10))
    with pytest.raises(ConfigError, match="view"):
        TopDown(World(name="room"), robots, view=(1, 1, 0, 0))


def test_distance_plot_takes_one_or_many_episodes(tmp_path):
    times = np.arange(0, 4, 0.2)
    many = np.linspace(5, 1, 20) + np.random.default_rng(0).normal(0, 0.1, (8, 20))
    many[3, 12:] = np.nan
    file = plot_distance(tmp_path / "new" / "d.png", times, {"hpp": many, "one": many[0]}, 0.85)
    assert file.read_bytes().startswith(b"\x89PNG")
    assert [path.name for path in file.parent.iterdir()] == ["d.png"]


def test_distance_plot_refuses_wrong_shapes_and_places(tmp_path):
    with pytest.raises(ConfigError, match="expected"):
        plot_distance(tmp_path / "d.png", np.arange(3), {"hpp": np.zeros((2, 4))}, 0.85)
    with pytest.raises(ConfigError, match="nothing"):
        plot_distance(tmp_path / "d.png", np.arange(3), {}, 0.85)
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(HppError, match="could not be written"):
        plot_distance(tmp_path / "file" / "d.png", np.arange(3), {"hpp": np.zeros(3)}, 0.85)
