"""The trials of one phase: handed out, watched, stopped and recorded."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from hpp_framework.core.skill import SkillTraining
from hpp_framework.plugins.registry import hub
from hpp_framework.training.search.config import SearchConfig
from hpp_framework.training.search.slots import Slots
from hpp_framework.training.search.space import SkillSearch, Value
from hpp_framework.training.search.study import PhaseStudy, TrialRow
from hpp_framework.training.search.trial import FAILURE, TrialReport, TrialTask
from hpp_framework.utils.errors import HppError
from hpp_framework.utils.seeding import child_seed


@dataclass(frozen=True, kw_only=True)
class SearchEvent:
    """What happened to a trial.

    Attributes:
        row: the trial, its state among what is known.
        steps: control steps that it has been trained for.
        practice: how well its training goes, or None.
    """

    row: TrialRow
    steps: int = 0
    practice: float | None = None


Watch = Callable[[SearchEvent], None]


class PhaseRun:
    """Runs the trials of one phase.

    Args:
        config: of the search.
        search: what is searched.
        study: of the phase.
        watch: called with whatever happens.
    """

    def __init__(self, config: SearchConfig, search: SkillSearch, study: PhaseStudy, watch: Watch) -> None:
        self.config, self.search, self.study, self.watch = config, search, study, watch
        self._trainer = hub().skill_trainers.entry(config.skill).factory()
        self._decided: set[int] = set()
        self._rungs: dict[int, list[int]] = {}
        for row in study.rows():
            self._tell(row.number)

    def run(self, trials: int, earlier: TrialRow | None) -> None:
        """Run until there are so many trials, none unfinished.

        Args:
            trials: how many.
            earlier: best of the phase before: the baseline of this one, which need not be trained again.
        """
        tasks = self._tasks(trials, earlier)
        with Slots(self.config.workers) as slots:
            while True:
                while slots.busy < slots.workers and (task := next(tasks, None)):
                    slots.start(task)
                    self._tell(task.number)
                if not slots.busy:
                    return
                task, report = slots.next()
                self._receive(task, report, slots)

    def _tasks(self, trials: int, earlier: TrialRow | None) -> Iterator[TrialTask]:
        """Propose trials one by one, those first that an earlier run left unfinished."""
        for number, settings in self.study.unfinished():
            if number == 0 and earlier:
                self._adopt(earlier)
            else:
                yield self._task(number, settings)
        while self.study.proposed < trials:
            number, settings = self.study.propose()
            if number == 0 and earlier:
                self._adopt(earlier)
            else:
                yield self._task(number, settings)

    def _adopt(self, earlier: TrialRow) -> None:
        """Take over what the phase before has found: the same settings and the same seed train the same."""
        if self.search.curve:
            self._climb(0, self.search.curve(self.config.out / earlier.folder))
        self.study.finish(0, earlier.metrics, earlier.folder)
        self._tell(0)

    def _task(self, number: int, settings: Mapping[str, Value]) -> TrialTask:
        config = self.config
        folder = config.out / self.study.phase.name / f"trial-{number:03d}"
        return TrialTask(
            phase=self.study.phase.name, number=number, trainer=self._trainer, search=self.search,
            training=SkillTraining(
                robot=config.robot, out=folder, seed=config.seed, steps=config.steps, threads=1,
                init=config.init, settings=settings, judge=False,
            ),
            seed=child_seed(config.seed, "search", "judging"),
        )  # fmt: skip

    def _receive(self, task: TrialTask, report: TrialReport | None, slots: Slots) -> None:
        number = task.number
        folder = str(task.training.out.relative_to(self.config.out))
        if number in self._decided:
            return  # the last words of a trial that was stopped
        if report is None:
            raise HppError(
                f"trial {number} of phase '{task.phase}' was interrupted; the same command resumes."
            )
        if report.failure is not None:
            self._decided.add(number)
            if number == 0:
                raise HppError(f"the baseline failed: {report.failure}. See '{task.training.out / FAILURE}'.")
            self.study.fail(number, report.failure, folder)
        elif self._climb(number, report.curve):
            self._decided.add(number)
            slots.stop(task)
            self.study.stop(number, folder)
        elif report.metrics is not None:
            self._decided.add(number)
            self.study.finish(number, report.metrics, folder)
        self._tell(number, report.curve)

    def _climb(self, number: int, curve: Mapping[int, float]) -> bool:
        """Put a trial to the rungs that its training has reached; returns whether to stop it."""
        left = self._rungs.setdefault(
            number, [round(share * self.config.steps) for share in self.config.rungs]
        )
        while left and (reached := [step for step in sorted(curve) if step >= left[0]]):
            if self.study.reach(number, left.pop(0), curve[reached[0]]):
                return True
        return False

    def _tell(self, number: int, curve: Mapping[int, float] | None = None) -> None:
        last = max(curve, default=0) if curve else 0
        row = self.study.row(number)
        self.watch(SearchEvent(row=row, steps=last, practice=curve[last] if curve and last else None))
