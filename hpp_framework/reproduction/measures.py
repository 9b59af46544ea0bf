"""What can be measured of the arms of experiments, each measure with the rule by which it decides.

An *arm* is a planner in an experiment. All arms share their episodes, so comparisons are paired, also across
experiments; if one ran more episodes than the other, those that both ran count.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hpp_framework.evaluation.bootstrap import improvement
from hpp_framework.evaluation.folder import EPISODES
from hpp_framework.evaluation.rows import EpisodeRow
from hpp_framework.evaluation.statistics import (
    Z95,
    Estimate,
    independent_difference,
    paired_difference,
    rate,
)
from hpp_framework.evaluation.table import read_rows
from hpp_framework.reproduction.claims import Outcome, Part, side
from hpp_framework.reproduction.experiments import BEST, PAPER
from hpp_framework.reproduction.plan import EXPERIMENTS
from hpp_framework.utils.seeding import numpy_rng

SAME = 0.1
"""Differences of rates, and of probabilities from one half, that are too small to speak of an advantage."""
ALIKE = 0.15
"""Difference of success up to which planners perform similarly."""
ENOUGH = 20
"""Episodes below which nothing is decided: intervals by resampling are too narrow for so few."""


class Arm(NamedTuple):
    """A planner in an experiment."""

    experiment: str
    planner: str


class Measures:
    """Measures of the episodes in a folder of a reproduction; None where something was not run.

    Args:
        out: the folder.
    """

    def __init__(self, out: Path) -> None:
        self.out = out
        self._read = cache(self._cells)

    def more_success(self, one: Arm, other: Arm, world: str) -> Part | None:
        """Compare success: yes if the interval of the difference is above 0.

        No if it is below 0, or so close around it (:data:`SAME`) that there is no advantage to speak of.
        """
        return self._paired(one, other, world, _success_difference, 0.0)

    def better(self, one: Arm, other: Arm, world: str) -> Part | None:
        """Compare by the probability of improvement: yes if its interval is above one half.

        Success beats failure, earlier success beats later, ties count half. No if the interval is below one
        half, or so close around it (:data:`SAME`) that there is no advantage to speak of.
        """

        def chance(first: Times, second: Times) -> Estimate:
            rng = numpy_rng(0, "claim", *one, *other, world)
            return improvement([first], [second], rng)

        return self._paired(one, other, world, chance, 0.5)

    def larger(self, one: Arm, other: Arm, world: str, easier: str) -> Part | None:
        """Compare an advantage (see :meth:`better`) in two worlds: yes if it is larger in the first.

        That is if both intervals are apart, which errs on the safe side.
        """
        here, there = self.better(one, other, world), self.better(one, other, easier)
        if here is None or there is None:
            return None
        low, high = here.found.low - there.found.high, here.found.high - there.found.low
        enough = all(len(self._common(one, other, each)) >= ENOUGH for each in (world, easier))
        return Part(
            about=f"{world} less {easier}, {_name(one)} against {_name(other)}",
            found=Estimate(here.found.value - there.found.value, low, high),
            outcome=side(low, high, 0) if enough else "open",
            detail=f"chance {here.found.value:.2f} in {world}, {there.found.value:.2f} in {easier}",
        )

    def alike(self, one: Arm, other: Arm, world: str) -> Part | None:
        """Compare success: yes if the whole interval of the difference lies within :data:`ALIKE` of 0.

        No if it excludes 0; else the two may be alike or not.
        """
        times = self._times(one, other, world)
        if times is None:
            return None
        found = _success_difference(*times)
        outcome: Outcome = "open"
        if max(abs(found.low), abs(found.high)) <= ALIKE:
            outcome = "yes"
        elif found.low > 0 or found.high < 0:
            outcome = "no"
        return self._part(one, other, world, found, outcome, _rates(*times))

    def fails(self, arm: Arm, world: str, share: float = 0.5) -> Part | None:
        """Look at success: yes if the interval of the rate is below ``share``, no if it is above."""
        return self._rate(arm, world, lambda found: side(-found.high, -found.low, -share))

    def completes(self, arm: Arm, world: str, share: float = 0.5) -> Part | None:
        """Look at success: yes if the interval of the rate is above ``share``, no if it is below."""
        return self._rate(arm, world, lambda found: side(found.low, found.high, share))

    def closer(self, one: Arm, other: Arm, world: str) -> Part | None:
        """Compare distances at the end, in metres: yes if the interval of the mean difference is below 0."""
        found = self._mean_difference(one, other, world, lambda row: row.final_distance_m)
        if found is None:
            return None
        outcome = side(-found.high, -found.low, 0)
        return self._part(one, other, world, found, outcome, "metres apart at the end")

    def chases_more(self, one: Arm, other: Arm, world: str) -> Part | None:
        """Compare the share of paths spent on chasing: yes if the interval of the difference is above 0."""
        found = self._mean_difference(one, other, world, lambda row: row.chase)
        if found is None:
            return None
        return self._part(one, other, world, found, side(found.low, found.high, 0), "chase")

    def harder(self, arm: Arm, world: str, easier: str) -> Part | None:
        """Compare worlds: yes if a planner succeeds less in one than in the other, by the whole interval."""
        there, here = self.episodes(arm, easier), self.episodes(arm, world)
        if not here or not there:
            return None
        ones, twos = (np.array([row.success for row in rows.values()], np.bool_) for rows in (there, here))
        found = independent_difference(ones, twos)
        detail = f"success {rate(ones).value:.2f} in {easier}, {rate(twos).value:.2f} in {world}"
        about = f"{arm.planner}, {easier} less {world}"
        outcome = side(found.low, found.high, 0)
        return Part(about=about, found=found, outcome=outcome, detail=detail, preset=_preset(arm))

    def episodes(self, arm: Arm, world: str) -> dict[int, EpisodeRow]:
        """Return the episodes of an arm in a world by number, none if it was not run."""
        return self._read(arm.experiment).get((world, arm.planner), {})

    def _cells(self, experiment: str) -> dict[tuple[str, str], dict[int, EpisodeRow]]:
        cells: dict[tuple[str, str], dict[int, EpisodeRow]] = {}
        for row in read_rows(self.out / EXPERIMENTS / experiment / EPISODES, EpisodeRow):
            cells.setdefault((row.world, row.planner), {})[row.episode] = row
        return cells

    def _common(self, one: Arm, other: Arm, world: str) -> list[tuple[EpisodeRow, EpisodeRow]]:
        ones, others = self.episodes(one, world), self.episodes(other, world)
        return [(ones[number], others[number]) for number in sorted(ones.keys() & others.keys())]

    def _times(self, one: Arm, other: Arm, world: str) -> tuple[Times, Times] | None:
        pairs = self._common(one, other, world)
        if not pairs:
            return None
        return np.array([row.time_s for row, _ in pairs]), np.array([row.time_s for _, row in pairs])

    def _part(self, one: Arm, other: Arm, world: str, found: Estimate, outcome: Outcome, detail: str) -> Part:
        """Return the part of a comparison; few episodes decide nothing."""
        count = len(self._common(one, other, world))
        about = f"{world}, {_name(one)} against {_name(other)}"
        outcome = outcome if count >= ENOUGH else "open"
        return Part(about=about, found=found, outcome=outcome, detail=detail, preset=_preset(one, other))

    def _paired(
        self, one: Arm, other: Arm, world: str, compare: Callable[[Times, Times], Estimate], equal: float
    ) -> Part | None:
        times = self._times(one, other, world)
        if times is None:
            return None
        found = compare(*times)
        outcome = side(found.low, found.high, equal)
        if outcome == "open" and max(found.high - equal, equal - found.low) <= SAME:
            outcome = "no"
        return self._part(one, other, world, found, outcome, _rates(*times))

    def _rate(self, arm: Arm, world: str, decide: Callable[[Estimate], Outcome]) -> Part | None:
        rows = self.episodes(arm, world)
        if not rows:
            return None
        found = rate(np.array([row.success for row in rows.values()], np.bool_))
        about = f"{world}, {_name(arm)}"
        return Part(
            about=about, found=found, outcome=decide(found), detail=f"success in {len(rows)} episodes",
            preset=_preset(arm),
        )  # fmt: skip

    def _mean_difference(
        self, one: Arm, other: Arm, world: str, value: Callable[[EpisodeRow], float]
    ) -> Estimate | None:
        pairs = self._common(one, other, world)
        if not pairs:
            return None
        differences = np.array([value(first) - value(second) for first, second in pairs])
        mean = float(differences.mean())
        # one episode tells nothing of the spread
        spread = float(differences.std(ddof=1)) if len(pairs) > 1 else np.inf
        half = Z95 * spread / np.sqrt(len(pairs))
        return Estimate(mean, mean - half, mean + half)


Times = npt.NDArray[np.float64]
"""Of success in seconds by episode, NaN for failures."""


def _success_difference(first: Times, second: Times) -> Estimate:
    return paired_difference(~np.isnan(first), ~np.isnan(second))


def _name(arm: Arm) -> str:
    """Return what an arm is called in a sentence."""
    return arm.planner if arm.experiment == "main" else f"{arm.planner} ({arm.experiment})"


def _preset(*arms: Arm) -> str:
    """Return the preset of HPP that is among some arms of the main comparison, if there is one."""
    presets = {Arm("main", PAPER): "paper", Arm("main", BEST): "best"}
    return next((presets[arm] for arm in arms if arm in presets), "")


def _rates(first: Times, second: Times) -> str:
    return f"success {np.isfinite(first).mean():.2f} and {np.isfinite(second).mean():.2f}"
