"""Search for rewards and networks after AutoRL.

Chiang, Faust, Fiser, Francis 2019, "Learning Navigation Behaviors End-to-End with AutoRL": first the weights
of the reward are searched for with the network as it is, then the network with the best reward. Every trial
trains a policy, and is judged by whether it reaches goals, not by the reward that it was trained with.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from itertools import pairwise
from typing import Any

from hpp_framework.plugins.registry import hub
from hpp_framework.plugins.weights import differences, file_digest
from hpp_framework.training.search.config import SearchConfig
from hpp_framework.training.search.phase import PhaseRun, Watch
from hpp_framework.training.search.report import write_report
from hpp_framework.training.search.space import SkillSearch, Value, check_start
from hpp_framework.training.search.study import PhaseStudy, TrialRow, open_storage
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.run_folder import RunFolder

CONFIG = "search.json"


def search_skill(config: SearchConfig, watch: Watch = lambda _: None) -> TrialRow:
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
    storage = open_storage(config.out)
    settings: dict[str, Value] = dict(config.settings)
    studies: list[PhaseStudy] = []
    best: TrialRow | None = None
    try:
        for phase, trials in zip(search.phases, config.trials, strict=True):
            study = PhaseStudy(storage, search, phase, settings, config.seed)
            studies.append(study)
            PhaseRun(config, search, study, watch).run(trials, best)
            best = study.best()
            settings = dict(best.settings)
    finally:
        write_report(config, search, studies)
    assert best is not None  # there is a phase, and it has a baseline
    return best


def _check(config: SearchConfig, search: SkillSearch) -> None:
    if len(config.trials) != len(search.phases) or min(config.trials) < 1:
        wanted = ", ".join(phase.name for phase in search.phases)
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
        "phases": {p.name: {n: str(each) for n, each in p.parameters.items()} for p in search.phases},
        "start": dict(search.start),
    }
    RunFolder(config.out).claim(
        CONFIG, wanted, what="search", compare=_differences,
        remedy="Give the same options to go on with it, or choose another --out.",
    )  # fmt: skip


def _differences(found: Mapping[str, Any], wanted: Mapping[str, Any]) -> str:
    return "; ".join(differences(found, wanted))
