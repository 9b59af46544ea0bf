"""The batch simulator's drive: limits, exact integration, determinism, independence of the batch."""

from __future__ import annotations

import dataclasses
import math

import jaxtyping
import numpy as np
import pytest
import torch

from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.world import World
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.sim.factory import make_simulator
from hpp_framework.sim.simulator import SUBSTEPS
from hpp_framework.utils.errors import SimulatorError


def commands(*rows: tuple[float, float]) -> torch.Tensor:
    return torch.tensor([rows], dtype=torch.float32)


def start(robots, world: World, *poses: tuple[float, float, float]) -> BatchSimulator:
    simulator = BatchSimulator(robots)
    simulator.reset([world], torch.tensor([poses], dtype=torch.float32))
    return simulator


def test_acceleration_from_rest_is_exact(fetch, empty_world):
    simulator = start([fetch], empty_world, (-5, 1, 0))
    for step in range(1, 11):
        state = simulator.step(commands((1.0, 0.0)))
        time = step * CONTROL_PERIOD
        assert state.velocities[0, 0, 0].item() == pytest.approx(0.4 * time, abs=1e-5)
        assert state.poses[0, 0, 0].item() == pytest.approx(-5 + 0.2 * time**2, abs=1e-5)
        assert state.poses[0, 0, 1].item() == pytest.approx(1.0, abs=1e-6)
    assert state.velocities[0, 0, 1].item() == 0


def test_turning_from_rest_is_exact(fetch, empty_world):
    simulator = start([fetch], empty_world, (0, 0, 0))
    for step in range(1, 8):
        state = simulator.step(commands((0.0, 3.0)))
        time = step * CONTROL_PERIOD
        assert state.velocities[0, 0, 1].item() == pytest.approx(1.48 * time, abs=1e-5)
        assert state.poses[0, 0, 2].item() == pytest.approx(0.74 * time**2, abs=1e-5)
    assert state.poses[0, 0, :2].tolist() == [0, 0]


def test_a_constant_command_drives_an_arc(fetch, empty_world):
    quick = dataclasses.replace(
        fetch, drive=dataclasses.replace(fetch.drive, acceleration=1e3, turn_acceleration=1e3)
    )
    simulator = start([quick], empty_world, (0, 0, 0))
    simulator.step(commands((0.5, 0.5)))
    x, y, theta = simulator.state().poses[0, 0].tolist()
    for _ in range(20):
        state = simulator.step(commands((0.5, 0.5)))
    turned = theta + 0.5 * 20 * CONTROL_PERIOD
    # radius v / omega = 1 m
    wanted = [x + math.sin(turned) - math.sin(theta), y - math.cos(turned) + math.cos(theta), turned]
    assert state.poses[0, 0].tolist() == pytest.approx(wanted, abs=2e-4)


def test_speeds_and_accelerations_stay_within_the_limits(pair, empty_world):
    simulator = start(pair, empty_world, (-5, 0, 0), (5, 0, 0))
    rng = np.random.default_rng(1)
    before = simulator.state().velocities
    for _ in range(60):
        state = simulator.step(torch.tensor(rng.uniform(-10, 10, (1, 2, 2)), dtype=torch.float32))
        v, w = state.velocities[..., 0], state.velocities[..., 1]
        assert float(v.min()) >= 0.0
        assert float(v.max()) <= 1.0 + 1e-6
        assert float(w.abs().max()) <= 3.0 + 1e-6
        change = (state.velocities - before).abs() / CONTROL_PERIOD
        assert float(change[..., 0].max()) <= 0.4 + 1e-4
        assert float(change[..., 1].max()) <= 1.48 + 1e-4
        before = state.velocities


def test_speed_saturates_and_the_paper_drive_never_reverses(fetch, empty_world):
    simulator = start([fetch], empty_world, (-8, 0, 0))
    for _ in range(20):
        state = simulator.step(commands((5.0, 0.0)))
    assert state.velocities[0, 0, 0].item() == pytest.approx(1.0)
    for _ in range(20):
        state = simulator.step(commands((-5.0, 0.0)))
    assert state.velocities[0, 0, 0].item() == 0.0


def test_robots_that_may_reverse_do(fetch, empty_world):
    shuttle = dataclasses.replace(fetch, drive=dataclasses.replace(fetch.drive, speed=(-0.5, 1.0)))
    simulator = start([shuttle], empty_world, (0, 0, 0))
    for _ in range(20):
        state = simulator.step(commands((-5.0, 0.0)))
    assert state.velocities[0, 0, 0].item() == pytest.approx(-0.5)
    assert state.poses[0, 0, 0].item() < -1


def test_headings_stay_wrapped(fetch, empty_world):
    simulator = start([fetch], empty_world, (0, 0, 3.0))
    for _ in range(50):
        heading = simulator.step(commands((0.0, 3.0))).poses[0, 0, 2].item()
        assert -math.pi <= heading <= math.pi


def test_equal_inputs_give_equal_bits(pair, small_world):
    def run() -> torch.Tensor:
        simulator = start(pair, small_world, (-2, 0, 0.1), (2, 0, 3.0))
        rng = np.random.default_rng(5)
        states = [
            simulator.step(torch.tensor(rng.uniform(-1, 2, (1, 2, 2)), dtype=torch.float32))
            for _ in range(60)
        ]
        return torch.cat([torch.cat([s.poses.flatten(), s.scans.flatten()]) for s in states])

    assert torch.equal(run(), run())


def test_episodes_do_not_depend_on_their_neighbours(pair, small_world, empty_world):
    """Sixteen episodes in one batch equal sixteen batches of one, bit for bit."""
    rng = np.random.default_rng(6)
    worlds = [small_world if index % 3 else empty_world for index in range(16)]
    poses = np.stack(
        [rng.uniform(-1, 1, (16, 2)), rng.uniform(-1, 1, (16, 2)), rng.uniform(-3, 3, (16, 2))], -1
    )
    poses[:, 1, 0] += 2.0
    poses[:, 0, 0] -= 1.0
    poses = torch.tensor(poses, dtype=torch.float32)
    moves = torch.tensor(rng.uniform(-1, 2, (30, 16, 2, 2)), dtype=torch.float32)
    together = BatchSimulator(pair)
    together.reset(worlds, poses)
    for move in moves:
        batched = together.step(move)
    for index in range(16):
        alone = BatchSimulator(pair)
        alone.reset([worlds[index]], poses[index : index + 1])
        for move in moves:
            single = alone.step(move[index : index + 1])
        for name in ("poses", "velocities", "scans", "collided"):
            assert torch.equal(getattr(batched, name)[index], getattr(single, name)[0]), (index, name)


def test_states_share_no_memory_with_the_simulator(pair, small_world):
    simulator = start(pair, small_world, (-2, 0, 0), (2, 0, 0))
    early = simulator.state()
    known = {field.name: getattr(early, field.name) for field in dataclasses.fields(early)}
    copies = {name: value.clone() for name, value in known.items() if value is not None}
    simulator.step(commands((1, 1), (1, 1)))
    assert all(torch.equal(getattr(early, name), copy) for name, copy in copies.items())
    simulator.state().poses.fill_(9)
    assert float(simulator.state().poses.abs().max()) < 9


def test_place_moves_only_the_chosen_and_puts_them_at_rest(pair, small_world):
    simulator = BatchSimulator(pair)
    simulator.reset([small_world] * 2, torch.tensor([[[-2.0, 0, 0], [2, 0, 0]]] * 2))
    for _ in range(3):
        before = simulator.step(commands((1, 0), (1, 0)).repeat(2, 1, 1))
    chosen = torch.tensor([[True, False], [False, False]])
    poses = torch.full((2, 2, 3), 1.0)
    after = simulator.place(torch.zeros(2, dtype=torch.int32), chosen, poses)
    assert after.poses[0, 0].tolist() == [1, 1, 1]
    assert after.velocities[0, 0].tolist() == [0, 0]
    assert torch.equal(after.poses[0, 1], before.poses[0, 1])
    assert torch.equal(after.velocities[1], before.velocities[1])


@pytest.mark.parametrize("shape", [(1, 2), (1, 3, 2), (2, 2, 2), (1, 2, 3)])
def test_commands_of_a_wrong_shape(pair, small_world, shape):
    simulator = start(pair, small_world, (-2, 0, 0), (2, 0, 0))
    with pytest.raises((SimulatorError, jaxtyping.TypeCheckError)):
        simulator.step(torch.zeros(shape))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_commands_that_are_not_finite_name_episode_and_robot(pair, small_world, bad):
    simulator = start(pair, small_world, (-2, 0, 0), (2, 0, 0))
    with pytest.raises(SimulatorError, match="command of episode 0, robot 1 is not finite"):
        simulator.step(commands((0, 0), (0, bad)))


def test_bad_resets(pair, small_world):
    simulator = BatchSimulator(pair)
    with pytest.raises(SimulatorError, match="poses must be finite"):
        simulator.reset([small_world], torch.full((1, 2, 3), math.nan))
    with pytest.raises(SimulatorError, match=r"poses must have shape \(1, 2, 3\)"):
        simulator.reset([small_world], torch.zeros(2, 2, 3))
    with pytest.raises(SimulatorError, match="at least one robot"):
        BatchSimulator([])


def test_factory_and_context_manager(pair, small_world):
    with make_simulator("batch", pair) as simulator:
        state = simulator.reset([small_world], torch.tensor([[[-2.0, 0, 0], [2, 0, 0]]]))
    assert state.scans.shape == (1, 2, 222)
    assert SUBSTEPS >= 1
