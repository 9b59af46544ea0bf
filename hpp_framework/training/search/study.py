"""The trials of a phase in Optuna's hands: what to try next, what to stop, what was best."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

from hpp_framework.training.search.importance import fanova
from hpp_framework.training.search.space import SCORE, Choice, Phase, Range, SkillSearch, Value
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.run_folder import write_bytes
from hpp_framework.utils.seeding import child_seed

try:
    import optuna
except ImportError as error:
    raise ConfigError("`hpp search` needs Optuna: pip install hpp-framework[search]") from error

from optuna.pruners import MedianPruner
from optuna.samplers import TPESampler
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import FrozenTrial, Trial, TrialState

JOURNAL = "trials.journal"
STARTUP = 5
"""Trials of a phase, the baseline among them, before the others guide what is tried next."""
STOP_AFTER = 4
"""Finished trials of a phase before poor ones are stopped."""
DIGITS = 4
"""Of a suggested number: what is trained with is what a report can show."""
SETTINGS, METRICS, FAILURE, FOLDER = "settings", "metrics", "failure", "folder"


@dataclass(frozen=True, kw_only=True)
class TrialRow:
    """What is known of a trial.

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
    settings: Mapping[str, Value]
    metrics: Mapping[str, float] = field(default_factory=lambda: dict[str, float]())
    folder: str = ""
    failure: str = ""

    @property
    def score(self) -> float | None:
        """The score of a finished trial."""
        return self.metrics.get(SCORE)


def open_storage(out: Path) -> JournalStorage:
    """Open the journal of a search, or begin it.

    Raises:
        ConfigError: if it is damaged.
    """
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    # Optuna's lock is a link to this name, which must mean the same from everywhere
    file = out.resolve() / JOURNAL
    if file.exists():
        content = file.read_bytes()
        # a line that a killed process did not finish was not yet true
        whole = content[: content.rfind(b"\n") + 1]
        if whole != content:
            write_bytes(file, whole)
    try:
        return JournalStorage(JournalFileBackend(str(file)))
    except (ValueError, KeyError) as error:
        raise ConfigError(f"'{file}' is damaged: {error}. Choose another --out.") from error


class PhaseStudy:
    """One phase.

    Args:
        storage: of the search.
        search: what is searched.
        phase: which phase.
        settings: held in this phase, by dotted name; those that the phase searches for are where it starts.
        seed: of what is tried.
    """

    def __init__(
        self,
        storage: JournalStorage,
        search: SkillSearch,
        phase: Phase,
        settings: Mapping[str, Value],
        seed: int,
    ) -> None:
        self.phase = phase
        self._storage, self._settings, self._seed = storage, settings, seed
        self._start = {name: settings.get(name, search.start[name]) for name in phase.parameters}
        self._study = optuna.create_study(
            storage=storage, study_name=phase.name, direction="maximize", load_if_exists=True,
            pruner=MedianPruner(n_startup_trials=STOP_AFTER),
        )  # fmt: skip
        self._open: dict[int, Trial] = {}
        if not self._study.trials:
            self._study.enqueue_trial(self._start)

    @property
    def proposed(self) -> int:
        """How many trials there are, finished or not."""
        return len(self._trials()) - len(self._trials(TrialState.WAITING))

    def unfinished(self) -> list[tuple[int, dict[str, Value]]]:
        """Return number and settings of trials that an earlier run began and did not finish."""
        found = self._trials(TrialState.RUNNING)
        return [
            (each.number, self._settings_of(self._resumed(each.number)))
            for each in found
            if each.number not in self._open
        ]

    def propose(self) -> tuple[int, dict[str, Value]]:
        """Return number and settings of the next trial; the first is the baseline."""
        # each trial has a seed of its own, so that a search that was interrupted goes on as it would have
        seed = child_seed(self._seed, "search", self.phase.name, self.proposed) % 2**32
        self._study.sampler = TPESampler(seed=seed, n_startup_trials=STARTUP, constant_liar=True)
        trial = self._study.ask()
        self._open[trial.number] = trial
        return trial.number, self._settings_of(trial)

    def reach(self, number: int, rung: int, value: float) -> bool:
        """Note how well a trial's training does at a rung; returns whether to stop the trial.

        A trial is stopped if the best that it has reached so far is worse than the median of what the
        finished trials of the phase had at that rung. The baseline is never stopped.

        Args:
            number: of the trial.
            rung: control steps.
            value: of its curve there.
        """
        trial = self._open[number]
        if rung not in self._trials()[number].intermediate_values:
            trial.report(value, rung)
        return number > 0 and bool(trial.should_prune())

    def finish(self, number: int, metrics: Mapping[str, float], folder: str) -> None:
        """Record a trial's metrics and where its weights are."""
        trial = self._open.pop(number)
        trial.set_user_attr(METRICS, dict(metrics))
        trial.set_user_attr(FOLDER, folder)
        self._study.tell(trial, metrics[SCORE])

    def stop(self, number: int, folder: str) -> None:
        """Record that a trial was stopped early."""
        trial = self._open.pop(number)
        trial.set_user_attr(FOLDER, folder)
        self._study.tell(trial, state=TrialState.PRUNED)

    def fail(self, number: int, failure: str, folder: str) -> None:
        """Record that a trial came to nothing."""
        trial = self._open.pop(number)
        trial.set_user_attr(FAILURE, failure)
        trial.set_user_attr(FOLDER, folder)
        self._study.tell(trial, state=TrialState.FAIL)

    def rows(self) -> list[TrialRow]:
        """Return all trials by number."""
        begun = [each for each in self._trials() if each.state != TrialState.WAITING]
        return [_row(self.phase.name, each) for each in begun]

    def row(self, number: int) -> TrialRow:
        """Return one trial."""
        return _row(self.phase.name, self._trials()[number])

    def best(self) -> TrialRow:
        """Return the finished trial with the highest score, the first of equals."""
        finished = [row for row in self.rows() if row.score is not None]
        return max(finished, key=lambda row: row.metrics[SCORE])

    def importances(self) -> dict[str, float] | None:
        """Return each parameter's share of the score's variance, or None; see :func:`fanova`."""
        return fanova(self._study)

    def _trials(self, *states: TrialState) -> list[FrozenTrial]:
        return self._study.get_trials(deepcopy=False, states=states or None)

    def _resumed(self, number: int) -> Trial:
        study = self._storage.get_study_id_from_name(self.phase.name)
        trial = Trial(self._study, self._storage.get_trial_id_from_study_id_trial_number(study, number))
        self._open[number] = trial
        return trial

    def _settings_of(self, trial: Trial) -> dict[str, Value]:
        """Return the settings of a trial; asking for them settles those that nobody asked for before."""
        asked = {name: _suggest(trial, name, each) for name, each in self.phase.parameters.items()}
        # the baseline as it is, not as rounded
        settings = {**self._settings, **(self._start if trial.number == 0 else asked)}
        trial.set_user_attr(SETTINGS, settings)
        return settings


def _suggest(trial: Trial, name: str, parameter: Range | Choice) -> Value:
    if isinstance(parameter, Choice):
        return cast("Value", trial.suggest_categorical(name, parameter.values))
    low, high = parameter.low, parameter.high
    if parameter.whole:
        return trial.suggest_int(name, int(low), int(high), log=parameter.log)
    return float(f"{trial.suggest_float(name, low, high, log=parameter.log):.{DIGITS}g}")


def _row(phase: str, trial: FrozenTrial) -> TrialRow:
    states = {TrialState.COMPLETE: "finished", TrialState.PRUNED: "stopped", TrialState.FAIL: "failed"}
    known = trial.user_attrs
    return TrialRow(
        phase=phase, number=trial.number, state=states.get(trial.state, "unfinished"),
        settings=known.get(SETTINGS, {}), metrics=known.get(METRICS, {}), folder=known.get(FOLDER, ""),
        failure=known.get(FAILURE, ""),
    )  # fmt: skip
