"""What a search may change, and what it is after; nothing here needs Optuna.

A skill declares its search in the registry ``skill_searches``::

    def search() -> SkillSearch:
        reward = Phase("reward", {"reward.touch": Range(-0.8, -0.05)})
        network = Phase("network", {"network.scan": Choice(("conv", "dense"))})
        return SkillSearch(
            phases=(reward, network), start={"reward.touch": -0.2, "network.scan": "conv"}, objective=judge
        )
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from hpp_framework.core.robot import RobotSpec
from hpp_framework.utils.errors import ConfigError

Value = float | int | str | bool
SCORE = "score"
"""The metric that is searched for; more is better."""

Objective = Callable[[Path, RobotSpec, int], Mapping[str, float]]
"""Judges (weights file, robot, seed); returns metrics, among them ``"score"``."""
Curve = Callable[[Path], Mapping[int, float]]
"""Reads from a training's folder how well it has gone so far, by control steps; more is better."""


@dataclass(frozen=True)
class Range:
    """Numbers between two bounds, both included; whole numbers if both bounds are.

    Attributes:
        low: smallest.
        high: largest.
        log: whether equal ratios are equally likely, rather than equal differences.
    """

    low: float
    high: float
    log: bool = False

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise ConfigError(f"a range needs its low bound below its high one, got {self.low}, {self.high}.")
        if self.log and self.low <= 0:
            raise ConfigError(f"a logarithmic range needs bounds above 0, got {self.low}.")

    @property
    def whole(self) -> bool:
        """Whether only whole numbers are meant."""
        return isinstance(self.low, int) and isinstance(self.high, int)

    def holds(self, value: Value) -> bool:
        """Return whether a value is in here."""
        number = isinstance(value, int) if self.whole else isinstance(value, int | float)
        return number and not isinstance(value, bool) and self.low <= float(value) <= self.high

    def place(self, value: Value) -> float:
        """Return where a value lies on an axis."""
        return float(value)

    def __str__(self) -> str:
        return f"{self.low:g} to {self.high:g}{', logarithmic' if self.log else ''}"


@dataclass(frozen=True)
class Choice:
    """One of some values.

    Attributes:
        values: at least two, all different.
    """

    values: tuple[Value, ...]

    def __post_init__(self) -> None:
        if len(set(self.values)) < 2 or len(set(self.values)) < len(self.values):
            raise ConfigError(f"a choice needs two or more different values, got {self.values}.")

    def holds(self, value: Value) -> bool:
        """Return whether a value is in here."""
        return value in self.values

    def place(self, value: Value) -> float:
        """Return where a value lies on an axis."""
        return float(self.values.index(value))

    def __str__(self) -> str:
        return " | ".join(map(str, self.values))


@dataclass(frozen=True)
class Phase:
    """What is searched at a time, everything else being held.

    Attributes:
        name: of the phase, and of the folder of its trials.
        parameters: by dotted name of the trainer's recipe.
    """

    name: str
    parameters: Mapping[str, Range | Choice]


@dataclass(frozen=True, kw_only=True)
class SkillSearch:
    """How a skill's training is searched, after AutoRL (Chiang et al. 2019).

    Attributes:
        phases: in order; a phase keeps the best that the ones before it found.
        start: the recipe's own value of every parameter: the first trial, which all others must beat.
        objective: what a trained policy is judged by: the task itself, not the reward it was trained with.
        curve: how well a training goes, for stopping poor ones early; None where nothing tells.
    """

    phases: tuple[Phase, ...]
    start: Mapping[str, Value]
    objective: Objective
    curve: Curve | None = None

    def __post_init__(self) -> None:
        names = [phase.name for phase in self.phases]
        if not names or len(set(names)) < len(names):
            raise ConfigError(f"a search needs one or more phases of different names, got {names}.")
        parameters = [name for phase in self.phases for name in phase.parameters]
        if len(set(parameters)) < len(parameters):
            raise ConfigError("a search must not search for a parameter in two phases.")
        check_start(self, self.start)


def check_start(search: SkillSearch, start: Mapping[str, Value]) -> None:
    """Check that a search can start somewhere.

    Args:
        search: what is searched.
        start: a value for every parameter.

    Raises:
        ConfigError: if a parameter has no value to start from, or one that is never tried.
    """
    for phase in search.phases:
        for name, parameter in phase.parameters.items():
            if name not in start:
                raise ConfigError(f"the search starts without a value of '{name}' ({parameter}).")
            if not parameter.holds(start[name]):
                raise ConfigError(
                    f"the search cannot start from {name} = {start[name]!r}: it looks at {parameter} only."
                )
