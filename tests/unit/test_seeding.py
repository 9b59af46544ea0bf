"""Named child generators."""

from __future__ import annotations

import random

import numpy as np
import torch

from hpp_framework.utils.seeding import child_seed, numpy_rng, torch_rng


def test_equal_paths_give_equal_seeds_everywhere():
    # pinned: a result must be repeatable on another machine and in a year
    assert child_seed(0, "pool", "training", 3) == child_seed(0, "pool", "training", "3")
    assert child_seed(0) == 4246866556266386882


def test_different_paths_give_different_seeds():
    paths = [(seed, name, index) for seed in range(20) for name in ("a", "b") for index in range(20)]
    assert len({child_seed(seed, name, index) for seed, name, index in paths}) == len(paths)
    assert child_seed(1, "a", "b") != child_seed(1, "b", "a")


def test_seeds_fit_torch_and_numpy():
    assert all(0 <= child_seed(seed) < 2**63 for seed in range(-50, 50))


def test_generators_repeat_and_are_independent():
    assert np.array_equal(numpy_rng(3, "x").random(5), numpy_rng(3, "x").random(5))
    assert not np.array_equal(numpy_rng(3, "x").random(5), numpy_rng(3, "y").random(5))
    assert torch.equal(torch.rand(5, generator=torch_rng(3, "x")), torch.rand(5, generator=torch_rng(3, "x")))


def test_global_generators_are_left_alone():
    random.seed(1)
    torch.manual_seed(1)
    before = (random.getstate(), torch.get_rng_state().clone())
    torch.rand(3, generator=torch_rng(0, "x"))
    numpy_rng(0, "x").random(3)
    assert random.getstate() == before[0]
    assert torch.equal(torch.get_rng_state(), before[1])
