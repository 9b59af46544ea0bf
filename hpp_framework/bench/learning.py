"""Benchmarks of learning: collecting motion data, training predictors, training a skill."""

from __future__ import annotations

import contextlib
import io
import json
from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import torch
from torch.utils.flop_counter import FlopCounterMode

from hpp_framework.bench.machine import SIDE, Product
from hpp_framework.bench.measurement import Measurement, Settings, SkippedError, rates, ratios, timed
from hpp_framework.envs.point_to_point import PointToPointVectorEnv
from hpp_framework.prediction.collect import Collection, collect
from hpp_framework.predictor import PredictorTraining
from hpp_framework.registry import hub
from hpp_framework.seeding import numpy_rng
from hpp_framework.sensing import NoiseModel
from hpp_framework.skill import SkillTraining
from hpp_framework.team import Team, parse_team
from hpp_framework.worlds.pool import build_pool

NOISE = NoiseModel(position_std=0.02, heading_std=0.02, scan_std=0.02, dropout=0.01)
"""Of the navigation environment, as skills are trained."""


def collecting(settings: Settings) -> Iterator[Measurement]:
    """Trajectories a second, from nothing to disk: rooms, free space, skills, simulation, files."""
    team = parse_team(settings.team, skill=settings.skill)
    repeats = settings.pick(1, 3, 5)
    configs = [_collection(settings, settings.pick(8, 2000, 10_000), repeat) for repeat in range(repeats)]
    seconds = [timed({"all": partial(_collect, team, each)}, 1, warm_up=0)["all"][0] for each in configs]
    config = configs[0]
    yield Measurement(
        name="trajectories", unit="1/s", values=rates(config.trajectories, seconds),
        parameters={"trajectories": config.trajectories, "steps": config.steps, "robots": len(team)},
    )  # fmt: skip
    rooms = settings.pick(2, 100, 400)
    taken = timed(
        {"rooms": lambda: build_pool(config.world, rooms, team.robots, seed=settings.seed)}, settings.repeats
    )["rooms"]
    yield Measurement(
        name="rooms with free points", parameters={"world": config.world, "cores": 1}, unit="1/s",
        values=rates(rooms, taken),
    )  # fmt: skip


def _collection(settings: Settings, count: int, repeat: int = 0) -> Collection:
    seed = settings.seed + repeat
    if settings.scale == "tiny":
        return Collection(trajectories=count, chunk=2, worlds=1, steps=80, seed=seed)
    return Collection(trajectories=count, seed=seed)


def _collect(team: Team, config: Collection) -> None:
    with TemporaryDirectory() as folder:
        for _ in collect(team, config, Path(folder)):
            pass


def predictors(settings: Settings) -> Iterator[Measurement]:
    """Gradient steps a second of every registered predictor, and the share of the matrix-product rate.

    A training of few steps is subtracted from one of more steps, which leaves out loading and validation.
    """
    team = parse_team(settings.team, skill=settings.skill)
    subjects = settings.pick((len(team) - 1,), (len(team) - 1,), tuple(range(len(team))))
    with TemporaryDirectory() as folder:
        data = Path(folder) / "data"
        for _ in collect(team, _collection(settings, settings.pick(8, 2000, 5000)), data):
            pass
        for entry in hub().predictor_trainers:
            for subject in subjects:
                yield from _training(entry.name, subject, data, Path(folder), settings)


def _training(name: str, subject: int, data: Path, folder: Path, settings: Settings) -> Iterator[Measurement]:
    short, long = settings.pick((1, 2), (10, 110), (50, 450))
    batch = settings.pick(4, 500, 500)

    def train(steps: int) -> None:
        config = PredictorTraining(
            data=data, out=folder / "weights", agent=0, subject=subject, steps=steps, batch=batch,
            seed=settings.seed,
        )  # fmt: skip
        with contextlib.redirect_stdout(io.StringIO()):
            hub().predictor_trainers.create(name, config)

    operations = (_operations(lambda: train(2)) - _operations(lambda: train(1))) * (long - short)
    product = Product(settings)
    seconds = timed(
        {"short": lambda: train(short), "long": lambda: train(long), "product": product}, settings.repeats
    )
    taken = [max(b - a, 1e-9) for a, b in zip(seconds["short"], seconds["long"], strict=True)]
    threads = torch.get_num_threads()
    parameters = {
        "predictor": name, "subject": subject, "batch": batch, "threads": threads,
        "Mflop_a_step": round(operations / (long - short) / 1e6, 1),
    }  # fmt: skip
    yield Measurement(
        name="gradient steps", parameters=parameters, unit="1/s", values=rates(long - short, taken)
    )
    machine = rates(product.operations, seconds["product"])
    yield Measurement(
        name="matrix product", parameters={"size": SIDE, "threads": threads}, unit="Gflop/s",
        values=tuple(rate / 1e9 for rate in machine),
    )  # fmt: skip
    if operations:
        share = ratios(rates(operations, taken), machine)
        yield Measurement(name="share of the product rate", parameters=parameters, unit="x", values=share)


def _operations(work: Callable[[], None]) -> int:
    """Return the floating-point operations in matrix products and convolutions of some work."""
    with FlopCounterMode(display=False) as counter:
        work()
    return counter.get_total_flops()


def skill(settings: Settings) -> Iterator[Measurement]:
    """Env-steps a second of point-to-point navigation: the environment alone, and the skill's training."""
    robot = parse_team(settings.team, skill=settings.skill).members[0].robot
    yield _environment(robot.name, settings)
    yield _cycles(robot.name, settings)


def _environment(robot: str, settings: Settings) -> Measurement:
    count = settings.pick(4, 512, 512)
    env = PointToPointVectorEnv(
        count, robot=robot, pool_size=settings.pick(1, 64, 64), robots_per_world=2, noise=NOISE,
        seed=settings.seed, device=settings.device,
    )  # fmt: skip
    env.reset(seed=settings.seed)
    space: Any = env.action_space
    actions = numpy_rng(settings.seed, "bench").uniform(space.low, space.high).astype("float32")
    steps = settings.pick(2, 100, 300)

    def drive() -> None:
        for _ in range(steps):
            env.step(actions)

    seconds = timed({"drive": drive}, settings.repeats)["drive"]
    parameters = {"robots": count, "robots_a_world": 2, "device": settings.device}
    return Measurement(
        name="environment steps", parameters=parameters, unit="1/s", values=rates(count * steps, seconds)
    )


def _cycles(robot: str, settings: Settings) -> Measurement:
    """Time whole cycles of experience and learning by the training's own curve."""
    with TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        config = SkillTraining(
            robot=robot, out=Path(folder), seed=settings.seed, steps=settings.pick(96, 60_000, 200_000),
            threads=settings.threads,
        )  # fmt: skip
        hub().skill_trainers.create(settings.skill, config)
        curve = Path(folder) / "curve.jsonl"
        if not curve.is_file():
            raise SkippedError(f"skill '{settings.skill}' writes no curve.jsonl to time its training by.")
        rows = [json.loads(line) for line in curve.read_text().splitlines()]
    values = tuple((b["steps"] - a["steps"]) / (b["seconds"] - a["seconds"]) for a, b in pairwise(rows))
    parameters = {"skill": settings.skill, "robot": robot, "threads": settings.threads}
    return Measurement(name="training steps", parameters=parameters, unit="1/s", values=values)
