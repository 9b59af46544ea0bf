"""One trial of a search, in a process of its own: train, then judge."""

from __future__ import annotations

import math
import os
import traceback
from collections.abc import Callable, Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path

from hpp_framework.core.skill import SkillTraining
from hpp_framework.plugins.registry import hub
from hpp_framework.training.search.space import SCORE, SkillSearch
from hpp_framework.utils.errors import ConfigError, HppError
from hpp_framework.utils.executor import Report
from hpp_framework.utils.run_folder import read_json, write_json, write_text

TRAINED, LOG, FAILURE = "trained.json", "log.txt", "failure.txt"

TrialReport = Mapping[str, float] | str | None
"""The metrics of a finished trial, or why there will never be any, or None while it is under way."""


@dataclass(frozen=True, kw_only=True)
class TrialTask:
    """What a worker is told.

    Attributes:
        trainer: of the skill.
        training: what to train.
        search: what judges it.
        seed: of the judging.
    """

    trainer: Callable[[SkillTraining], Path]
    training: SkillTraining
    search: SkillSearch
    seed: int


def run_trial(task: TrialTask, report: Report) -> None:
    """Train, report None, judge, and report the metrics or the failure.

    A trial that was interrupted goes on where its trainer does; one that is trained is only judged.

    Raises:
        HppError: if something is wrong that the user can put right. Whatever else goes wrong is the trial's
            own fault, a policy that diverged, say, and reported as its failure.
    """
    folder = task.training.out
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with (folder / LOG).open("a") as log, redirect_stdout(log):
            file = _trained(task)
            # what is stopped for its curve is stopped before it is judged, however fast the training was
            report(None)
            metrics = _judged(task, file)
        report(metrics)
    except HppError:
        raise
    except Exception as error:
        write_text(folder / FAILURE, traceback.format_exc())
        report(f"{type(error).__name__}: {error}")


def _trained(task: TrialTask) -> Path:
    folder = task.training.out
    marker = folder / TRAINED
    if marker.exists():
        return folder / str(read_json(marker)["weights"])
    file = task.trainer(task.training)
    write_json(marker, {"weights": os.path.relpath(file, folder)})
    return file


def _judged(task: TrialTask, file: Path) -> dict[str, float]:
    found = task.search.objective(file, hub().robots.create(task.training.robot), task.seed)
    if SCORE not in found:
        raise ConfigError(
            f"the objective of a search must return '{SCORE}', got {', '.join(found) or 'none'}."
        )
    metrics = {name: float(value) for name, value in found.items()}
    if not math.isfinite(metrics[SCORE]):
        raise ValueError(f"the score is {metrics[SCORE]}")
    return metrics
