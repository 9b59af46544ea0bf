"""The benchmarks by name, and what runs one of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib import import_module

import torch

from hpp_framework.bench.measurement import Measurement, Settings, SkippedError
from hpp_framework.plugins.build import parse_team
from hpp_framework.utils.errors import ConfigError, unknown_name

Benchmark = Callable[[Settings], Iterator[Measurement]]

BENCHMARKS = {
    "machine": "machine:machine",
    "simulation": "simulators:simulation",
    "scans": "simulators:scans",
    "sapien": "simulators:sapien",
    "collecting": "predictors:collecting",
    "predictors": "predictors:predictors",
    "planning": "planning:planning",
    "skill": "skill:skill",
    "episodes": "planning:episodes",
}


@dataclass(frozen=True)
class Result:
    """What one benchmark gave.

    Attributes:
        benchmark: its name.
        measurements: all of them, or those before an interruption.
        skipped: why it did not run, if it did not.
    """

    benchmark: str
    measurements: tuple[Measurement, ...] = ()
    skipped: str = ""


def find(name: str) -> Benchmark:
    """Return a benchmark; its module is imported only now."""
    module, _, function = BENCHMARKS[name].partition(":")
    return getattr(import_module(f"hpp_framework.bench.{module}"), function)


def check(names: Sequence[str], settings: Settings) -> None:
    """Check names, team and device before anything runs.

    Raises:
        UnknownNameError: if there is no such benchmark or robot.
        ConfigError: if the device is not there.
    """
    parse_team(settings.team, skill=settings.skill)
    for name in names:
        if name not in BENCHMARKS:
            raise unknown_name("benchmark", name, BENCHMARKS)
    if settings.device != "cpu" and not settings.device.startswith("cuda"):
        raise ConfigError(f"--device must be 'cpu' or 'cuda', got '{settings.device}'.")
    if settings.device.startswith("cuda") and not torch.cuda.is_available():
        raise ConfigError("--device cuda: torch finds no CUDA device here; `hpp doctor` says more.")


def run_benchmark(name: str, settings: Settings) -> Iterator[Result]:
    """Run one benchmark.

    Yields:
        The result so far after each measurement, so that an interruption loses none.
    """
    threads = torch.get_num_threads()
    result = Result(name)
    try:
        # small tensors are slower on two threads; benchmarks that gain from more ask for them
        torch.set_num_threads(1)
        for measurement in find(name)(settings):
            result = replace(result, measurements=(*result.measurements, measurement))
            yield result
    except SkippedError as error:
        yield replace(result, skipped=str(error))
    finally:
        torch.set_num_threads(threads)
