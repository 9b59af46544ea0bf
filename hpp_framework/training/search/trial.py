"""One trial of a search, in a worker process: train, show how it goes, judge."""

from __future__ import annotations

import math
import os
import traceback
from collections.abc import Callable, Generator, Mapping
from contextlib import closing, contextmanager, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event, Lock, Thread

from hpp_framework.core.skill import SkillTraining
from hpp_framework.plugins.registry import hub
from hpp_framework.training.search.space import SCORE, SkillSearch
from hpp_framework.utils.errors import ConfigError, HppError
from hpp_framework.utils.executor import Report, run_tasks
from hpp_framework.utils.run_folder import read_json, write_json, write_text

HEARTBEAT = 0.5
"""Seconds between two looks at a training; also how long stopping it may take."""
TRAINED, LOG, FAILURE = "trained.json", "log.txt", "failure.txt"


@dataclass(frozen=True, kw_only=True)
class TrialTask:
    """What a worker is told.

    Attributes:
        phase: that the trial is of.
        number: of the trial in its phase.
        trainer: of the skill.
        training: what to train.
        search: what judges it.
        seed: of the judging.
    """

    phase: str
    number: int
    trainer: Callable[[SkillTraining], Path]
    training: SkillTraining
    search: SkillSearch
    seed: int


@dataclass(frozen=True, kw_only=True)
class TrialReport:
    """What a worker tells.

    Attributes:
        curve: how well the training has gone so far, by control steps.
        metrics: of the finished trial, or None.
        failure: why there are none and never will be, or None.
    """

    curve: Mapping[int, float] = field(default_factory=lambda: dict[int, float]())
    metrics: Mapping[str, float] | None = None
    failure: str | None = None


def launch(task: TrialTask) -> Generator[TrialReport, None, None]:
    """Do a trial in a process of its own, which ends when the iteration is left.

    Raises:
        HppError: what the trial raised, or that its process was killed.
    """
    with closing(run_tasks(run_trial, [task], workers=1)) as reports:
        yield from reports


def run_trial(task: TrialTask, report: Report) -> None:
    """Train and judge, telling how the training goes.

    A trial that was interrupted goes on where its trainer does; one that is trained is only judged.

    Raises:
        HppError: if something is wrong that the user can put right. Whatever else goes wrong is the trial's
            own fault, a policy that diverged, say, and reported as its failure.
    """
    folder = task.training.out
    folder.mkdir(parents=True, exist_ok=True)
    lock = Lock()

    def tell(content: TrialReport) -> None:
        with lock:
            report(content)

    try:
        with (folder / LOG).open("a") as log, redirect_stdout(log):
            with _heart(task, tell):
                file = _trained(task)
            # what is stopped for its curve is stopped before it is judged, however fast the training was
            tell(_look(task))
            with _heart(task, tell):
                metrics = _judged(task, file)
        tell(TrialReport(curve=_look(task).curve, metrics=metrics))
    except HppError:
        raise
    except KeyboardInterrupt:
        return  # the process that started this one was interrupted too
    except Exception as error:
        write_text(folder / FAILURE, traceback.format_exc())
        tell(TrialReport(failure=f"{type(error).__name__}: {error}"))


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


def _look(task: TrialTask) -> TrialReport:
    curve = task.search.curve
    return TrialReport(curve=curve(task.training.out) if curve else {})


@contextmanager
def _heart(task: TrialTask, tell: Callable[[TrialReport], None]) -> Generator[None, None, None]:
    """Tell how a training goes for as long as the context lasts."""
    over = Event()

    def beat() -> None:
        while not over.wait(HEARTBEAT):
            try:
                tell(_look(task))
            except (BrokenPipeError, ConnectionResetError):
                os._exit(1)  # nobody is left to train for

    heart = Thread(target=beat, daemon=True)
    heart.start()
    try:
        yield
    finally:
        over.set()
        heart.join()
