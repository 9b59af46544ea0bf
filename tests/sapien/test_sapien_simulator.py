"""Determinism, interface, bad input, and life without Vulkan."""

import hashlib
import os
import subprocess
import sys

import pytest
import torch

from hpp_framework.core.world import Box, World
from hpp_framework.plugins.registry import hub
from hpp_framework.sim import make_simulator
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.errors import ConfigError, SimulatorError, UnknownNameError
from hpp_framework.utils.seeding import numpy_rng, torch_rng
from hpp_framework.worlds.spawn import spawn_poses

sapien = pytest.importorskip("hpp_framework.sim.sapien.simulator")

pytestmark = pytest.mark.sapien


def robots():
    return [hub().robots.create("fetch"), hub().robots.create("freight")]


def bumpy_episode():
    """Return a digest of every number of an episode with contacts."""
    boxes = tuple(
        Box(center=(x, y), size=(0.5, 0.5), yaw=x + y) for x in (-1.5, 0.0, 1.5) for y in (-1.0, 1.0)
    )
    world = World(name="bumpy", bounds=(-3.0, -3.0, 3.0, 3.0), boxes=boxes)
    simulator = sapien.SapienSimulator(robots())
    state = simulator.reset([world], torch.tensor([[[-2.3, 0.0, 0.0], [2.3, 0.0, 3.1]]]))
    rng = torch_rng(0, "bumpy")
    digest, touched = hashlib.sha256(), 0
    for step in range(40):
        drift = torch.randn(1, 2, 1, generator=rng) * (step > 10)
        state = simulator.step(torch.cat([torch.ones(1, 2, 1), drift], -1))
        touched += int(state.collided.sum())
        for part in (state.poses, state.velocities, state.scans, state.collided):
            digest.update(part.numpy().tobytes())
    assert touched > 5
    return digest.hexdigest()


def in_child(code, **environment):
    return subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "OMP_NUM_THREADS": "1", **environment},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def test_same_episode_bit_for_bit_here_and_in_another_process():
    here = bumpy_episode()
    assert bumpy_episode() == here
    code = (
        "import importlib.util as u; s = u.spec_from_file_location('t', r'" + __file__ + "');"
        "m = u.module_from_spec(s); s.loader.exec_module(m); print(m.bumpy_episode())"
    )
    done = in_child(code)
    assert done.stdout.split()[-1:] == [here], done.stderr


def test_state_looks_like_the_batch_simulators():
    world = World(name="room", bounds=(-3.0, -3.0, 3.0, 3.0))
    poses = torch.tensor([[[-1.0, 0.0, 0.0], [1.0, 0.0, 3.0]]] * 3)
    commands = torch.full((3, 2, 2), 0.5)
    states = []
    for simulator in (BatchSimulator(robots()), sapien.SapienSimulator(robots())):
        simulator.reset([world] * 3, poses)
        states.append(simulator.step(commands))
    for name in ("poses", "velocities", "scans", "collided"):
        flat, solid = (getattr(state, name) for state in states)
        assert flat.shape == solid.shape
        assert flat.dtype == solid.dtype
        torch.testing.assert_close(flat, solid, atol=0.01, rtol=0)


def test_returned_state_shares_no_memory():
    simulator = sapien.SapienSimulator(robots()[:1])
    state = simulator.reset([World(name="room")], torch.zeros(1, 1, 3))
    before = state.scans.clone()
    state.scans.zero_()
    state.velocities.fill_(3.0)
    after = simulator.step(torch.zeros(1, 1, 2))
    torch.testing.assert_close(after.scans, before)
    assert after.velocities.abs().max() == 0


def test_robots_at_rest_stay_where_they_are():
    simulator = sapien.SapienSimulator(robots())
    start = torch.tensor([[[-1.0, 0.0, 0.3], [1.0, 0.0, -2.0]]])
    simulator.reset([World(name="room")], start)
    for _ in range(5):
        state = simulator.step(torch.zeros(1, 2, 2))
    torch.testing.assert_close(state.poses, start, atol=1e-6, rtol=0)
    assert not state.collided.any()


def test_every_bundled_world_can_be_built():
    for entry in hub().worlds:
        world = hub().worlds.create(entry.name, numpy_rng(0))
        poses = torch.tensor(spawn_poses(world, robots(), numpy_rng(0)), dtype=torch.float32)
        with make_simulator("sapien", robots()) as simulator:
            simulator.reset([world], poses[None])
            state = simulator.step(torch.zeros(1, 2, 2))
        assert not state.collided.any(), entry.name


def test_bad_input_is_refused():
    simulator = make_simulator("sapien", robots())
    with pytest.raises(SimulatorError, match=r"before reset"):
        simulator.step(torch.zeros(1, 2, 2))
    with pytest.raises(SimulatorError, match=r"finite"):
        simulator.reset([World(name="room")], torch.full((1, 2, 3), float("nan")))
    simulator.reset([World(name="room")], torch.tensor([[[-1.0, 0, 0], [1.0, 0, 0]]]))
    with pytest.raises(SimulatorError, match=r"episode 0, robot 1"):
        simulator.step(torch.tensor([[[0.0, 0.0], [0.0, float("inf")]]]))
    with pytest.raises(SimulatorError, match=r"render="):
        simulator.picture()
    with pytest.raises(SimulatorError, match=r"at least one robot"):
        make_simulator("sapien", [])
    with pytest.raises(UnknownNameError, match=r"Did you mean 'sapien'"):
        make_simulator("sapein", robots())
    with pytest.raises(ConfigError, match=r"CPU"):
        make_simulator("sapien", robots(), device="cuda")
    with pytest.raises(ConfigError, match=r"pictures"):
        make_simulator("batch", robots(), render=(64, 48))


def test_a_missing_package_is_explained():
    code = (
        "import sys; sys.modules['sapien'] = None\n"
        "from hpp_framework.plugins.registry import hub\n"
        "from hpp_framework.sim import make_simulator\n"
        "from hpp_framework.utils.errors import SimulatorError\n"
        "try:\n    make_simulator('sapien', [hub().robots.create('fetch')])\n"
        "except SimulatorError as error:\n    print(error)\n"
    )
    done = in_child(code)
    assert "cannot be imported" in done.stdout, done.stderr
    assert "pip install" in done.stdout


def test_without_vulkan_physics_works_and_pictures_are_refused():
    code = (
        "import torch\n"
        "from hpp_framework.utils.errors import SimulatorError\n"
        "from hpp_framework.plugins.registry import hub\n"
        "from hpp_framework.sim import make_simulator, rendering_problem\n"
        "from hpp_framework.core.world import World\n"
        "robots = [hub().robots.create('fetch')]\n"
        "with make_simulator('sapien', robots) as simulator:\n"
        "    simulator.reset([World(name='room')], torch.zeros(1, 1, 3))\n"
        "    state = simulator.step(torch.ones(1, 1, 2))\n"
        "print('MOVED', state.poses[0, 0, 0].item() > 0)\n"
        "print('PROBLEM', rendering_problem())\n"
        "try:\n    make_simulator('sapien', robots, render=(64, 48))\n"
        "except SimulatorError as error:\n    print('REFUSED', error)\n"
    )
    done = in_child(code, VK_DRIVER_FILES="/nonexistent", VK_ICD_FILENAMES="/nonexistent")
    assert done.returncode == 0, done.stderr
    assert "MOVED True" in done.stdout
    assert "PROBLEM SAPIEN cannot draw" in done.stdout
    assert "bookworm-backports" in done.stdout.split("REFUSED")[1]
