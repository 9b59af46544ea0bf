"""``hpp train``: train a skill or a predictor."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from hpp_framework.cli.options import check_folder, check_positive
from hpp_framework.errors import ConfigError
from hpp_framework.settings import parse_settings

if TYPE_CHECKING:
    from hpp_framework.predictor import PredictorTraining
    from hpp_framework.workers import Report


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
    set: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=VALUE ...")] = ()
    """Settings of the trainer's recipe, e.g. reward.touch=-0.4 network.hidden=64."""
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
        check_positive(steps=self.steps, threads=self.threads)
        if not 0 <= self.seed < 2**32:
            raise ConfigError(f"--seed must lie between 0 and 4294967295 (2**32 - 1), got {self.seed}.")
        out = self.out or Path("runs") / f"{self.name}-{self.robot}"
        check_folder(out)
        config = SkillTraining(
            robot=self.robot, out=out, seed=self.seed, steps=self.steps, init=self.init, threads=self.threads,
            settings=parse_settings(self.set, "--set"),
        )  # fmt: skip
        print(f"weights: {hub().skill_trainers.create(self.name, config)}")


@dataclass(frozen=True, kw_only=True)
class TrainPredictor:
    """Train all motion models of a collected team, side by side; an interrupted training resumes.

    Every robot has a model of itself and one of every other robot; --agent and --subject choose among them.
    """

    name: Annotated[str, tyro.conf.Positional] = "delta-pose-lidar"
    """Registered predictor."""
    data: Path = Path("data/fetch,freight")
    """Folder written by 'hpp collect'."""
    agent: int | None = None
    """Train only the models of this robot: its place in the collected team, from 0."""
    subject: int | None = None
    """Train only the models that predict this robot."""
    steps: int = 50_000
    """Gradient steps."""
    batch: int = 500
    """Samples a gradient step."""
    seed: int = 0
    """Seed of networks and batches."""
    workers: int | None = None
    """Models trained side by side, one thread each (default: as many as there are cores)."""
    out: Path = Path("runs/predictors")
    """Folder to write to."""

    def run(self) -> None:
        """Train, with a progress bar a model."""
        from rich.progress import Progress

        from hpp_framework.prediction.dataset import collected_team
        from hpp_framework.prediction.library import model_pairs
        from hpp_framework.predictor import PredictorTraining
        from hpp_framework.registry import hub
        from hpp_framework.workers import available_cores, run_tasks

        hub().predictor_trainers.entry(self.name)
        workers = available_cores() if self.workers is None else self.workers
        check_positive(steps=self.steps, batch=self.batch, workers=workers)
        pairs = model_pairs(collected_team(self.data), self.agent, self.subject)
        check_folder(self.out)
        trainings = [
            PredictorTraining(
                data=self.data, out=self.out, agent=agent, subject=subject, seed=self.seed,
                steps=self.steps, batch=self.batch,
            )
            for agent, subject in pairs.values()
        ]  # fmt: skip
        with Progress() as bars:
            rows = {model: bars.add_task(model, total=self.steps) for model in pairs}
            for progress in run_tasks(_train, [(self.name, t) for t in trainings], workers=workers):
                if progress.message:
                    bars.console.print(progress.message, soft_wrap=True, highlight=False)
                description = f"{progress.model} {progress.status}"
                bars.update(rows[progress.model], completed=progress.step, description=description)
        print(f"weights: {self.out / self.name}")


def _train(task: tuple[str, PredictorTraining], report: Report) -> None:
    from hpp_framework.registry import hub

    name, training = task
    hub().predictor_trainers.create(name, replace(training, report=report))


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
