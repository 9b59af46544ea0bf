"""Summary of an experiment's episodes: one row per cell, comparisons of planners, causes of failure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from hpp_framework.config.planner_choice import parse_planner
from hpp_framework.evaluation.bootstrap import (
    improvement,
    interquartile_mean,
    optimality_gap,
    performance_profile,
)
from hpp_framework.evaluation.rows import EpisodeRow
from hpp_framework.evaluation.statistics import (
    Estimate,
    mcnemar_p,
    paired_difference,
    rate,
    signed_rank_p,
)
from hpp_framework.utils.seeding import numpy_rng

ALL = "all"
"""Name of all worlds together."""
PLANNER, FULL, PERFECT = "hpp", "full-communication", "perfect-model"

THRESHOLDS = np.linspace(0, 0.95, 20)
"""Of RPL, for performance profiles: 0 counts every success."""

Summary = dict[str, list[dict[str, Any]]]
"""``cells``, ``aggregates``, ``comparisons`` and ``blame``, rows of plain data each."""


@dataclass(frozen=True, kw_only=True)
class Results:
    """The episodes of an experiment.

    Attributes:
        worlds: in the order of the report.
        planners: in the order of the report; the first is compared with the others.
        rows: one per episode, the same episodes for every planner.
        about: what every cell says of itself: team, backend, seed.
        preset: of planners that name none.
    """

    worlds: tuple[str, ...]
    planners: tuple[str, ...]
    rows: Sequence[EpisodeRow]
    about: dict[str, Any]
    preset: str

    def cell(self, world: str, planner: str) -> list[EpisodeRow]:
        """Return the rows of one planner in one world."""
        return [row for row in self.rows if (row.world, row.planner) == (world, planner)]

    def times(self, worlds: Sequence[str], planner: str) -> list[npt.NDArray[np.float64]]:
        """Return the times of success by world and episode in seconds, NaN for failures."""
        return [np.array([row.time_s for row in self.cell(world, planner)]) for world in worlds]

    def strata(self) -> list[tuple[str, tuple[str, ...]]]:
        """Return each world, and all together if there are several: name and worlds."""
        each = [(world, (world,)) for world in self.worlds]
        return [*each, (ALL, self.worlds)] if len(each) > 1 else each


def summarise(results: Results) -> Summary:
    """Return everything that an experiment's episodes say; see docs/evaluation.md for every number."""
    return {
        "cells": [_cell(results, world, planner) for world in results.worlds for planner in results.planners],
        "aggregates": [
            _aggregate(results, name, worlds, planner)
            for name, worlds in results.strata()
            for planner in results.planners
        ],
        "comparisons": [
            _comparison(results, name, worlds, other)
            for name, worlds in results.strata()
            for other in results.planners[1:]
        ],
        "blame": _blame(results),
    }


def _cell(results: Results, world: str, planner: str) -> dict[str, Any]:
    cell = results.cell(world, planner)
    success = rate(np.array([row.success for row in cell], np.bool_))
    met = [row for row in cell if row.success]
    return {
        "world": world,
        "planner": planner,
        "preset": parse_planner(planner).preset or results.preset,
        **results.about,
        "episodes": len(cell),
        "success": round(success.value, 4),
        "success_low": round(success.low, 4),
        "success_high": round(success.high, 4),
        "first_contact": _mean([row.first_contact for row in cell], 4),
        "time_median_s": _median([row.time_s for row in met], 2),
        "bound_median_s": _median([row.bound_s for row in cell], 2),
        "time_over_bound_median": _median([row.time_s / row.bound_s for row in met], 3),
        "rpl": _mean([row.rpl for row in cell], 4),
        "price_median": _price(results, world, planner),
        "collision_episodes": sum(row.collided for row in cell),
        "obstacle_episodes": sum(row.touched_obstacle for row in cell),
        "robot_episodes": sum(row.touched_robot for row in cell),
        "person_episodes": sum(row.touched_person for row in cell),
        "final_distance_mean_m": _mean([row.final_distance_m for row in cell], 3),
        "goal_gap_median_m": _median([row.goal_gap_m for row in cell], 3),
        "agreed": _mean([not math.isnan(row.agreement_s) for row in cell], 4),
        "agreement_median_s": _median([row.agreement_s for row in cell], 2),
        "side_flips_mean": _mean([row.side_flips for row in cell], 3),
        "chase_mean": _mean([row.chase for row in cell], 4),
        "plan_ms_median": _median([row.plan_ms for row in cell], 3),
    }


def _aggregate(results: Results, name: str, worlds: Sequence[str], planner: str) -> dict[str, Any]:
    """Return what the RPL of all episodes says; None where some have no bound."""
    strata = [np.array([row.rpl for row in results.cell(world, planner)]) for world in worlds]
    row: dict[str, Any] = {"world": name, "planner": planner, "episodes": sum(map(len, strata))}
    if np.isnan(np.concatenate(strata)).any():
        return {**row, "rpl_iqm": None, "optimality_gap": None, "profile": None}
    rng = numpy_rng(0, "aggregate", name, planner)
    profile = performance_profile(strata, THRESHOLDS, rng)
    return {
        **row,
        "rpl_iqm": interquartile_mean(strata, rng).as_list(),
        "optimality_gap": optimality_gap(strata, rng).as_list(),
        "profile": {key: np.round(values, 4).tolist() for key, values in vars(profile).items()},
    }


def _price(results: Results, world: str, planner: str) -> float | None:
    """Return the price of decentralisation: how much longer than the oracle, where both succeed."""
    oracle = _named(results.planners, FULL)
    if oracle is None:
        return None
    (own,), (others,) = (results.times((world,), each) for each in (planner, oracle))
    return _median((own / others - 1).tolist(), 3)


def _comparison(results: Results, name: str, worlds: Sequence[str], other: str) -> dict[str, Any]:
    first = results.planners[0]
    one, two = (results.times(worlds, planner) for planner in (first, other))
    ones, twos = np.concatenate(one), np.concatenate(two)
    return {
        "world": name,
        "planner": first,
        "against": other,
        "episodes": len(ones),
        "success_difference": _difference(ones, twos).as_list(),
        "success_p": _significant(mcnemar_p(~np.isnan(ones), ~np.isnan(twos))),
        "improvement": improvement(one, two, numpy_rng(0, "improvement", name, first, other)).as_list(),
        "time_ratio_median": _median((ones / twos).tolist(), 3),
        "time_p": _significant(signed_rank_p(ones, twos)),
    }


def _blame(results: Results) -> list[dict[str, Any]]:
    """Return where success was lost, if the planner and both oracles ran."""
    names = [_named(results.planners, name) for name in (PLANNER, FULL, PERFECT)]
    if None in names:
        return []
    table: list[dict[str, Any]] = []
    for world, worlds in results.strata():
        own, oracle, perfect = (np.concatenate(results.times(worlds, str(name))) for name in names)
        reached = rate(~np.isnan(perfect))
        table.append(
            {
                "world": world,
                "planner": names[0],
                "episodes": len(own),
                "success": round(rate(~np.isnan(own)).value, 4),
                "silence": _difference(oracle, own).as_list(),
                "predictor": _difference(perfect, oracle).as_list(),
                "skill": Estimate(1 - reached.value, 1 - reached.high, 1 - reached.low).as_list(),
            }
        )
    return table


def _named(planners: Sequence[str], name: str) -> str | None:
    """Return the first of the planners with a registered name, whatever its settings."""
    return next((planner for planner in planners if parse_planner(planner).name == name), None)


def _difference(one: npt.NDArray[np.float64], two: npt.NDArray[np.float64]) -> Estimate:
    return paired_difference(~np.isnan(one), ~np.isnan(two))


def _significant(p: float | None) -> float | None:
    """Round a p value to three digits that count."""
    return None if p is None else float(f"{p:.3g}")


def _median(values: Sequence[float], digits: int) -> float | None:
    """Return the median of the finite numbers there are, None without any."""
    known = [value for value in values if math.isfinite(value)]
    return round(float(np.median(known)), digits) if known else None


def _mean(values: Sequence[float], digits: int) -> float | None:
    """Return the mean of the finite numbers there are, None without any."""
    known = [value for value in values if math.isfinite(value)]
    return round(float(np.mean(known)), digits) if known else None
