"""Trains motion models side by side, in workers."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import replace

from hpp_framework.core.predictor import PredictorTraining, TrainingProgress
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.executor import Report, run_tasks


def train_predictors(
    kind: str, trainings: Sequence[PredictorTraining], *, workers: int
) -> Generator[TrainingProgress, None, None]:
    """Train models and yield how far each has come; finished ones are kept, unfinished ones resume.

    Args:
        kind: registered predictor.
        trainings: one per model.
        workers: trained side by side, one thread each.
    """
    yield from run_tasks(_train, [(kind, training) for training in trainings], workers=workers)


def _train(task: tuple[str, PredictorTraining], report: Report) -> None:
    kind, training = task
    hub().predictor_trainers.create(kind, replace(training, report=report))
