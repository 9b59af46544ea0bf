"""What can be measured of motion models and training curves, each measure with its rule."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from hpp_framework.evaluation.folder import SUMMARY
from hpp_framework.evaluation.predictor_score import ALL, ErrorRow
from hpp_framework.evaluation.predictor_study import ERRORS
from hpp_framework.evaluation.predictor_trials import MOMENTS
from hpp_framework.evaluation.statistics import Estimate, rate
from hpp_framework.evaluation.table import read_rows
from hpp_framework.reproduction.claims import Part, side
from hpp_framework.reproduction.measures import ENOUGH
from hpp_framework.reproduction.plan import EXPERIMENTS
from hpp_framework.utils.run_folder import read_json

LEVEL = 0.02
"""Share by which a loss may still fall over the last tenth of a training that has converged."""
FAILED = 0.5
"""Share of the best seed's final success below which a seed has failed to converge."""


class ModelMeasures:
    """Measures of the predictors and cards in a folder of a reproduction; None where something is missing.

    Args:
        out: the folder.
    """

    def __init__(self, out: Path) -> None:
        self.folder = out / EXPERIMENTS

    def smaller_error(
        self, one: tuple[str, str], other: tuple[str, str], world: str, seconds: float
    ) -> Part | None:
        """Compare mean position errors: yes if the interval of the first lies below that of the other.

        No if it lies above. Intervals that overlap leave it open; as both were asked the same questions,
        that errs on the safe side.

        Args:
            one: predictor and role, ``"self"`` or ``"other"``.
            other: likewise.
            world: where.
            seconds: ahead.
        """
        first, second = (self._errors.get((*key, world, seconds)) for key in (one, other))
        if first is None or second is None:
            return None
        enough = min(first.count, second.count) >= ENOUGH * len(MOMENTS)
        low = second.mean_low_m - first.mean_high_m
        high = second.mean_high_m - first.mean_low_m
        found = Estimate(second.mean_m - first.mean_m, low, high)
        return Part(
            about=f"{world}, {seconds:g} s ahead, {' of '.join(reversed(one))} against "
            f"{' of '.join(reversed(other))}",
            found=found,
            outcome=side(low, high, 0) if enough else "open",
            detail=f"errors of {first.mean_m:.3f} m and {second.mean_m:.3f} m",
        )

    def levelled_off(self, kind: str) -> list[Part]:
        """Look at the losses of a kind's models: yes if the last tenth fell by :data:`LEVEL` at most."""
        parts: list[Part] = []
        for model, curve in self._losses(kind):
            losses = np.array([loss for _, loss in curve])
            tenth = max(len(losses) // 10, 1)
            before, last = float(losses[-2 * tenth : -tenth].mean()), float(losses[-tenth:].mean())
            fall = 1 - last / before
            parts.append(
                Part(
                    about=f"{kind} {model}", found=Estimate(fall, fall, fall),
                    outcome="yes" if fall <= LEVEL else "no", detail="share by which the loss still fell",
                )
            )  # fmt: skip
        return parts

    def failed_seeds(self) -> Part | None:
        """Look at MADDPG's seeds: yes if any failed to converge.

        A seed failed if its last success, in unseen rooms, is below :data:`FAILED` of the best seed's. With
        fewer than three seeds there is nothing to say.
        """
        curves = self._json("maddpg-training").get("curves", {})
        if len(curves) < 3:
            return None
        last = np.array([curve[-1]["success"] for curve in curves.values()])
        found = rate(last < FAILED * last.max())
        outcome = "yes" if found.value > 0 else "no"
        return Part(about=f"share of {len(last)} seeds that failed", found=found, outcome=outcome)

    def _losses(self, kind: str) -> list[tuple[str, Any]]:
        return list(self._json("losses").get("losses", {}).get(kind, {}).items())

    def _json(self, experiment: str) -> dict[str, Any]:
        file = self.folder / experiment / SUMMARY
        return read_json(file) if file.exists() else {}

    @cached_property
    def _errors(self) -> dict[tuple[str, str, str, float], ErrorRow]:
        rows = read_rows(self.folder / "predictors" / ERRORS, ErrorRow)
        return {(r.predictor, r.role, r.world, r.seconds): r for r in rows if r.agent == r.subject == ALL}
