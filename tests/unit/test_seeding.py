"""Named child generators, and random streams of episodes."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
import torch

from hpp_framework.utils.seeding import EpisodeRng, child_seed, numpy_rng, torch_rng


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


SEEDS = [child_seed(seed, "rng") for seed in range(500)]


@pytest.mark.parametrize("draw", ["uniform", "normal", "integers"])
def test_an_episode_draws_the_same_numbers_alone_and_in_any_batch(draw):
    def draws(seeds):
        rng = EpisodeRng(seeds)
        number = getattr(rng, draw)
        shapes = [(), (3,), (2, 4)]
        return [number(1000, *shape) if draw == "integers" else number(*shape) for shape in shapes]

    together = draws(SEEDS[:6])
    assert [tuple(each.shape) for each in together] == [(6,), (6, 3), (6, 2, 4)]
    for row in (0, 3, 5):
        for one, all_ in zip(draws([SEEDS[row]]), together, strict=True):
            assert torch.equal(one[0], all_[row])
    for one, all_ in zip(draws(SEEDS[5::-1]), together, strict=True):
        assert torch.equal(one, all_.flip(0))


def test_numbers_do_not_depend_on_how_they_are_asked_for():
    at_once = EpisodeRng(SEEDS[:3]).uniform(6)
    rng = EpisodeRng(SEEDS[:3])
    parts = [rng.uniform(2), rng.uniform(1), rng.uniform(3)]
    assert torch.equal(torch.cat(parts, 1), at_once)
    # pinned: a result must be repeatable on another machine and in a year
    assert (EpisodeRng([0]).integers(2**31, 3)[0]).tolist() == [1896895516, 926699317, 56766092]


def test_moments_are_those_of_the_distributions():
    """500 episodes, 400 numbers each: standard errors of means are about 0.002."""
    uniform, normal = EpisodeRng(SEEDS).uniform(400), EpisodeRng(SEEDS).normal(400)
    integers = EpisodeRng(SEEDS).integers(6, 400)
    assert 0 <= float(uniform.min()) < 1e-4
    assert 1 - 1e-4 < float(uniform.max()) < 1
    assert float(uniform.mean()) == pytest.approx(1 / 2, abs=0.004)
    assert float(uniform.var()) == pytest.approx(1 / 12, abs=0.002)
    assert bool(normal.isfinite().all())
    moments = [float((normal**power).mean()) for power in (1, 2, 3, 4)]
    assert moments == pytest.approx([0, 1, 0, 3], abs=0.1)
    assert float((normal.abs() > 3).float().mean()) == pytest.approx(0.0027, abs=0.0006)
    shares = torch.bincount(integers.flatten(), minlength=6) / integers.numel()
    assert shares.tolist() == pytest.approx([1 / 6] * 6, abs=0.005)


@pytest.mark.parametrize("seeds", [SEEDS, list(range(500))], ids=["child seeds", "neighbouring numbers"])
def test_neighbours_are_independent(seeds):
    """Of episodes, also of seeds that follow one another, and of numbers of one episode."""
    numbers = EpisodeRng(seeds).normal(400)
    for one, other in ((numbers[:-1], numbers[1:]), (numbers[:, :-1], numbers[:, 1:])):
        correlation = torch.corrcoef(torch.stack([one.flatten(), other.flatten()]))[0, 1]
        assert abs(float(correlation)) < 4 / math.sqrt(one.numel())
    of_rows = torch.corrcoef(numbers)
    of_rows.fill_diagonal_(0)
    assert float(of_rows.abs().max()) < 6 / math.sqrt(400)
    # streams of one episode that begin at another's seed would share numbers, shifted
    assert len(EpisodeRng(seeds).integers(2**31, 40).unique()) > 0.99 * 500 * 40


def test_reseeded_episodes_begin_anew_and_others_go_on():
    rng, same = EpisodeRng(SEEDS[:4]), EpisodeRng(SEEDS[:4])
    rng.normal(5), same.normal(5)
    rng.reseed(torch.tensor([False, True, False, True]), [SEEDS[10], SEEDS[1]])
    mixed, gone_on = rng.normal(3), same.normal(3)
    assert torch.equal(mixed[[0, 2]], gone_on[[0, 2]])
    assert torch.equal(mixed[[1, 3]], EpisodeRng([SEEDS[10], SEEDS[1]]).normal(3))
    assert len(rng) == 4


def test_no_other_generator_is_touched_by_episodes():
    before = torch.get_rng_state().clone()
    EpisodeRng([1]).normal(5)
    assert torch.equal(torch.get_rng_state(), before)
