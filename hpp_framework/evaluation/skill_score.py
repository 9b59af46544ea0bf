"""Outcomes of single navigation tasks, and their summary."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hpp_framework.evaluation.bootstrap import mean
from hpp_framework.evaluation.statistics import wilson_interval
from hpp_framework.utils.seeding import numpy_rng

RESAMPLES = 1000
"""Of the bootstrap."""


@dataclass(frozen=True, kw_only=True)
class SkillRow:
    """One episode; a line of ``episodes.csv``.

    Attributes:
        skill: registered name, or empty.
        world: registered world or world file.
        episode: number.
        distance_m: straight from start to goal.
        clearance_m: of the task, see :class:`hpp_framework.evaluation.navigation_tasks.NavigationTask`.
        shortest_m: length of the shortest path of the footprint from start to goal.
        bound_s: time that no drive can beat.
        success: 1 if it came to rest within 0.3 m of the goal for 1 s.
        clean: 1 if it succeeded and touched nothing.
        collision: 1 if it touched anything, before it succeeded if it did.
        freeze: 1 if it failed and moved less than 0.25 m, net, in its last 5 s.
        timeout: 1 if it failed otherwise.
        time_s: until success, the second at rest included; NaN for failures.
        driven_m: path driven until success, or until the end; from place to place each control period.
        left_m: distance to the goal then.
        spl: success weighted by path length (Anderson et al. 2018), ``shortest / max(driven, shortest)``, 0
            for failures. To stop early is allowed and must not count as a short path: ``shortest`` is
            shortened by the distance that was left to the goal.
        time_ratio: ``time_s / bound_s``; NaN for failures.
    """

    skill: str
    world: str
    episode: int
    distance_m: float
    clearance_m: float
    shortest_m: float
    bound_s: float
    success: int
    clean: int
    collision: int
    freeze: int
    timeout: int
    time_s: float
    driven_m: float
    left_m: float
    spl: float
    time_ratio: float


@dataclass(frozen=True, kw_only=True)
class SkillScore:
    """Outcome over a set of episodes: rates with their 95 % Wilson bounds; see :class:`SkillRow`.

    Attributes:
        episodes: how many.
        success, success_low, success_high: share that came to rest at the goal.
        clean, clean_low, clean_high: share that did so without touching anything.
        collision, collision_low, collision_high: share that touched something.
        freeze, freeze_low, freeze_high: share that failed and stood still.
        timeout, timeout_low, timeout_high: share that failed otherwise.
        spl, spl_low, spl_high: mean success weighted by path length, with its 95 % bootstrap interval.
        time_median_s: median time of the successes in seconds, None without any.
        time_ratio_median: median of their times over the time bound, None without any.
    """

    episodes: int
    success: float
    success_low: float
    success_high: float
    clean: float
    clean_low: float
    clean_high: float
    collision: float
    collision_low: float
    collision_high: float
    freeze: float
    freeze_low: float
    freeze_high: float
    timeout: float
    timeout_low: float
    timeout_high: float
    spl: float
    spl_low: float
    spl_high: float
    time_median_s: float | None
    time_ratio_median: float | None


def score(rows: Sequence[SkillRow]) -> SkillScore:
    """Sum episodes up, in whatever worlds they were.

    Args:
        rows: at least one.
    """
    spl = np.array([row.spl for row in rows])
    overall = mean([spl], numpy_rng(0, "bootstrap"), resamples=RESAMPLES)
    times = [row.time_s for row in rows if row.success]
    ratios = [row.time_ratio for row in rows if row.success]
    rates: dict[str, float] = {}
    for name in ("success", "clean", "collision", "freeze", "timeout"):
        count = sum(int(getattr(row, name)) for row in rows)
        bounds = wilson_interval(count, len(rows))
        rates |= {name: count / len(rows), f"{name}_low": bounds[0], f"{name}_high": bounds[1]}
    return SkillScore(
        episodes=len(rows), **rates, spl=overall.value, spl_low=overall.low, spl_high=overall.high,
        time_median_s=float(np.median(times)) if times else None,
        time_ratio_median=float(np.median(ratios)) if ratios else None,
    )  # fmt: skip
