"""``hpp train``: train a skill or a predictor."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from hpp_framework.cli.options import check_folder
from hpp_framework.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class TrainSkill:
    """Train a skill for a robot and write weights and card; an interrupted training resumes."""

    name: Annotated[str, tyro.conf.Positional] = "p2p"
    """Registered skill."""
    robot: str = "fetch"
    """Registered robot."""
    steps: int = 5_000_000
    """Control steps of experience."""
    seed: int = 0
    """Seed of rooms, noise and network."""
    init: Path | None = None
    """Weights of another robot to start from."""
    threads: int = 2
    """Torch threads."""
    out: Path | None = None
    """Folder to write to (default: runs/SKILL-ROBOT)."""

    def run(self) -> None:
        """Train."""
        from hpp_framework.registry import hub
        from hpp_framework.skill import SkillTraining

        hub().robots.entry(self.robot)
        hub().skill_trainers.entry(self.name)
        _check_positive(steps=self.steps, threads=self.threads)
        if not 0 <= self.seed < 2**32:
            raise ConfigError(f"--seed must lie between 0 and 4294967295 (2**32 - 1), got {self.seed}.")
        out = self.out or Path("runs") / f"{self.name}-{self.robot}"
        check_folder(out)
        config = SkillTraining(
            robot=self.robot, out=out, seed=self.seed, steps=self.steps, init=self.init, threads=self.threads
        )
        print(f"weights: {hub().skill_trainers.create(self.name, config)}")


@dataclass(frozen=True, kw_only=True)
class TrainPredictor:
    """Train one motion model: how robot --agent predicts robot --subject (itself, if equal)."""

    name: Annotated[str, tyro.conf.Positional] = "delta-pose-lidar"
    """Registered predictor."""
    data: Path = Path("data/fetch,freight")
    """Folder written by 'hpp collect'."""
    agent: int = 0
    """Place of the predicting robot in the collected team, from 0."""
    subject: int = 0
    """Place of the predicted robot."""
    steps: int = 50_000
    """Gradient steps."""
    batch: int = 500
    """Samples a gradient step."""
    seed: int = 0
    """Seed of network and batches."""
    threads: int = 2
    """Torch threads."""
    out: Path = Path("runs/predictors")
    """Folder to write to."""

    def run(self) -> None:
        """Train."""
        from hpp_framework.predictor import PredictorTraining
        from hpp_framework.registry import hub

        hub().predictor_trainers.entry(self.name)
        _check_positive(steps=self.steps, batch=self.batch, threads=self.threads)
        check_folder(self.out)
        config = PredictorTraining(
            data=self.data, out=self.out, agent=self.agent, subject=self.subject, seed=self.seed,
            steps=self.steps, batch=self.batch, threads=self.threads,
        )  # fmt: skip
        print(f"weights: {hub().predictor_trainers.create(self.name, config)}")


@dataclass(frozen=True)
class Train:
    """Train a skill or a predictor."""

    what: Annotated[
        Annotated[TrainSkill, tyro.conf.subcommand("skill")]
        | Annotated[TrainPredictor, tyro.conf.subcommand("predictor")],
        tyro.conf.arg(name=""),
    ]

    def run(self) -> None:
        """Train what was named."""
        self.what.run()


def _check_positive(**values: int) -> None:
    for name, value in values.items():
        if value < 1:
            raise ConfigError(f"--{name} must be at least 1, got {value}.")
