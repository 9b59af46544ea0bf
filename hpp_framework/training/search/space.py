"""What a search may change, what it is after, and how far it goes.

A skill declares its search in the registry ``skill_searches``, with Optuna's distributions::

    def search() -> SkillSearch:
        return SkillSearch(
            phases={
                "reward": {"reward.touch": FloatDistribution(-0.8, -0.05)},
                "network": {"network.scan": CategoricalDistribution(("conv", "dense"))},
            },
            start={"reward.touch": -0.2, "network.scan": "conv"},
            objective=judge,
        )
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

from hpp_framework.core.robot import RobotSpec
from hpp_framework.utils.errors import ConfigError

Value = float | int | str | bool
Distribution = FloatDistribution | IntDistribution | CategoricalDistribution
SCORE = "score"
"""The metric that is searched for; more is better."""

Objective = Callable[[Path, RobotSpec, int], Mapping[str, float]]
"""Judges (weights file, robot, seed); returns metrics, among them ``"score"``."""
Curve = Callable[[Path], Mapping[int, float]]
"""Reads from a training's folder how well it has gone so far, by control steps; more is better."""


@dataclass(frozen=True, kw_only=True)
class SkillSearch:
    """How a skill's training is searched, after AutoRL (Chiang et al. 2019).

    Attributes:
        phases: by name, in order: what each searches, by dotted name of the trainer's recipe. All else is
            held at the best that the phases before it found. A phase names the folder of its trials.
        start: the recipe's own value of every parameter: the first trial, which all others must beat.
        objective: what a trained policy is judged by: the task itself, not the reward it was trained with.
        curve: how well a training goes, for stopping poor ones early; None where nothing tells.
    """

    phases: Mapping[str, Mapping[str, Distribution]]
    start: Mapping[str, Value]
    objective: Objective
    curve: Curve | None = None

    def __post_init__(self) -> None:
        if not self.phases:
            raise ConfigError("a search needs one or more phases.")
        names = [name for phase in self.phases.values() for name in phase]
        if len(set(names)) < len(names):
            raise ConfigError("a search must not search for a parameter in two phases.")
        for phase in self.phases.values():
            for name, searched in phase.items():
                choices = searched.choices if isinstance(searched, CategoricalDistribution) else ()
                if searched.single() or len(set(choices)) < len(choices):
                    raise ConfigError(
                        f"'{name}' needs two or more different values, got {describe(searched)}."
                    )
        check_start(self, self.start)


@dataclass(frozen=True, kw_only=True)
class SearchConfig:
    """What to search, and how far.

    Attributes:
        skill: registered skill that declares a search.
        robot: registered robot.
        out: folder for trials, journal and report.
        steps: control steps a trial is trained for.
        trials: of each phase, the baseline among them.
        workers: trials side by side, one torch thread each.
        seed: of what is tried, of every training and of the judging.
        settings: of the trainer's recipe by dotted name; where the search starts, or else held.
        init: weights that every trial starts from, or None; then the shape of the network cannot be searched.
        rungs: rising shares of ``steps``. A trial is stopped at one if its best so far is below the median
            of the phase's finished trials there; never the baseline, nor before four have finished.
    """

    skill: str
    robot: str
    out: Path
    steps: int = 1_000_000
    trials: tuple[int, ...] = (12, 8)
    workers: int = 1
    seed: int = 1
    settings: Mapping[str, Any] = field(default_factory=lambda: dict[str, Any]())
    init: Path | None = None
    rungs: tuple[float, ...] = ()


def check_start(search: SkillSearch, start: Mapping[str, Value]) -> None:
    """Check that a search can start somewhere.

    Args:
        search: what is searched.
        start: a value for every parameter.

    Raises:
        ConfigError: if a parameter has one value only, none to start from, or one that is never tried.
    """
    for phase in search.phases.values():
        for name, searched in phase.items():
            choices = searched.choices if isinstance(searched, CategoricalDistribution) else ()
            if searched.single() or len(set(choices)) < len(choices):
                raise ConfigError(f"'{name}' needs two or more different values, got {describe(searched)}.")
            if name not in start:
                raise ConfigError(f"the search starts without a value of '{name}' ({describe(searched)}).")
            if not _holds(searched, start[name]):
                raise ConfigError(
                    f"the search cannot start from {name} = {start[name]!r}: "
                    f"it looks at {describe(searched)} only."
                )


def describe(searched: Distribution) -> str:
    """Return the values that are searched, for a person: ``0.1 to 1, logarithmic`` or ``conv | dense``."""
    if isinstance(searched, CategoricalDistribution):
        return " | ".join(map(str, searched.choices))
    return f"{searched.low:g} to {searched.high:g}{', logarithmic' if searched.log else ''}"


def _holds(searched: Distribution, value: Value) -> bool:
    if isinstance(searched, CategoricalDistribution):
        return value in searched.choices
    number = isinstance(value, int if isinstance(searched, IntDistribution) else int | float)
    return number and not isinstance(value, bool) and searched.low <= float(value) <= searched.high
