"""``hpp train``: train a skill, a predictor or the baseline that learns end to end."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from hpp_framework.cli.options import check_positive, names
from hpp_framework.config.settings import altered, parse_settings
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.run_folder import RunFolder

if TYPE_CHECKING:
    from hpp_framework.core.predictor import TrainingProgress


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
    """Weights to start from: a file, or a registered robot that has some, e.g. fetch."""
    set: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=VALUE ...")] = ()
    """Settings of the trainer's recipe, e.g. reward.touch=-0.4 network.hidden=64."""
    threads: int = 2
    """Torch threads."""
    judge: bool = True
    """Whether to judge the finished skill in unseen worlds, for its card; that takes minutes."""
    out: Path | None = None
    """Folder to write to (default: runs/SKILL-ROBOT)."""

    def run(self) -> None:
        """Train."""
        from hpp_framework.core.skill import SkillTraining
        from hpp_framework.plugins.registry import hub

        hub().robots.entry(self.robot)
        hub().skill_trainers.entry(self.name)
        check_positive(steps=self.steps, threads=self.threads)
        if not 0 <= self.seed < 2**32:
            raise ConfigError(f"--seed must lie between 0 and 4294967295 (2**32 - 1), got {self.seed}.")
        out = self.out or Path("runs") / f"{self.name}-{self.robot}"
        config = SkillTraining(
            robot=self.robot, out=out, seed=self.seed, steps=self.steps, init=self.init, threads=self.threads,
            settings=parse_settings(self.set, "--set"), judge=self.judge,
        )  # fmt: skip
        with RunFolder(out).locked():
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
        """Train, with a progress bar per model."""
        from hpp_framework.core.predictor import PredictorTraining
        from hpp_framework.plugins.registry import hub
        from hpp_framework.prediction.dataset import collected_team
        from hpp_framework.prediction.library import model_pairs
        from hpp_framework.training.predictors import train_predictors
        from hpp_framework.utils.executor import available_cores

        hub().predictor_trainers.entry(self.name)
        workers = available_cores() if self.workers is None else self.workers
        check_positive(steps=self.steps, batch=self.batch, workers=workers)
        pairs = model_pairs(collected_team(self.data), self.agent, self.subject)
        RunFolder(self.out).check()
        trainings = [
            PredictorTraining(
                data=self.data, out=self.out, agent=agent, subject=subject, seed=self.seed,
                steps=self.steps, batch=self.batch,
            )
            for agent, subject in pairs.values()
        ]  # fmt: skip
        _show(pairs, self.steps, train_predictors(self.name, trainings, workers=workers))
        print(f"weights: {self.out / self.name}")


@dataclass(frozen=True, kw_only=True)
class TrainMaddpg:
    """Train the paper's learned baseline from several seeds and keep the best of them.

    A seed that is finished is kept when the same command is given again; an unfinished one begins anew.
    """

    team: str = "fetch,freight"
    """Robots; a policy fits the team it was trained with only."""
    task: str = "rendezvous"
    """Registered task that pays the reward."""
    steps: int = 1_000_000
    """Control steps of the team, a seed."""
    seeds: str = "0..9"
    """Of networks, worlds, starts and noise: first and last, or separated by commas."""
    set: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=VALUE ...")] = ()
    """Settings of the recipe, e.g. learner.gamma=0.99 noise=0.2."""
    workers: int = 1
    """Seeds trained side by side, one thread each; each needs up to a gigabyte."""
    out: Path = Path("runs/policies")
    """Folder to write to."""

    def run(self) -> None:
        """Train, with a progress bar per seed."""
        from hpp_framework.planning.baselines.maddpg import feature_count
        from hpp_framework.plugins.build import parse_team
        from hpp_framework.plugins.registry import hub
        from hpp_framework.training.maddpg.episodes import Recipe
        from hpp_framework.training.maddpg.seeds import MaddpgTraining, keep_best, plot_seeds, train_seed
        from hpp_framework.utils.executor import run_tasks

        check_positive(steps=self.steps, workers=self.workers)
        hub().tasks.entry(self.task)
        team = parse_team(self.team)
        feature_count(team.robots)
        settings = parse_settings(self.set, "--set")
        altered(Recipe(), settings, "the recipe")
        trainings = [
            MaddpgTraining(
                team=team, out=self.out, task=self.task, seed=seed, steps=self.steps, settings=settings
            )
            for seed in _seeds(self.seeds)
        ]
        RunFolder(self.out).check()
        rows = [training.name for training in trainings]
        _show(rows, self.steps, run_tasks(train_seed, trainings, workers=self.workers))
        file, card = keep_best(trainings)
        print(f"weights: {file}")
        print(f"figure: {plot_seeds(file.with_suffix('.png'), card)}")


def _seeds(text: str) -> list[int]:
    """Read ``"0..9"`` or ``"0,3,7"``."""
    first, dots, last = text.partition("..")
    try:
        if dots:
            found = list(range(int(first), int(last) + 1))
        else:
            found = [int(seed) for seed in names(text, "--seeds")]
    except ValueError:
        found = []
    if not found or min(found) < 0:
        raise ConfigError(f"--seeds takes whole numbers from 0 on, '0..9' or '0,3,7', got '{text}'.")
    return found


def _show(models: Iterable[str], steps: int, reports: Iterable[TrainingProgress]) -> None:
    """Show one bar per model, and what trainings have to say."""
    from rich.progress import Progress

    with Progress() as bars:
        rows = {model: bars.add_task(model, total=steps) for model in models}
        for progress in reports:
            if progress.message:
                bars.console.print(progress.message, soft_wrap=True, highlight=False)
            description = f"{progress.model} {progress.status}"
            bars.update(rows[progress.model], completed=progress.step, description=description)


@dataclass(frozen=True)
class Train:
    """Train a skill, a predictor or the baseline that learns end to end."""

    what: Annotated[
        Annotated[TrainSkill, tyro.conf.subcommand("skill")]
        | Annotated[TrainPredictor, tyro.conf.subcommand("predictor")]
        | Annotated[TrainMaddpg, tyro.conf.subcommand("maddpg")],
        tyro.conf.arg(name=""),
    ]

    def run(self) -> None:
        """Train what was named."""
        self.what.run()
