"""Benchmarks of predictors: collecting motion data, and training on them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from torch.utils.flop_counter import FlopCounterMode

from hpp_framework.bench.machine import Product
from hpp_framework.bench.measurement import (
    Measurement,
    Parameter,
    Settings,
    rates,
    ratios,
    timed,
)
from hpp_framework.core.predictor import PredictorTraining
from hpp_framework.core.team import Team
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import hub
from hpp_framework.prediction.collect import Collection, collect
from hpp_framework.utils.executor import Report, run_tasks
from hpp_framework.worlds.pool import build_pool


def collecting(settings: Settings) -> Iterator[Measurement]:
    """Trajectories per second, from rooms to files on disk, once all workers run; and how long that takes."""
    team = parse_team(settings.team, skill=settings.skill)
    chunks = settings.threads + settings.pick(2, 4, 10)
    repeats = settings.pick(1, 3, 5)
    runs = [_collect(team, _collection(settings, chunks, repeat), settings) for repeat in range(repeats)]
    first, rate = zip(*runs, strict=True)
    config = _collection(settings, chunks)
    case = {"robots": len(team), "steps": config.steps, "chunk": config.chunk, "workers": settings.threads}
    yield Measurement(name="trajectories", parameters=case, unit="1/s", values=rate)
    yield Measurement(name="first chunks", parameters=case, unit="s", values=first)
    rooms = settings.pick(2, 100, 400)
    taken = timed(
        {"rooms": lambda: build_pool(config.world, rooms, team.robots, seed=settings.seed)}, settings.repeats
    )["rooms"]
    yield Measurement(
        name="rooms with free points", parameters={"world": config.world, "cores": 1}, unit="1/s",
        values=rates(rooms, taken),
    )  # fmt: skip


def _collection(settings: Settings, chunks: int, repeat: int = 0) -> Collection:
    seed = settings.seed + repeat
    if settings.scale == "tiny":
        return Collection(trajectories=2 * chunks, chunk=2, worlds=1, steps=80, seed=seed)
    chunk = Collection().chunk
    return Collection(trajectories=chunks * chunk, seed=seed)


def _collect(team: Team, config: Collection, settings: Settings) -> tuple[float, float]:
    """Return the seconds until every worker has finished a chunk, and trajectories per second after that."""
    began = time.perf_counter()
    with TemporaryDirectory() as folder:
        seconds = [
            time.perf_counter() - began for _ in collect(team, config, Path(folder), workers=settings.threads)
        ]
    # the first report comes before any work
    first, last = seconds[settings.threads], seconds[-1]
    return first, (config.chunks - settings.threads) * config.chunk / (last - first)


def predictors(settings: Settings) -> Iterator[Measurement]:
    """Gradient steps per second of every registered predictor, and the share of the matrix-product rate.

    The models of the first robot are trained side by side, as many as there are cores, one thread each. A
    training of few steps is subtracted from one of more steps, which leaves out loading and validation.
    """
    team = parse_team(settings.team, skill=settings.skill)
    subjects = range(min(settings.threads, len(team)))
    with TemporaryDirectory() as folder:
        data = Path(folder) / "data"
        config = _collection(settings, 4)
        for _ in collect(team, config, data, workers=settings.threads):
            pass
        for entry in hub().predictor_trainers:
            work = [_Training(entry.name, subject, Path(folder), settings) for subject in subjects]
            operations = _operations(lambda w=work[0]: w.train(2)) - _operations(lambda w=work[0]: w.train(1))
            for subject, repeats in _side_by_side(work).items():
                case = {"predictor": entry.name, "subject": subject, "side_by_side": len(work)}
                yield from _gradient_steps(case, repeats, operations, settings)


def _lengths(settings: Settings) -> tuple[int, int]:
    """Return the gradient steps of the shorter and the longer training."""
    return settings.pick((1, 2), (20, 220), (50, 450))


@dataclass(frozen=True)
class _Training:
    """Trains one model of the first robot, and times it; can be sent to a worker."""

    predictor: str
    subject: int
    folder: Path
    settings: Settings

    def train(self, steps: int) -> None:
        config = PredictorTraining(
            data=self.folder / "data", out=self.folder / f"weights-{self.subject}", agent=0,
            subject=self.subject, steps=steps, batch=self.settings.pick(4, 500, 500), report=lambda _: None,
        )  # fmt: skip
        hub().predictor_trainers.create(self.predictor, config)

    def repeat(self) -> Iterator[tuple[float, float]]:
        """Yield seconds of the gradient steps between both trainings and of matrix products, by turns."""
        short, long = _lengths(self.settings)
        actions = {"short": lambda: self.train(short), "long": lambda: self.train(long)}
        self.train(short)  # the first reads the files, and would be taken off the second
        for _ in range(self.settings.repeats):
            seconds = timed({**actions, "product": Product(self.settings)}, 1, warm_up=0)
            yield max(seconds["long"][0] - seconds["short"][0], 1e-9), seconds["product"][0]


def _serve(training: _Training, report: Report) -> None:
    for seconds in training.repeat():
        report((training.subject, seconds))


def _side_by_side(work: list[_Training]) -> dict[int, list[tuple[float, float]]]:
    """Return the seconds of each repeat by subject."""
    if len(work) == 1:
        return {work[0].subject: list(work[0].repeat())}
    found: dict[int, list[tuple[float, float]]] = {training.subject: [] for training in work}
    for subject, seconds in run_tasks(_serve, work, workers=len(work)):
        found[subject].append(seconds)
    return found


def _gradient_steps(
    case: Mapping[str, Parameter], repeats: list[tuple[float, float]], operations: int, settings: Settings
) -> Iterator[Measurement]:
    short, long = _lengths(settings)
    taken, products = zip(*repeats, strict=True)
    case = {**case, "Mflop_a_step": round(operations / 1e6, 1)}
    steps = rates(long - short, taken)
    machine = rates(Product(settings).operations, products)
    yield Measurement(name="gradient steps", parameters=case, unit="1/s", values=steps)
    share = ratios([rate * operations for rate in steps], machine)
    yield Measurement(name="share of the product rate", parameters=case, unit="x", values=share)


def _operations(work: Callable[[], None]) -> int:
    """Return the floating-point operations in matrix products and convolutions of some work."""
    with FlopCounterMode(display=False) as counter:
        work()
    return counter.get_total_flops()
