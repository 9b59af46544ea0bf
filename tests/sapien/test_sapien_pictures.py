"""Pictures; they need a Vulkan device and say what is missing where there is none."""

import numpy as np
import pytest
import torch
import trimesh

from hpp_framework.core.world import Box, Cylinder, Mesh, World
from hpp_framework.plugins.registry import hub
from hpp_framework.sim import make_simulator, rendering_problem
from hpp_framework.utils.errors import ConfigError, SimulatorError

pytest.importorskip("hpp_framework.sim.sapien.simulator")
from hpp_framework.sim.sapien.camera import SceneCamera, View, team_view  # needs the package

pytestmark = [pytest.mark.sapien, pytest.mark.render]

SIZE = (160, 120)
LEAST = 0.0005
"""Share of half a picture that a robot's own colour covers at least."""
WALL = World(name="wall", bounds=(-6, -6, 6, 6), boxes=(Box(center=(0.0, 0.0), size=(0.3, 4.0)),))
START = torch.tensor([[[-2.5, 0.0, 0.0], [2.5, 0.0, 3.0]]])


@pytest.fixture(autouse=True)
def _vulkan():
    problem = rendering_problem()
    if problem is not None:
        pytest.skip(problem)


def robots():
    return [hub().robots.create("fetch"), hub().robots.create("freight")]


def share(image, test):
    """Return the share of pixels whose (red, green, blue) passes a test."""
    return float(np.mean(test(*np.moveaxis(image.astype(float), -1, 0))))


def orange(red, green, blue):
    return (red > 1.6 * blue) & (red > 1.15 * green) & (red > 130)


def azure(red, green, blue):
    return (blue > 1.6 * red) & (blue > 110)


def test_a_picture_shows_both_robots_and_the_wall():
    with make_simulator("sapien", robots(), render=(320, 240)) as simulator:
        simulator.reset([WALL], START)
        image = simulator.picture()
        assert image.shape == (240, 320, 3)
        assert image.dtype == np.uint8
        left, right = image[:, :120], image[:, 200:]
        # either side shows one robot's own colour
        assert {share(left, orange) > LEAST, share(right, orange) > LEAST} == {True, False}
        assert {share(left, azure) > LEAST, share(right, azure) > LEAST} == {True, False}
        for _ in range(5):
            simulator.step(torch.tensor([[[1.0, 0.5], [1.0, 0.5]]]))
        assert np.mean(simulator.picture() != image) > 0.001
        with pytest.raises(SimulatorError, match=r"no episode 1"):
            simulator.picture(1)


def test_pictures_do_not_touch_the_physics():
    def episode(render):
        with make_simulator("sapien", robots(), render=SIZE if render else None) as simulator:
            simulator.reset([WALL], START)
            for _ in range(10):
                state = simulator.step(torch.tensor([[[1.0, 0.2], [1.0, 0.1]]]))
                if render:
                    simulator.picture()
        return state

    drawn, plain = episode(True), episode(False)
    assert torch.equal(drawn.poses, plain.poses)
    assert torch.equal(drawn.scans, plain.scans)


def test_cameras_do_not_see_each_others_worlds():
    view = View(eye=(-4.0, -4.0, 3.0), target=(0.0, 0.0, 0.0))
    poses = np.zeros((1, 3))
    empty = World(name="empty", walled=False)
    first = SceneCamera(empty, robots()[:1], view, size=SIZE)
    before = first.picture(poses)
    crowded = World(name="crowded", cylinders=(Cylinder(center=(0.0, 1.5), radius=1.0),))
    second = SceneCamera(crowded, robots()[:1], view, size=SIZE)
    assert not np.array_equal(second.picture(poses), before)
    assert np.array_equal(first.picture(poses), before)


@pytest.mark.parametrize("size", [(320, 240), (160, 120), (96, 128)])
def test_light_does_not_depend_on_what_was_drawn_before(size):
    view = View(eye=(4.0, 0.0, 2.0), target=(0.0, 0.0, 0.5))
    image = SceneCamera(World(name="bare"), robots()[:1], view, size=size).picture(
        np.array([[0.0, 3.0, 0.0]])
    )
    floor = image[-size[1] // 6, size[0] // 2]
    assert 120 < floor.min() <= floor.max() < 220


def test_meshes_are_visible_from_both_sides(tmp_path):
    sheet = trimesh.Trimesh([[0, -1, 0], [0, 1, 0], [0, 1, 1], [0, -1, 1]], [[0, 1, 2], [0, 2, 3]])
    sheet.export(tmp_path / "sheet.ply")
    world = World(name="sheet", walled=False, meshes=(Mesh(file=tmp_path / "sheet.ply"),))
    bare = World(name="bare", walled=False)
    for side in (-4.0, 4.0):
        view = View(eye=(side, 0.0, 2.0), target=(0.0, 0.0, 0.5))
        poses = np.array([[0.0, 4.0, 0.0]])
        seen, empty = (SceneCamera(w, robots()[:1], view, size=SIZE).picture(poses) for w in (world, bare))
        assert np.mean(np.any(seen != empty, axis=-1)) > 0.05


def test_the_view_holds_the_whole_team():
    for poses in (START[0], torch.zeros(1, 3), torch.tensor([[4.0, 4, 0], [-1.0, 4, 0], [1.5, 5.5, 0]])):
        view = team_view(WALL, poses)
        assert view.eye[2] > 3.0
        assert np.linalg.norm(view.eye) < 25.0
    paths = torch.tensor([[-2.5, 0.0], [-2.0, 5.5], [2.5, 5.5]])
    assert team_view(WALL, START[0], paths=paths).eye[2] > team_view(WALL, START[0]).eye[2]
    with pytest.raises(ConfigError, match=r"at least 1 pixel"):
        SceneCamera(WALL, robots(), view, size=(0, 10))
