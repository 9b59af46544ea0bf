"""Honest numbers: intervals for rates, and comparisons of what ran on the same episodes.

What has no formula is resampled: :mod:`hpp_framework.evaluation.bootstrap`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy import stats

Z95 = 1.959963984540054

DIGITS = 6
"""Decimals of a second that differences between times are told apart by."""


@dataclass(frozen=True)
class Estimate:
    """A number with a 95 % interval."""

    value: float
    low: float
    high: float

    def as_list(self) -> list[float]:
        """Return value, low and high, rounded for files."""
        return [round(each, 4) for each in (self.value, self.low, self.high)]


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """Return the 95 % Wilson score interval of a rate (Wilson 1927); (0, 1) without trials."""
    if trials == 0:
        return 0.0, 1.0
    interval: Any = stats.binomtest(successes, trials).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)


def rate(successes: Bool[np.ndarray, "e"]) -> Estimate:
    """Return the share of successes with its Wilson interval."""
    count = int(successes.sum())
    return Estimate(count / max(len(successes), 1), *wilson_interval(count, len(successes)))


def paired_difference(first: Bool[np.ndarray, "e"], second: Bool[np.ndarray, "e"]) -> Estimate:
    """Return the difference of two success rates on the same episodes, first minus second.

    The interval is Newcombe's (1998, Statistics in Medicine 17:2635, method 10): Wilson intervals of both
    rates, joined under the correlation of the pairs; unlike a bootstrap it does not shrink to nothing where
    all pairs agree.
    """
    total = len(first)
    both, neither = int((first & second).sum()), int((~first & ~second).sum())
    only_first, only_second = int((first & ~second).sum()), int((~first & second).sum())
    margins = (both + only_first) * (only_second + neither) * (both + only_second) * (only_first + neither)
    surplus = both * neither - only_first * only_second
    if surplus > 0:
        surplus = max(surplus - total / 2, 0)
    return _joined(rate(first), rate(second), surplus / math.sqrt(margins) if margins else 0.0)


def independent_difference(first: Bool[np.ndarray, "e"], second: Bool[np.ndarray, "f"]) -> Estimate:
    """Return the difference of two success rates on different episodes, first minus second.

    The interval is Newcombe's (1998, Statistics in Medicine 17:873, method 10).
    """
    return _joined(rate(first), rate(second), 0.0)


def _joined(one: Estimate, two: Estimate, correlation: float) -> Estimate:
    def length(here: float, there: float) -> float:
        return math.sqrt(max(here**2 - 2 * correlation * here * there + there**2, 0))

    value = one.value - two.value
    low = value - length(one.value - one.low, two.high - two.value)
    return Estimate(value, low, value + length(one.high - one.value, two.value - two.low))


def mcnemar_p(first: Bool[np.ndarray, "e"], second: Bool[np.ndarray, "e"]) -> float:
    """Return the two-sided p value of McNemar's exact test (1947) of two success rates on the same episodes.

    Under the hypothesis of equal rates, which of the two succeeds where only one does is a fair coin. Errs
    on the safe side: rather a bit too large. 1 where they never differ.

    Args:
        first: successes by episode.
        second: the same of the other.
    """
    only_first, only_second = int((first & ~second).sum()), int((~first & second).sum())
    differ = only_first + only_second
    return float(stats.binomtest(only_first, differ).pvalue) if differ else 1.0


def signed_rank_p(first: Float[np.ndarray, "e"], second: Float[np.ndarray, "e"]) -> float | None:
    """Return the two-sided p value of Wilcoxon's signed-rank test (1945) of times on the same episodes.

    Only episodes in which both succeed count, so this says nothing of how often they do.

    Args:
        first: seconds by episode, NaN for failures.
        second: the same of the other.

    Returns:
        None where they never both succeed; 1 where all times are equal.
    """
    both = ~np.isnan(first) & ~np.isnan(second)
    if not both.any():
        return None
    # differences that are equal must have equal ranks
    differences = np.round(first[both] - second[both], DIGITS)
    if not differences.any():
        return 1.0
    result: Any = stats.wilcoxon(differences)
    return float(result.pvalue)
