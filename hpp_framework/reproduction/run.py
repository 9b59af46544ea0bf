"""Runs the experiments of a reproduction side by side.

Every experiment resumes by itself. Its results do not depend on interruptions, nor on what runs beside it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from hpp_framework.evaluation.experiment import Experiment, run_experiment
from hpp_framework.evaluation.predictor_study import REPORT, PredictorStudy, run_study
from hpp_framework.reproduction.curves import collect_curves
from hpp_framework.reproduction.experiments import experiments
from hpp_framework.reproduction.plan import Planned, choose, write_plan
from hpp_framework.utils.executor import Report, run_tasks


@dataclass(frozen=True)
class Step:
    """How far an experiment has come.

    Attributes:
        experiment: its name.
        part: what is under way, e.g. a world and a planner.
        done: of that part.
        total: of that part.
        parts: of the experiment; 0 says that all of them are finished.
    """

    experiment: str
    part: str
    done: int
    total: int
    parts: int


def reproduce(
    out: Path, *, scale: str = "standard", seed: int = 0, only: tuple[str, ...] = (), workers: int = 1
) -> Iterator[Step]:
    """Run what is not yet in ``out``.

    Args:
        out: folder; created, or resumed if it holds the same reproduction.
        scale: name of a scale.
        seed: of worlds, starts and agents.
        only: names of the experiments to run; all if empty.
        workers: processes, one torch thread each; the results do not depend on it.

    Yields:
        Each step, as it is done.

    Raises:
        HppError: if a name is wrong, or ``out`` holds something else, is damaged or cannot be written.
    """
    planned = experiments(scale, seed)
    chosen = choose(planned, only)
    write_plan(out, scale, seed, planned)
    tasks = [(each, out) for each in chosen]
    with closing(run_tasks(run_planned, tasks, workers=workers)) as steps:
        yield from steps


def run_planned(task: tuple[Planned, Path], report: Report) -> None:
    """Run one experiment, or what is missing of it; called in a worker.

    Args:
        task: the experiment, and the folder of the reproduction.
        report: called with each :class:`Step`.

    Raises:
        HppError: if its folder holds something else, is damaged or cannot be written, or weights are missing.
    """
    planned, out = task
    folder, work = planned.folder(out), planned.work

    def progress(part: str, done: int, total: int) -> None:
        report(Step(planned.name, part, done, total, planned.cells))

    if isinstance(work, Experiment):
        run_experiment(work, folder, progress=progress)
    elif not isinstance(work, PredictorStudy):
        collect_curves(work, folder)
    elif not (folder / REPORT).exists():  # written last
        run_study(work, folder, progress=progress)
    report(Step(planned.name, "", 0, 0, 0))
