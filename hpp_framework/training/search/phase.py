"""One phase of a search: an Optuna study, and the trials that fill it side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, FIRST_EXCEPTION, Future, ThreadPoolExecutor, wait
from contextlib import closing
from dataclasses import dataclass, field
from threading import Event, Lock
from typing import Any, cast

import optuna
from optuna.distributions import CategoricalDistribution, IntDistribution
from optuna.pruners import MedianPruner
from optuna.samplers import TPESampler
from optuna.storages import JournalStorage
from optuna.trial import FrozenTrial, Trial, TrialState

from hpp_framework.core.skill import SkillTraining
from hpp_framework.plugins.registry import hub
from hpp_framework.training.search.space import SCORE, Distribution, SearchConfig, SkillSearch, Value
from hpp_framework.training.search.trial import FAILURE, TrialTask, run_trial
from hpp_framework.utils.errors import HppError
from hpp_framework.utils.executor import run_tasks
from hpp_framework.utils.seeding import child_seed

STARTUP = 5
"""Trials of a phase, the baseline among them, before earlier results direct what is tried next."""
STOP_AFTER = 4
"""Finished trials of a phase before poor ones are stopped."""
DIGITS = 4
"""Of a suggested number: what is trained with is what a report can show."""
HEARTBEAT = 0.5
"""Seconds between two looks at a training; also how long stopping it may take."""
STATES = {TrialState.COMPLETE: "finished", TrialState.PRUNED: "stopped", TrialState.FAIL: "failed"}


@dataclass(frozen=True, kw_only=True)
class TrialRow:
    """What is known of a trial; all but the first three are attributes that the study keeps of it.

    Attributes:
        phase: that it is of.
        number: in its phase; 0 is the baseline.
        state: ``"finished"``, ``"stopped"`` for its curve, ``"failed"``, or ``"unfinished"``.
        settings: all that it was trained with, by dotted name.
        metrics: what it was judged to be; empty unless finished.
        folder: of its training, below the search's.
        failure: what went wrong, or empty.
    """

    phase: str
    number: int
    state: str
    settings: Mapping[str, Value] = field(default_factory=lambda: dict[str, Value]())
    metrics: Mapping[str, float] = field(default_factory=lambda: dict[str, float]())
    folder: str = ""
    failure: str = ""

    @property
    def score(self) -> float | None:
        """The score of a finished trial."""
        return self.metrics.get(SCORE)


Watch = Callable[[TrialRow, Mapping[int, float]], None]
"""Called, one call at a time, with a trial and its curve so far whenever something happened to it."""


class PhaseSearch:
    """One phase.

    Args:
        config: of the search.
        search: what is searched.
        name: of the phase.
        settings: held in this phase, by dotted name; those that the phase searches for are where it starts.
        storage: of the search.
        watch: called with whatever happens.
    """

    def __init__(
        self,
        config: SearchConfig,
        search: SkillSearch,
        name: str,
        settings: Mapping[str, Value],
        storage: JournalStorage,
        watch: Watch,
    ) -> None:
        self.name, self.parameters = name, search.phases[name]
        self.study = optuna.create_study(
            storage=storage, study_name=name, direction="maximize", load_if_exists=True,
            pruner=MedianPruner(n_startup_trials=STOP_AFTER),
        )  # fmt: skip
        self._config, self._search, self._settings, self._storage = config, search, settings, storage
        self._watch, self._watching, self._over = watch, Lock(), Event()
        self._start = {key: settings.get(key, search.start[key]) for key in self.parameters}
        if not self.study.trials:
            self.study.enqueue_trial(self._start)

    def run(self, trials: int, earlier: TrialRow | None) -> None:
        """Run until there are so many trials, none unfinished.

        Args:
            trials: how many.
            earlier: best of the phase before: the baseline of this one, which need not be trained again.

        Raises:
            HppError: what ended a trial, or that the baseline failed.
        """
        for row in self.rows():
            self._tell(row.number)
        busy: set[Future[None]] = set()
        with ThreadPoolExecutor(self._config.workers) as pool:
            try:
                for trial in self._trials(trials):
                    if trial.number == 0 and earlier:
                        self._adopt(trial, earlier)
                        continue
                    self._tell(trial.number)
                    busy.add(pool.submit(self._attempt, trial))
                    if len(busy) == self._config.workers:
                        busy = _settled(busy, FIRST_COMPLETED)
                _settled(busy, FIRST_EXCEPTION)
            finally:
                self._over.set()

    def rows(self) -> list[TrialRow]:
        """Return all trials by number."""
        return [self._row(trial) for trial in self._known() if trial.state != TrialState.WAITING]

    def best(self) -> TrialRow:
        """Return the finished trial with the highest score, the first of equals."""
        return self._row(self.study.best_trial)

    def _known(self) -> list[FrozenTrial]:
        return self.study.get_trials(deepcopy=False)

    def _row(self, trial: FrozenTrial) -> TrialRow:
        state = STATES.get(trial.state, "unfinished")
        return TrialRow(phase=self.name, number=trial.number, state=state, **trial.user_attrs)

    def _tell(self, number: int, curve: Mapping[int, float] | None = None) -> None:
        with self._watching:
            self._watch(self._row(self._known()[number]), curve or {})

    def _trials(self, count: int) -> Iterator[Trial]:
        """Yield trials to run, each asked for when it is due; first those that an earlier run began."""
        rows = self.rows()
        yield from (self._trial(row.number, begun=True) for row in rows if row.state == "unfinished")
        yield from (self._trial(number, begun=False) for number in range(len(rows), count))

    def _trial(self, number: int, *, begun: bool) -> Trial:
        """Take up a trial or ask for the next, and settle its settings."""
        # each trial has a seed of its own, so that a search that was interrupted goes on as it would have
        seed = child_seed(self._config.seed, "search", self.name, number) % 2**32
        self.study.sampler = TPESampler(seed=seed, n_startup_trials=STARTUP, constant_liar=True)
        if begun:
            study = self._storage.get_study_id_from_name(self.name)
            trial = Trial(self.study, self._storage.get_trial_id_from_study_id_trial_number(study, number))
        else:
            trial = self.study.ask()
        suggested = {name: _suggest(trial, name, each) for name, each in self.parameters.items()}
        # the baseline as it is, not as rounded
        settings = {**self._settings, **(suggested if number else self._start)}
        trial.set_user_attr("settings", settings)
        return trial

    def _adopt(self, trial: Trial, earlier: TrialRow) -> None:
        """Take over what the phase before has found: the same settings and the same seed train the same."""
        if self._search.curve:
            curve = self._search.curve(self._config.out / earlier.folder)
            self._stops(trial, curve, self._rungs())
        self._end(trial, TrialState.COMPLETE, metrics=dict(earlier.metrics), folder=earlier.folder)

    def _attempt(self, trial: Trial) -> None:
        """Run a trial to its end, or until the search is over."""
        config, number = self._config, trial.number
        folder = config.out / self.name / f"trial-{number:03d}"
        task = TrialTask(
            trainer=hub().skill_trainers.entry(config.skill).factory(), search=self._search,
            training=SkillTraining(
                robot=config.robot, out=folder, seed=config.seed, steps=config.steps, threads=1,
                init=config.init, settings=self._row(self._known()[number]).settings, judge=False,
            ),
            seed=child_seed(config.seed, "search", "judging"),
        )  # fmt: skip
        place, rungs = str(folder.relative_to(config.out)), self._rungs()
        with closing(run_tasks(run_trial, [task], workers=1, every=HEARTBEAT)) as reports:
            for report in reports:
                if self._over.is_set():
                    return
                curve = self._search.curve(folder) if self._search.curve else {}
                if isinstance(report, str):
                    if number == 0:
                        raise HppError(f"the baseline failed: {report}. See '{folder / FAILURE}'.")
                    return self._end(trial, TrialState.FAIL, failure=report, folder=place)
                if self._stops(trial, curve, rungs):
                    return self._end(trial, TrialState.PRUNED, folder=place)
                if report is not None:
                    return self._end(trial, TrialState.COMPLETE, metrics=dict(report), folder=place)
                self._tell(number, curve)

    def _rungs(self) -> list[int]:
        return [round(share * self._config.steps) for share in self._config.rungs]

    def _stops(self, trial: Trial, curve: Mapping[int, float], rungs: list[int]) -> bool:
        """Report the rungs that a training has reached, and take them off; return whether to stop it."""
        while rungs and (reached := [step for step in sorted(curve) if step >= rungs[0]]):
            rung = rungs.pop(0)
            if rung not in self._known()[trial.number].intermediate_values:
                trial.report(curve[reached[0]], rung)
            if trial.number > 0 and trial.should_prune():
                return True
        return False

    def _end(self, trial: Trial, state: TrialState, **attributes: Any) -> None:
        for name, content in attributes.items():
            trial.set_user_attr(name, content)
        score = attributes["metrics"][SCORE] if state == TrialState.COMPLETE else None
        self.study.tell(trial, score, state)
        self._tell(trial.number)


def _settled(busy: set[Future[None]], until: str) -> set[Future[None]]:
    """Wait for trials, raise what ended one, and return those still under way."""
    done, left = wait(busy, return_when=until)
    for future in done:
        future.result()
    return left


def _suggest(trial: Trial, name: str, searched: Distribution) -> Value:
    if isinstance(searched, CategoricalDistribution):
        return cast("Value", trial.suggest_categorical(name, searched.choices))
    if isinstance(searched, IntDistribution):
        return trial.suggest_int(name, searched.low, searched.high, step=searched.step, log=searched.log)
    low, high = searched.low, searched.high
    value = trial.suggest_float(name, low, high, step=searched.step, log=searched.log)
    return float(f"{value:.{DIGITS}g}")
