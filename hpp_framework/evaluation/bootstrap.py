"""Numbers over several worlds, with intervals from a stratified bootstrap (Agarwal et al. 2021).

"Deep Reinforcement Learning at the Edge of the Statistical Precipice", NeurIPS 2021. Episodes are drawn again
and again with replacement, each world's among its own, and an interval spans the middle 95 % of what the
number comes out as. Worlds may have different numbers of episodes; every episode weighs the same.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import stats

from hpp_framework.evaluation.statistics import Estimate

Scores = Float[np.ndarray, "_"]
"""One number an episode, of the episodes of one world."""

RESAMPLES = 2000
TAILS = (0.025, 0.975)


@dataclass(frozen=True)
class Profile:
    """Which share of episodes has a score above each threshold, with pointwise 95 % bands.

    Attributes:
        thresholds: rising.
        share: of all episodes, 0 to 1.
        low: lower end of the band.
        high: upper end of the band.
    """

    thresholds: Float[np.ndarray, "k"]
    share: Float[np.ndarray, "k"]
    low: Float[np.ndarray, "k"]
    high: Float[np.ndarray, "k"]


def mean(strata: Sequence[Scores], rng: np.random.Generator, *, resamples: int = RESAMPLES) -> Estimate:
    """Return the mean of all scores.

    Args:
        strata: scores, an array a world.
        rng: of the bootstrap.
        resamples: how often episodes are drawn again.
    """
    return _estimate(strata, rng, lambda scores: scores.mean(-1), resamples)


def interquartile_mean(strata: Sequence[Scores], rng: np.random.Generator) -> Estimate:
    """Return the mean of the middle half of all scores: hardly moved by outliers, surer than the median.

    Args:
        strata: scores, an array a world.
        rng: of the bootstrap.
    """
    return _estimate(strata, rng, lambda scores: stats.trim_mean(scores, 0.25, axis=-1))


def optimality_gap(strata: Sequence[Scores], rng: np.random.Generator, *, best: float = 1.0) -> Estimate:
    """Return by how much scores fall short of the best on average; what exceeds it does not count.

    Args:
        strata: scores, an array a world.
        rng: of the bootstrap.
        best: score from which on there is nothing to gain.
    """
    return _estimate(strata, rng, lambda scores: best - np.minimum(scores, best).mean(-1))


def improvement(first: Sequence[Scores], second: Sequence[Scores], rng: np.random.Generator) -> Estimate:
    """Return the probability that the first does better than the second on an episode; ties count half.

    Success beats failure, and earlier success beats later. Unlike in the paper episodes are paired.

    Args:
        first: times of success by episode, NaN for failures, an array a world.
        second: the same of the other.
        rng: of the bootstrap.
    """
    wins: list[Scores] = []
    for one, two in zip(first, second, strict=True):
        a, b = np.nan_to_num(one, nan=np.inf), np.nan_to_num(two, nan=np.inf)
        wins.append(np.where(a < b, 1.0, np.where(a == b, 0.5, 0.0)))
    return mean(wins, rng)


def performance_profile(
    strata: Sequence[Scores], thresholds: Float[np.ndarray, "k"], rng: np.random.Generator
) -> Profile:
    """Return which share of episodes scores above each threshold (a "score distribution").

    Args:
        strata: scores, an array a world.
        thresholds: rising.
        rng: of the bootstrap.
    """
    samples = _resampled(strata, rng)
    bands = [np.quantile((samples > threshold).mean(1), TAILS) for threshold in thresholds]
    low, high = np.transpose(bands)
    everything = np.concatenate(strata)
    return Profile(thresholds, (everything > thresholds[:, None]).mean(1), low, high)


def _estimate(
    strata: Sequence[Scores],
    rng: np.random.Generator,
    number: Callable[[np.ndarray], np.ndarray],
    resamples: int = RESAMPLES,
) -> Estimate:
    low, high = np.quantile(number(_resampled(strata, rng, resamples)), TAILS)
    return Estimate(float(number(np.concatenate(strata))), float(low), float(high))


def _resampled(
    strata: Sequence[Scores], rng: np.random.Generator, resamples: int = RESAMPLES
) -> Float[np.ndarray, "_ e"]:
    """Draw the episodes of each world again, as many as there are, once a row."""
    # scipy.stats.bootstrap draws strata too, but refuses worlds with one episode
    return np.concatenate([rng.choice(each, (resamples, len(each))) for each in strata if len(each)], 1)
