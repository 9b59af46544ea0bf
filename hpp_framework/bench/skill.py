"""Benchmarks of skills: point-to-point navigation, the environment alone and with training."""

from __future__ import annotations

import contextlib
import io
import json
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hpp_framework.bench.measurement import Measurement, Settings, SkippedError, rates, timed
from hpp_framework.core.disturbances import Disturbances
from hpp_framework.core.skill import SkillTraining
from hpp_framework.envs.point_to_point import PointToPointVectorEnv
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.seeding import numpy_rng

DISTURBANCES = Disturbances(position_std=0.02, heading_std=0.02, scan_std=0.02, lost_beams=0.01)
"""Of the navigation environment, moderate."""


def skill(settings: Settings) -> Iterator[Measurement]:
    """Env-steps per second of point-to-point navigation: the environment alone, and the skill's training."""
    robot = parse_team(settings.team, skill=settings.skill).members[0].robot
    yield _environment(robot.name, settings)
    yield _cycles(robot.name, settings)


def _environment(robot: str, settings: Settings) -> Measurement:
    count = settings.pick(4, 512, 512)
    env = PointToPointVectorEnv(
        count, robot=robot, pool_size=settings.pick(1, 64, 64), robots_per_world=2, disturbances=DISTURBANCES,
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
            threads=settings.threads, judge=False,
        )  # fmt: skip
        hub().skill_trainers.create(settings.skill, config)
        curve = Path(folder) / "curve.jsonl"
        if not curve.is_file():
            raise SkippedError(f"skill '{settings.skill}' writes no curve.jsonl to time its training by.")
        rows = [json.loads(line) for line in curve.read_text().splitlines()]
    values = tuple((b["steps"] - a["steps"]) / (b["seconds"] - a["seconds"]) for a, b in pairwise(rows))
    parameters = {"skill": settings.skill, "robot": robot, "threads": settings.threads}
    return Measurement(name="training steps", parameters=parameters, unit="1/s", values=values)
