"""Sharing a step out to threads, and the live state that a step leaves."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch

from hpp_framework.core.types import State
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.errors import SimulatorError
from hpp_framework.utils.thread_pool import FEWEST, ThreadPool

EPISODES = 5 * FEWEST + 3

ALWAYS = [field.name for field in dataclasses.fields(State) if field.default is dataclasses.MISSING]
"""What states hold also where nothing moves but robots."""


def final_state(pair, worlds, threads: int) -> State:
    rng = np.random.default_rng(2)
    poses = torch.tensor(rng.uniform((-3, -3, -3), (3, 3, 3), (EPISODES, 2, 3)), dtype=torch.float32)
    moves = torch.tensor(rng.uniform((0, -2), (1, 2), (20, EPISODES, 2, 2)), dtype=torch.float32)
    with BatchSimulator(pair, threads=threads) as simulator:
        simulator.reset([worlds[index % len(worlds)] for index in range(EPISODES)], poses)
        for move in moves:
            state = simulator.step(move)
    return state


def test_any_number_of_threads_gives_the_same_bits(pair, small_world, empty_world):
    alone, *others = (final_state(pair, [small_world, empty_world], threads) for threads in (1, 2, 3))
    assert bool(alone.collided.any())
    for other in others:
        for name in ALWAYS:
            assert torch.equal(getattr(alone, name), getattr(other, name)), name


def test_advance_steps_in_the_memory_of_the_simulator(pair, small_world):
    simulators = [BatchSimulator(pair, threads=1) for _ in range(2)]
    poses = torch.tensor([[[-2.0, 0, 0], [2, 0, 0]]])
    command = torch.tensor([[[1.0, 0.3], [0.5, -0.2]]])
    for simulator in simulators:
        simulator.reset([small_world], poses)
    live = simulators[0].advance(command)
    for _ in range(3):
        simulators[0].advance(command)
    for _ in range(4):
        copied = simulators[1].step(command)
    for name in ALWAYS:
        assert torch.equal(getattr(live, name), getattr(copied, name)), name


@pytest.mark.parametrize("threads", [0, -1])
def test_threads_are_positive(pair, threads):
    with pytest.raises(SimulatorError, match="threads must be at least 1"):
        BatchSimulator(pair, threads=threads)


@pytest.mark.parametrize("size", [1, FEWEST, 1000])
def test_slices_cover_everything_once(size):
    slices = ThreadPool(3).slices(size)
    assert [index for start, stop in slices for index in range(start, stop)] == list(range(size))


def test_an_error_in_a_helping_thread_is_raised():
    def fail() -> None:
        raise ValueError("broken")

    threads = ThreadPool(2)
    with pytest.raises(ValueError, match="broken"):
        threads.run([fail, fail])
    threads.close()
    threads.close()
