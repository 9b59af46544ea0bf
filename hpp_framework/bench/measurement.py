"""What a benchmark yields, what it is told, and how it takes time.

A benchmark is a function that yields measurements::

    def simulation(settings: Settings) -> Iterator[Measurement]:
        seconds = timed({"step": step}, settings.repeats)["step"]
        yield Measurement(name="agent steps", parameters={"robots": 2}, unit="1/s", values=rates(n, seconds))
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeVar

import numpy as np
import torch

from hpp_framework.utils.errors import HppError
from hpp_framework.utils.executor import available_cores

T = TypeVar("T")
Scale = Literal["tiny", "quick", "full"]
Parameter = str | int | float


class SkippedError(HppError):
    """A benchmark cannot run on this machine; the message says why."""


def _load() -> float:
    return round(os.getloadavg()[0], 2)


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """One figure of one case, measured several times.

    Attributes:
        name: what was measured.
        parameters: of the case.
        unit: of the values, e.g. ``"1/s"`` or ``"ms"``; ``"x"`` is a ratio.
        values: one per repeat.
        load: of the machine over the last minute, this benchmark's own included.
    """

    name: str
    parameters: Mapping[str, Parameter]
    unit: str
    values: tuple[float, ...]
    load: float = field(default_factory=_load)

    def quantile(self, share: float) -> float:
        """Return a quantile of the values: 0 is the lowest, 0.5 the median, 1 the highest."""
        return float(np.quantile(self.values, share))


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What every benchmark is told.

    Attributes:
        scale: ``"quick"`` takes minutes in all, ``"full"`` covers more cases and repeats; ``"tiny"`` is for
            tests.
        device: of the batch simulator, ``"cpu"`` or ``"cuda"``.
        team: as on the command line.
        task: registered task.
        skill: registered skill of every robot.
        seed: of worlds, starts and commands.
        threads: cores for whatever uses several.
    """

    scale: Scale = "quick"
    device: str = "cpu"
    team: str = "fetch,freight"
    task: str = "rendezvous"
    skill: str = "p2p"
    seed: int = 0
    threads: int = field(default_factory=available_cores)

    def pick(self, tiny: T, quick: T, full: T) -> T:
        """Return the value for the scale."""
        return {"tiny": tiny, "quick": quick, "full": full}[self.scale]

    @property
    def repeats(self) -> int:
        """How often a case is measured."""
        return self.pick(1, 5, 15)

    @property
    def target_seconds(self) -> float:
        """About how long one repeat of a short operation is kept going."""
        return self.pick(0.0, 0.2, 1.0)

    def wait(self) -> None:
        """Wait until the device has done everything that was asked of it."""
        if self.device.startswith("cuda"):
            torch.cuda.synchronize()


def timed(
    actions: Mapping[str, Callable[[], object]],
    repeats: int,
    *,
    warm_up: int = 1,
    budget: float = float("inf"),
) -> dict[str, list[float]]:
    """Time actions in turns, so that the load of the machine hits all of them alike.

    Args:
        actions: what to run, by name.
        repeats: rounds at most, the warm-up not counted.
        warm_up: rounds that are not timed.
        budget: seconds after which no further round begins; the first round is always run.

    Returns:
        Seconds of each action, one per round.
    """
    for _ in range(warm_up):
        for action in actions.values():
            action()
    seconds: dict[str, list[float]] = {name: [] for name in actions}
    began = time.perf_counter()
    for _ in range(repeats):
        for name, action in actions.items():
            started = time.perf_counter()
            action()
            seconds[name].append(time.perf_counter() - started)
        if time.perf_counter() - began > budget:
            break
    return seconds


def rates(amount: float, seconds: Sequence[float]) -> tuple[float, ...]:
    """Return amounts per second."""
    return tuple(amount / each for each in seconds)


def ratios(numerators: Sequence[float], denominators: Sequence[float]) -> tuple[float, ...]:
    """Return the quotients of values taken in the same rounds."""
    return tuple(a / b for a, b in zip(numerators, denominators, strict=True))
