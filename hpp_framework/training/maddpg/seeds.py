"""Trains MADDPG from several seeds and keeps the best, as the paper did (appendix C.2).

Every seed has a folder of weights of its own, written when it is finished; the same command goes on with the
seeds that are missing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.figure import Figure
from torch import Tensor

from hpp_framework.agents.policy import PolicyAgent
from hpp_framework.config.control_choice import make_control
from hpp_framework.config.settings import altered
from hpp_framework.core.predictor import TrainingProgress
from hpp_framework.core.schedule import permanent
from hpp_framework.core.skill import as_pairs
from hpp_framework.core.task import Task
from hpp_framework.core.team import Team
from hpp_framework.evaluation.rollout import run_episodes
from hpp_framework.evaluation.skill_figures import save_figure
from hpp_framework.planning.baselines.maddpg import (
    KIND,
    Layers,
    MaddpgPolicy,
    expected_metadata,
    feature_count,
    file_name,
)
from hpp_framework.plugins.builtin import DEFAULT_TASK
from hpp_framework.plugins.registry import hub
from hpp_framework.plugins.weights import load_checkpoint, require_same_run, save_checkpoint
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.training.maddpg.episodes import ACTIONS, Recipe, Rooms, train
from hpp_framework.training.maddpg.learner import Learner
from hpp_framework.utils.executor import Report
from hpp_framework.utils.seeding import numpy_rng, torch_rng
from hpp_framework.worlds.loader import resolve_world
from hpp_framework.worlds.spawn import spawn_poses

JUDGE_SEED = 5001
"""Of the episodes that policies are compared by, in worlds that no seed trains in."""
BEST, SPREAD = "#1868c4", "#e377a2"
POINTS = 20
"""Of a learning curve."""

Row = dict[str, float]
"""A point of a learning curve: control steps done, the mean return with noise since the last point, and the
return and success in unseen worlds without noise."""


@dataclass(frozen=True, kw_only=True)
class MaddpgTraining:
    """What the training of one seed is told.

    Attributes:
        team: all robots.
        out: folder that holds all seeds.
        task: registered task, gives the reward.
        seed: of networks, worlds, starts, noise and batches.
        steps: control steps of teams.
        settings: of the recipe that differ from its own, by dotted name.
    """

    team: Team
    out: Path
    task: str = DEFAULT_TASK
    seed: int = 0
    steps: int = 1_000_000
    settings: Mapping[str, Any] = field(default_factory=lambda: dict[str, Any]())

    @property
    def name(self) -> str:
        """What the training is called."""
        return f"seed {self.seed}"

    @property
    def recipe(self) -> Recipe:
        """How it trains."""
        return altered(Recipe(), self.settings, "the recipe")

    @property
    def file(self) -> Path:
        """Where the weights of this seed go."""
        return weights_file(self.out / f"seed-{self.seed}", self.team)

    def run(self) -> dict[str, Any]:
        """Return what weights and the training that makes them have in common."""
        return {"seed": self.seed, "task": self.task, "steps": self.steps, "recipe": asdict(self.recipe)}


def weights_file(folder: Path, team: Team) -> Path:
    """Return where a folder of weights has those of a team."""
    return folder / KIND / f"{file_name(team.robots)}.safetensors"


def command(trainings: Sequence[MaddpgTraining]) -> str:
    """Return the command line that repeats trainings which differ in their seeds only."""
    first = trainings[0]
    return (
        f"hpp train maddpg --team {','.join(robot.name for robot in first.team.robots)} --task {first.task} "
        f"--steps {first.steps} --seeds {','.join(str(training.seed) for training in trainings)}"
        + (" --set " + " ".join(as_pairs(first.settings)) if first.settings else "")
    )


def train_seed(training: MaddpgTraining, report: Report) -> None:
    """Train one seed and write its actors and their card; a finished one is left as it is.

    Kept are the actors of that point of the learning curve at which they were judged best.

    Args:
        training: what to do.
        report: is told now and then how far it has come, as :class:`TrainingProgress`.

    Raises:
        ConfigError: if a team cannot have such a policy, or there are weights of another training.
        CheckpointError: if weights cannot be written.
    """
    name, robots = training.name, training.team.robots
    if training.file.is_file():
        _, card = load_checkpoint(training.file, {})
        require_same_run(training.file, card.get("run", {}), training.run())
        report(TrainingProgress(name, training.steps, "finished", f"{name} is there already"))
        return
    task = hub().tasks.create(training.task, robots)
    rng = torch_rng(training.seed, "network")
    learner = Learner(len(robots), feature_count(robots), ACTIONS, training.recipe.learner, rng)
    curve, best = _train(training, learner, task, report)
    card = {
        **expected_metadata(robots, task),
        "command": command([training]),
        "run": training.run(),
        "judged": highest(curve),
        "curve": curve,
    }
    save_checkpoint(training.file, best, card)
    report(TrainingProgress(name, training.steps, "finished"))


def highest(curve: Sequence[Row]) -> Row:
    """Return the point of a learning curve with the highest return in unseen worlds, the first of equals."""
    return max(curve, key=lambda row: row["judged_return"])


def _train(
    training: MaddpgTraining, learner: Learner, task: Task, report: Report
) -> tuple[list[Row], dict[str, Tensor]]:
    """Train a seed's learner; returns its curve, and the actors' weights when they were best."""
    recipe = training.recipe
    judge = Judge(training.team, task, recipe.rooms, recipe.judged)
    curve, returns, best = list[Row](), list[float](), dict[str, Tensor]()
    judged = {training.steps * point // POINTS for point in range(1, POINTS + 1)}
    robots = training.team.robots
    rounds = train(learner, robots, task, recipe, steps=training.steps, seed=training.seed)
    for done, total in rounds:
        returns.append(total)
        message = ""
        if any(point <= done for point in judged):
            judged = {point for point in judged if point > done}
            found = judge(learner.actors)
            curve.append({"steps": done, "return": round(sum(returns) / len(returns), 2), **found})
            if highest(curve) is curve[-1]:
                best = {key: value.clone() for key, value in learner.actors.state_dict().items()}
            worth = f"return {found['judged_return']:.0f}, success {found['success']:.2f}"
            message = f"{training.name}, {done} steps: {worth}"
            returns.clear()
        report(TrainingProgress(training.name, min(done, training.steps), "", message))
    return curve, best


class Judge:
    """Lets actors run without noise in unseen worlds, the same for all seeds.

    Args:
        team: all robots.
        task: the shared objective.
        rooms: the kind of worlds, and the control stack.
        episodes: how many.
    """

    def __init__(self, team: Team, task: Task, rooms: Rooms, episodes: int) -> None:
        rng = numpy_rng(JUDGE_SEED, "judge")
        factory = resolve_world(rooms.world)
        self.team = team
        self.task = task
        self._control = [make_control(rooms.control, team.robots, i, task) for i in range(len(team))]
        self._worlds = [factory(rng) for _ in range(episodes)]
        starts = [torch.from_numpy(spawn_poses(w, team.robots, rng)).float() for w in self._worlds]
        self._starts = torch.stack(starts)

    def __call__(self, actors: Layers) -> Row:
        """Return the actors' mean return and success."""
        robots = self.team.robots
        policies = [MaddpgPolicy(actors, robots, index) for index in range(len(robots))]
        agents = [
            PolicyAgent(policy, control) for policy, control in zip(policies, self._control, strict=True)
        ]
        with BatchSimulator(robots, threads=1) as simulator:
            found = run_episodes(
                simulator,
                self._worlds,
                self._starts,
                agents,
                permanent(self.task, len(robots)),
                seeds=range(len(self._worlds)),
            )
        total = self.task.reward(found.poses[:, 1:]).sum(1).mean()
        return {
            "judged_return": round(float(total), 2),
            "success": float((found.done_step >= 0).double().mean()),
        }


def keep_best(trainings: Sequence[MaddpgTraining]) -> tuple[Path, dict[str, Any]]:
    """Copy the weights of the seed with the highest return in unseen worlds; its card tells of all seeds.

    Args:
        trainings: finished ones of a team, in the same folder.

    Returns:
        The weights and their card.

    Raises:
        CheckpointError: if weights are missing or cannot be written.
    """
    found = {training.seed: load_checkpoint(training.file, {}) for training in trainings}
    curves: dict[int, list[Row]] = {seed: card["curve"] for seed, (_, card) in found.items()}
    best = max(curves, key=lambda seed: highest(curves[seed])["judged_return"])
    weights, card = found[best]
    file = weights_file(trainings[0].out, trainings[0].team)
    del card["curve"]
    card |= {"command": command(trainings), "curves": {str(seed): curve for seed, curve in curves.items()}}
    save_checkpoint(file, weights, card)
    return file, card


def plot_seeds(file: Path, card: Mapping[str, Any]) -> Path:
    """Draw return and success in unseen worlds over the steps of all seeds (appendix C.2).

    Args:
        file: the picture; its suffix chooses the format.
        card: of the best seed's weights, as :func:`keep_best` writes it.

    Raises:
        HppError: if the file cannot be written.
    """
    curves: dict[str, Sequence[Mapping[str, float]]] = card["curves"]
    best = str(card["run"]["seed"])
    steps = np.array([row["steps"] for row in curves[best]]) / 1e6
    figure = Figure(figsize=(9.0, 3.6), dpi=150, layout="constrained")
    for axes, name, label in zip(
        figure.subplots(1, 2), ("judged_return", "success"), ("return of an episode", "success"), strict=True
    ):
        rows = np.array([[row[name] for row in curve] for curve in curves.values()])
        mean, std = rows.mean(0), rows.std(0)
        if len(rows) > 1:
            axes.plot(steps, rows.T, color=SPREAD, alpha=0.35, linewidth=0.8)
            axes.fill_between(steps, mean - std, mean + std, color=SPREAD, alpha=0.25, linewidth=0)
            axes.plot(
                steps, mean, color=SPREAD, linewidth=2, label=f"mean of {len(rows)} seeds, one deviation"
            )
        own = [row[name] for row in curves[best]]
        axes.plot(steps, own, color=BEST, linewidth=2, label=f"seed {best}, the best")
        axes.plot(card["judged"]["steps"] / 1e6, card["judged"][name], "o", color=BEST, label="kept")
        axes.set(xlabel="million control steps", ylabel=label)
        axes.grid(alpha=0.3)
        axes.legend(loc="lower right", fontsize=8)
    figure.suptitle(f"MADDPG, {' and '.join(card['robots'])}, without noise in unseen worlds")
    return save_figure(figure, file)
