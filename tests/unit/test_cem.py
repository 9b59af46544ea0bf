"""The cross-entropy method, judged by the quality of what it finds."""

from __future__ import annotations

import pytest
import torch

from hpp_framework.planning.hpp.cem import CemConfig, cross_entropy
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.seeding import EpisodeRng

TARGET = torch.tensor([[1.0, -2.0], [3.0, 0.5]])


def bowl(samples):
    return -(samples - TARGET[:, None]).square().sum(-1)


def search(seed=0, objective=bowl, rows=2, **config):
    return cross_entropy(
        objective,
        torch.zeros(rows, 2),
        torch.full((rows, 2), 2.0),
        EpisodeRng(range(rows * seed, rows * (seed + 1))),
        CemConfig(**config),
    )


def test_finds_the_optimum_of_each_row():
    found = search(iterations=30, samples=60, elites=10)
    assert torch.allclose(found.mean, TARGET, atol=0.05)


def test_same_seed_same_result():
    assert torch.equal(search(seed=3).mean, search(seed=3).mean)
    assert not torch.equal(search(seed=3).mean, search(seed=4).mean)


def test_more_samples_are_not_worse():
    def error(samples):
        runs = [search(seed=s, samples=samples, elites=5, iterations=5).mean for s in range(20)]
        return torch.stack([(mean - TARGET).norm(dim=1).mean() for mean in runs]).mean()

    assert error(60) < error(15) + 1e-3


def test_stops_once_certain():
    calls = []

    def counting(samples):
        calls.append(1)
        return bowl(samples)

    search(objective=counting, iterations=200, epsilon=0.5)
    assert len(calls) < 200
    before = len(calls)
    cross_entropy(
        counting, torch.zeros(2, 2), torch.full((2, 2), 1e-4), EpisodeRng([0, 1]), CemConfig(epsilon=1e-3)
    )
    assert len(calls) == before  # certain from the start: nothing to search


def test_converged_rows_stay_put():
    mean = torch.tensor([[5.0, 5.0], [0.0, 0.0]])
    std = torch.tensor([[1e-5, 1e-5], [2.0, 2.0]])
    found = cross_entropy(bowl, mean, std, EpisodeRng([0, 1]), CemConfig(iterations=3))
    assert torch.equal(found.mean[0], mean[0])
    assert not torch.equal(found.mean[1], mean[1])


def test_a_row_alone_finds_the_same():
    together = search(objective=bowl, iterations=5)
    alone = cross_entropy(
        lambda samples: -(samples - TARGET[1:, None]).square().sum(-1), torch.zeros(1, 2),
        torch.full((1, 2), 2.0), EpisodeRng([1]), CemConfig(iterations=5),
    )  # fmt: skip
    assert torch.equal(alone.mean[0], together.mean[1])


@pytest.mark.parametrize("bad", [{"iterations": 0}, {"elites": 0}, {"elites": 16}, {"epsilon": -1.0}])
def test_bad_parameters_are_refused(bad):
    with pytest.raises(ConfigError):
        CemConfig(**bad)
