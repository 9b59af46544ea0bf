"""Numbers about how far off predictors were: errors by horizon, and whether they knew how sure to be."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.evaluation.predictor_trials import Misses
from hpp_framework.evaluation.statistics import Z95

ALL, ALL_WORLDS = "all", "all worlds"
LEVELS = tuple(round(0.05 * i, 2) for i in range(1, 20))
"""Nominal probabilities of the regions whose coverage is measured."""


@dataclass(frozen=True, kw_only=True)
class ErrorRow:
    """Position error at one horizon.

    Attributes:
        predictor: registered name.
        world: registered world or world file, or :data:`ALL_WORLDS`.
        role: ``"self"`` or ``"other"``: whether the predicted robot is the predicting one.
        agent: id of the predicting robot, or :data:`ALL`.
        subject: id of the predicted robot, or :data:`ALL`.
        seconds: ahead.
        count: predictions.
        mean_m: mean error, metres.
        mean_low_m: lower end of the 95 % interval of the mean, in which a trajectory counts once.
        mean_high_m: its upper end.
        median_m: half of the predictions are better.
        p90_m: 90 % of the predictions are better.
    """

    predictor: str
    world: str
    role: str
    agent: str
    subject: str
    seconds: float
    count: int
    mean_m: float
    mean_low_m: float
    mean_high_m: float
    median_m: float
    p90_m: float


@dataclass(frozen=True, kw_only=True)
class CalibrationRow:
    """Whether a predictor knew how sure to be, at one horizon, or over all of them (``seconds`` is 0).

    Its regions are discs: position is Gaussian with the same deviation along both axes.

    Attributes:
        predictor, world, role: see :class:`ErrorRow`.
        seconds: ahead; 0 for all horizons together.
        count: predictions.
        coverage_50: share of true positions in the disc that should hold 50 %; likewise the following.
        coverage_80: of 80 %.
        coverage_90: of 90 %.
        coverage_95: of 95 %.
        nll: mean negative log-likelihood of true positions, in nats; less is better.
        nll_constant: that of the best deviation that is the same for all predictions of these.
        std_mean_m: mean deviation that the predictor said, metres along each axis.
    """

    predictor: str
    world: str
    role: str
    seconds: float
    count: int
    coverage_50: float
    coverage_80: float
    coverage_90: float
    coverage_95: float
    nll: float
    nll_constant: float
    std_mean_m: float


def pool(parts: Sequence[Misses]) -> Misses:
    """Put the misses of one predictor in several cells together; their trajectories stay apart."""
    offsets = torch.tensor([0.0, *(float(part.trajectory.max()) + 1 for part in parts[:-1])]).cumsum(0)
    stds = [part.std for part in parts if part.std is not None]
    return Misses(
        parts[0].times,
        torch.cat([part.distance for part in parts]),
        torch.cat(stds) if len(stds) == len(parts) else None,
        torch.cat([part.trajectory + offset for part, offset in zip(parts, offsets, strict=True)]),
    )


def error_rows(
    found: Misses, *, predictor: str, world: str, role: str, agent: str = ALL, subject: str = ALL
) -> list[ErrorRow]:
    """Return a row a horizon."""
    half = Z95 * _standard_error(found)
    mean, median = found.distance.mean(0), found.distance.median(0).values
    most = found.distance.quantile(0.9, 0)
    return [
        ErrorRow(
            predictor=predictor, world=world, role=role, agent=agent, subject=subject,
            seconds=round(float(seconds), 3), count=len(found.distance), mean_m=float(mean[i]),
            mean_low_m=float(mean[i] - half[i]), mean_high_m=float(mean[i] + half[i]),
            median_m=float(median[i]), p90_m=float(most[i]),
        )
        for i, seconds in enumerate(found.times)
    ]  # fmt: skip


def _standard_error(found: Misses) -> Float[Tensor, "t"]:
    """Return the standard error of the mean distance from the means of whole trajectories."""
    rows = found.trajectory.long()
    count = int(rows.max()) + 1
    sums = torch.zeros(count, found.distance.shape[1]).index_add(0, rows, found.distance)
    means = sums / torch.bincount(rows, minlength=count).clamp(min=1)[:, None]
    return means.std(0, correction=min(1, count - 1)) / math.sqrt(count)


def coverage(found: Misses, level: float) -> Float[Tensor, "t"]:
    """Return the share of true positions within the disc that should hold ``level`` of them, by horizon.

    Raises:
        ValueError: if the predictor does not say how sure it is.
    """
    if found.std is None:
        raise ValueError("there is no coverage without deviations.")
    # Rayleigh: the distance of an isotropic Gaussian from its mean
    radius = found.std * math.sqrt(-2 * math.log(1 - level))
    return (found.distance <= radius).float().mean(0)


def calibration_rows(found: Misses, *, predictor: str, world: str, role: str) -> list[CalibrationRow]:
    """Return a row a horizon and, first, one over all horizons; none if there are no deviations."""
    if found.std is None:
        return []
    nll = _nll(found.distance, found.std)
    best = (found.distance.square().mean(0) / 2).sqrt().expand_as(found.std)
    constant = _nll(found.distance, best)
    covered = {level: coverage(found, level) for level in (0.5, 0.8, 0.9, 0.95)}

    def row(seconds: float, at: slice) -> CalibrationRow:
        return CalibrationRow(
            predictor=predictor, world=world, role=role, seconds=round(seconds, 3),
            count=found.distance[:, at].numel(),
            **{f"coverage_{round(100 * p)}": float(c[at].mean()) for p, c in covered.items()},
            nll=float(nll[:, at].mean()), nll_constant=float(constant[:, at].mean()),
            std_mean_m=float(found.std[:, at].mean()) if found.std is not None else math.nan,
        )  # fmt: skip

    each = [row(float(s), slice(i, i + 1)) for i, s in enumerate(found.times)]
    return [row(0.0, slice(None)), *each]


def _nll(distance: Tensor, std: Tensor) -> Tensor:
    return torch.log(2 * math.pi * std.square()) + distance.square() / (2 * std.square())
