"""Honest numbers: intervals for rates, and for comparisons of what ran on the same episodes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

Z95 = 1.959963984540054

RESAMPLES = 2000


@dataclass(frozen=True)
class Estimate:
    """A number with a 95 % interval."""

    value: float
    low: float
    high: float

    def as_list(self) -> list[float]:
        """Return value, low and high, rounded for files."""
        return [round(each, 4) for each in (self.value, self.low, self.high)]


def wilson_interval(successes: int, trials: int, z: float = Z95) -> tuple[float, float]:
    """Return the Wilson score interval of a rate (Wilson 1927), 95 % by default.

    Args:
        successes: how many succeeded.
        trials: how many there were; 0 gives (0, 1).
        z: standard normal quantile.
    """
    if trials == 0:
        return 0.0, 1.0
    rate = successes / trials
    scale = 1 + z * z / trials
    middle = (rate + z * z / (2 * trials)) / scale
    half = z * math.sqrt(rate * (1 - rate) / trials + z * z / (4 * trials * trials)) / scale
    return max(0.0, middle - half), min(1.0, middle + half)


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
    one, two = rate(first), rate(second)
    both, neither = int((first & second).sum()), int((~first & ~second).sum())
    only_first, only_second = int((first & ~second).sum()), int((~first & second).sum())
    margins = (both + only_first) * (only_second + neither) * (both + only_second) * (only_first + neither)
    surplus = both * neither - only_first * only_second
    if surplus > 0:
        surplus = max(surplus - total / 2, 0)
    phi = surplus / math.sqrt(margins) if margins else 0.0

    def joined(here: float, there: float) -> float:
        return math.sqrt(max(here**2 - 2 * phi * here * there + there**2, 0))

    value = one.value - two.value
    low = value - joined(one.value - one.low, two.high - two.value)
    return Estimate(value, low, value + joined(one.high - one.value, two.value - two.low))


def improvement(
    first: Sequence[Float[np.ndarray, "_"]],
    second: Sequence[Float[np.ndarray, "_"]],
    rng: np.random.Generator,
) -> Estimate:
    """Return the probability that the first does better than the second on an episode; ties count half.

    Success beats failure, and earlier success beats later (after Agarwal et al. 2021, but paired). The
    interval is a percentile bootstrap over episodes, stratum by stratum.

    Args:
        first: times of success by episode, NaN for failures, one array a stratum (world).
        second: the same of the other.
        rng: of the bootstrap.
    """
    wins: list[Float[np.ndarray, "_"]] = []
    for one, two in zip(first, second, strict=True):
        a, b = np.nan_to_num(one, nan=np.inf), np.nan_to_num(two, nan=np.inf)
        wins.append(np.where(a < b, 1.0, np.where(a == b, 0.5, 0.0)))
    total = sum(map(len, wins))
    sums = sum(rng.choice(each, (RESAMPLES, len(each))).sum(1) for each in wins if len(each))
    low, high = np.quantile(sums / total, [0.025, 0.975])
    return Estimate(float(sum(each.sum() for each in wins)) / total, float(low), float(high))
