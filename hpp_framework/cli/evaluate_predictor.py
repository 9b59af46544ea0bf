"""``hpp evaluate predictor``: how far off motion models are, and whether they know how sure to be."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from hpp_framework.cli.options import names
from hpp_framework.cli.progress import cell_bars
from hpp_framework.plugins.builtin import DEFAULT_DISTURBANCES, DEFAULT_ESTIMATOR
from hpp_framework.utils.run_folder import RunFolder

TABLE_WIDTH = 120


@dataclass(frozen=True, kw_only=True)
class EvaluatePredictor:
    """Drive a team to common goals in fresh worlds, and ask predictors on the way where all robots will be.

    The models constant-velocity and empty-world, which have learnt nothing, are always asked too. Writes
    report.md with its pictures, errors.csv (one row per predictor, world, robots and horizon),
    calibration.csv, summary.json and config.json into --out.
    """

    name: Annotated[str, tyro.conf.Positional] = "delta-pose-lidar"
    """Registered predictor."""
    compare: str = ""
    """More registered predictors that are asked the same, separated by commas."""
    team: str = "fetch,freight"
    """Robots, separated by commas; 'id=robot' names one."""
    skill: str = "p2p"
    """Registered skill of every robot."""
    worlds: str = "training"
    """Registered worlds or YAML files, separated by commas."""
    trajectories: int = 200
    """Trajectories per world; each asks at three moments."""
    seconds: float = 12.0
    """Look so far ahead, at most."""
    weights: str = ""
    """Extra folders searched for predictor weights, separated by commas."""
    seed: int = 0
    """Seed of worlds, starts, goals and disturbances."""
    out: Path = Path("out/predictor")
    """Folder to write to."""
    disturbances: str = DEFAULT_DISTURBANCES
    """Of sensing and acting: ideal, paper, field or harsh, with settings or without."""
    estimator: str = DEFAULT_ESTIMATOR
    """Registered estimator, with settings or without."""

    def run(self) -> None:
        """Ask, and print the errors."""
        from hpp_framework.evaluation.predictor_study import (
            ERRORS,
            REPORT,
            PredictorStudy,
            run_study,
        )

        listed = f"{self.name},{self.compare}" if self.compare else self.name
        study = PredictorStudy(
            predictors=names(listed, "--compare" if self.compare else "predictor"),
            team=self.team,
            skill=self.skill,
            worlds=names(self.worlds, "--worlds"),
            trajectories=self.trajectories,
            seconds=self.seconds,
            weights=names(self.weights, "--weights") if self.weights else (),
            disturbances=self.disturbances,
            estimator=self.estimator,
            seed=self.seed,
        )
        with RunFolder(self.out).locked(), cell_bars("steps") as report:
            summary = run_study(study, self.out, progress=report)
        console = Console(width=TABLE_WIDTH)
        console.print(error_table(summary))
        if any("calibration" in row for row in summary):
            console.print(calibration_table(summary))
        print(f"errors: {self.out / ERRORS}\nreport: {self.out / REPORT}")


def error_table(summary: list[dict[str, Any]]) -> Table:
    """Return the mean errors of :func:`hpp_framework.evaluation.predictor_study.run_study` as a table."""
    from hpp_framework.evaluation.predictor_study import TABLE_SECONDS

    first = summary[0]
    title = (
        f"mean position error in metres (in brackets: 90 % are better): {first['team']}, "
        f"{first['trajectories']} trajectories per world, seed {first['seed']}"
    )
    table = Table(box=None, title=escape(title), title_justify="left", title_style="")
    for column in ("world", "role", "predictor"):
        table.add_column(column)
    for seconds in TABLE_SECONDS:
        table.add_column(f"{seconds:g} s", justify="right")
    order = sorted(
        summary, key=lambda row: (row["world"] == "all worlds", row["world"], row["role"] != "self")
    )
    for row in order:
        errors = {each["seconds"]: each for each in row["errors"]}
        cells = (_error(errors.get(seconds)) for seconds in TABLE_SECONDS)
        table.add_row(escape(row["world"]), row["role"], escape(row["predictor"]), *cells)
    return table


def calibration_table(summary: list[dict[str, Any]]) -> Table:
    """Return how sure predictors were, and should have been, as a table."""
    table = Table(
        box=None, title="share of true positions in the region of", title_justify="left", title_style=""
    )
    levels = (50, 80, 90, 95)
    for column in ("world", "role", "predictor", *(f"{level} %" for level in levels), "NLL", "NLL, one std"):
        table.add_column(column, justify="left" if column in ("world", "role", "predictor") else "right")
    for row in summary:
        if "calibration" in row:
            found = row["calibration"]
            table.add_row(
                escape(row["world"]), row["role"], escape(row["predictor"]),
                *(f"{found[f'coverage_{level}']:.3f}" for level in levels), f"{found['nll']:.2f}",
                f"{found['nll_constant']:.2f}",
            )  # fmt: skip
    return table


def _error(found: dict[str, float] | None) -> str:
    return "-" if found is None else f"{found['mean_m']:.3f} ({found['p90_m']:.3f})"
