"""Statistics against published numbers and other implementations."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy import stats

from hpp_framework.evaluation.bootstrap import (
    improvement,
    interquartile_mean,
    optimality_gap,
    performance_profile,
)
from hpp_framework.evaluation.statistics import (
    mcnemar_p,
    paired_difference,
    rate,
    signed_rank_p,
    wilson_interval,
)

NONE = np.nan

CHILDREN, CHEMOTHERAPY, MEDIA, NO_LOSERS = (1, 1, 7, 12), (59, 6, 16, 80), (20, 12, 2, 16), (36, 12, 2, 0)
"""Pairs of which both, only the first, only the second and neither succeed."""


def rng():
    return np.random.default_rng(5)


def pairs(both, only_first, only_second, neither):
    counts = [both, only_first, only_second, neither]
    return np.repeat([True, True, False, False], counts), np.repeat([True, False, True, False], counts)


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    # Brown, Cai and DasGupta 2001; Newcombe 1998, Statistics in Medicine 17:857, table I, method 3
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilson_interval_matches_published_values(successes, trials, low, high):
    found = wilson_interval(successes, trials)
    assert found == pytest.approx((low, high), abs=1e-4)


def test_wilson_without_trials_knows_nothing():
    assert wilson_interval(0, 0) == (0.0, 1.0)


def test_a_rate_is_its_share_with_wilson_interval():
    found = rate(np.arange(263) < 81)
    assert (found.value, found.low, found.high) == pytest.approx((81 / 263, 0.2553, 0.3662), abs=1e-4)


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        # Armitage and Berry 1994, page 127: two culture media; interval as StatsDirect's manual has it
        (MEDIA, (0.2, 0.056156, 0.329207)),
        # Newcombe 1998, Statistics in Medicine 17:2635, method 10
        (NO_LOSERS, (0.2, 0.0569, 0.3404)),
        # Bentur et al. 2009 in Fagerland et al. 2014, Statistics in Medicine 33:2850
        (CHILDREN, (-0.286, -0.507, -0.026)),
    ],
)
def test_paired_differences_match_published_intervals(table, expected):
    found = paired_difference(*pairs(*table))
    assert (found.value, found.low, found.high) == pytest.approx(expected, abs=6e-4)
    turned = paired_difference(*pairs(*table)[::-1])
    assert (turned.value, turned.low, turned.high) == pytest.approx((-found.value, -found.high, -found.low))


@pytest.mark.parametrize(
    ("table", "expected"),
    # Fagerland, Lydersen and Laake 2013, BMC Medical Research Methodology 13:91; Armitage and Berry
    [(CHILDREN, 0.0703), (CHEMOTHERAPY, 0.0525), (MEDIA, 0.0129), ((5, 0, 0, 3), 1.0)],
)
def test_mcnemar_matches_published_values(table, expected):
    assert mcnemar_p(*pairs(*table)) == pytest.approx(expected, abs=5e-5)
    assert mcnemar_p(*pairs(*table)[::-1]) == mcnemar_p(*pairs(*table))


def test_mcnemar_is_the_share_of_coin_tosses_at_least_as_lopsided():
    tosses = [abs(2 * sum(each) - 9) for each in itertools.product([0, 1], repeat=9)]
    expected = np.mean(np.array(tosses) >= 5)
    assert mcnemar_p(*pairs(3, 2, 7, 4)) == pytest.approx(expected)


def test_signed_ranks_match_published_values():
    """Darwin's maize (Fisher 1935, The Design of Experiments): T = 24, P = 0.041."""
    inches = np.array([49, -67, 8, 16, 6, 23, 28, 41, 14, 29, 56, 24, 75, 60, -48]) / 8
    selfed = np.linspace(10, 20, len(inches))
    with_failures = np.append(selfed + inches, [NONE, 3.0, NONE]), np.append(selfed, [1.0, NONE, NONE])
    assert signed_rank_p(*with_failures) == pytest.approx(0.0413, abs=5e-5)


def test_signed_ranks_are_exact_with_ties():
    """All signs are equally probable: enumerated, with differences that are equal but for rounding."""
    first, second = np.array([1.2, 0.6, 2.0, 3.2, 4.0]), np.array([1.0, 0.4, 1.8, 2.6, 3.0])
    ranks = stats.rankdata([0.2, 0.2, 0.2, 0.6, 1.0])
    sums = [abs(np.dot(signs, ranks)) for signs in itertools.product([-1, 1], repeat=5)]
    assert signed_rank_p(first, second) == pytest.approx(np.mean(np.array(sums) >= ranks.sum() - 1e-9))


def test_signed_ranks_without_anything_to_rank():
    assert signed_rank_p(np.array([1.0, NONE]), np.array([NONE, 1.0])) is None
    assert signed_rank_p(np.array([1.0, 2.0]), np.array([1.0, 2.0])) == 1.0


def test_the_interquartile_mean_leaves_out_both_ends():
    scores = np.array([-50.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 900.0])
    assert interquartile_mean([scores], rng()).value == 2.5
    assert interquartile_mean([scores[::2], scores[1::2]], rng()).value == 2.5


def test_the_interquartile_mean_of_one_world_has_the_interval_of_scipy():
    scores = rng().gamma(2.0, size=60)
    found = interquartile_mean([scores], rng())
    theirs = stats.bootstrap(
        (scores,), lambda each, axis: stats.trim_mean(each, 0.25, axis=axis), n_resamples=20000,
        method="percentile", rng=rng(),
    ).confidence_interval  # fmt: skip
    assert found.value == stats.trim_mean(scores, 0.25)
    width = theirs.high - theirs.low
    assert (found.low, found.high) == pytest.approx((theirs.low, theirs.high), abs=0.05 * width)


def test_worlds_are_resampled_each_by_itself():
    """All ways to draw 3 x 2 episodes again, enumerated; drawing across worlds would reach farther."""
    easy, hard = np.array([0.8, 0.9, 1.0]), np.array([0.0, 0.3])
    means = [
        np.mean(one + two)
        for one in itertools.product(easy.tolist(), repeat=3)
        for two in itertools.product(hard.tolist(), repeat=2)
    ]
    low, high = np.quantile(means, [0.025, 0.975])
    found = optimality_gap([easy, hard], rng())
    assert found.value == pytest.approx(1 - 0.6)
    assert (found.low, found.high) == pytest.approx((1 - high, 1 - low), abs=0.03)
    assert found.high < 0.55  # were the worlds mixed: above 0.7


def test_what_exceeds_the_best_closes_no_gap():
    assert optimality_gap([np.array([2.0, 0.5])], rng()).value == 0.25
    assert optimality_gap([np.array([2.0, 0.5])], rng(), best=2.0).value == 0.75


def test_improvement_counts_failures_and_ties():
    first = [np.array([1.0, 2.0, NONE, NONE]), np.array([3.0])]
    second = [np.array([2.0, 2.0, NONE, 5.0]), np.array([NONE])]
    found = improvement(first, second, rng())
    assert found.value == pytest.approx((1 + 0.5 + 0.5 + 0 + 1) / 5)
    # the lone episode of its world is drawn every time
    drawn = [(sum(each) + 1) / 5 for each in itertools.product([1, 0.5, 0.5, 0], repeat=4)]
    assert [found.low, found.high] == pytest.approx(np.quantile(drawn, [0.025, 0.975]).tolist(), abs=1e-9)


def test_improvement_is_half_the_sum_of_both_ways():
    times = rng().uniform(3, 9, (2, 40)).round(0)
    one, two = improvement([times[0]], [times[1]], rng()), improvement([times[1]], [times[0]], rng())
    assert one.value + two.value == pytest.approx(1)
    assert (one.low, one.high) == pytest.approx((1 - two.high, 1 - two.low))


def test_profiles_count_what_lies_above_and_have_binomial_bands():
    scores = [np.array([0.0, 0.0, 0.4, 0.6]).repeat(25), np.array([0.6, 1.0]).repeat(50)]
    found = performance_profile(scores, np.array([0.0, 0.4, 0.6, 1.0]), rng())
    assert found.share.tolist() == [0.75, 0.625, 0.25, 0.0]
    # above 0: 50 of 100 in the first world, all of the second
    expected = 0.5 + stats.binom(100, 0.5).ppf([0.025, 0.975]) / 200
    assert (found.low[0], found.high[0]) == pytest.approx(expected, abs=0.011)
    assert found.low[3] == found.high[3] == 0


def test_the_same_seed_gives_the_same_interval():
    scores = [rng().random(20)]
    assert interquartile_mean(scores, rng()) == interquartile_mean(scores, rng())
