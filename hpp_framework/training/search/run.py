"""Search for rewards and networks after AutoRL.

Chiang, Faust, Fiser, Francis 2019, "Learning Navigation Behaviors End-to-End with AutoRL": first the weights
of the reward are searched for with the network as it is, then the network with the best reward. Every trial
trains a policy, and is judged by whether it reaches goals, not by the reward that it was trained with.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Any

import optuna
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend

from hpp_framework.plugins.registry import hub
from hpp_framework.plugins.weights import file_digest
from hpp_framework.training.search import report
from hpp_framework.training.search.phase import PhaseSearch, TrialRow, Watch
from hpp_framework.training.search.space import SearchConfig, SkillSearch, Value, check_start, describe
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.run_folder import RunFolder

CONFIG, JOURNAL = "search.json", "trials.journal"


def search_skill(config: SearchConfig, watch: Watch = lambda _row, _curve: None) -> TrialRow:
    """Search all phases and write the report; goes on where an earlier run of the same search ended.

    Args:
        config: what to search.
        watch: called with whatever happens.

    Returns:
        The best trial.

    Raises:
        ConfigError: if an option is wrong, or the folder holds another search.
        HppError: if a trial ends by something that the user can put right, or the baseline fails.
        KeyboardInterrupt: after an interruption; what has finished is reported.
    """
    search: SkillSearch = hub().skill_searches.create(config.skill)
    hub().robots.entry(config.robot)
    _check(config, search)
    _open_folder(config, search)
    storage = open_journal(config.out)
    settings: Mapping[str, Value] = config.settings
    phases: list[PhaseSearch] = []
    best: TrialRow | None = None
    try:
        for name, trials in zip(search.phases, config.trials, strict=True):
            phases.append(PhaseSearch(config, search, name, settings, storage, watch))
            phases[-1].run(trials, best)
            best = phases[-1].best()
            settings = best.settings
    finally:
        report.write_report(config, search, phases)
    assert best is not None  # there is a phase, and it has a baseline
    return best


def _check(config: SearchConfig, search: SkillSearch) -> None:
    if len(config.trials) != len(search.phases) or min(config.trials) < 1:
        wanted = ", ".join(search.phases)
        raise ConfigError(
            f"trials must be a number of at least 1 for each phase ({wanted}), got {config.trials}."
        )
    shares = [0.0, *config.rungs, 1.0]
    if any(low >= high for low, high in pairwise(shares)):
        raise ConfigError(f"rungs must be rising shares between 0 and 1, got {config.rungs}.")
    if config.rungs and search.curve is None:
        raise ConfigError(f"the search of '{config.skill}' cannot stop trials early: leave out the rungs.")
    check_start(search, {**search.start, **config.settings})


def _open_folder(config: SearchConfig, search: SkillSearch) -> None:
    """Say in the folder what is searched, or check that it holds the same search."""
    wanted = {
        **{key: value for key, value in asdict(config).items() if key not in ("out", "workers", "init")},
        "init": file_digest(config.init),
        "phases": {
            name: {key: describe(searched) for key, searched in phase.items()}
            for name, phase in search.phases.items()
        },
        "start": dict(search.start),
    }
    RunFolder(config.out).claim(
        CONFIG, wanted, what="search", compare=_differences,
        remedy="Give the same options to go on with it, or choose another --out.",
    )  # fmt: skip


def _differences(found: Mapping[str, Any], wanted: Mapping[str, Any]) -> str:
    return "; ".join(
        f"{key} was {found.get(key)!r}, is {wanted[key]!r}" if not isinstance(wanted[key], dict) else key
        for key in wanted
        if found.get(key) != wanted[key]
    )


def open_journal(out: Path) -> JournalStorage:
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
            file.write_bytes(whole)
    try:
        return JournalStorage(JournalFileBackend(str(file)))
    except (ValueError, KeyError) as error:
        raise ConfigError(f"'{file}' is damaged: {error}. Choose another --out.") from error
