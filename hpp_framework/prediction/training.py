"""The training loop of all motion models: progress, resumption, held-out worlds, curves and cards."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import time
from typing import Any

import numpy as np
import torch
from rich.progress import Progress
from torch import Tensor, nn

from hpp_framework.checkpoints import (
    load_checkpoint,
    load_into,
    portable,
    require_same_run,
    save_checkpoint,
)
from hpp_framework.errors import CheckpointError, ConfigError
from hpp_framework.prediction.dataset import Batch, TrajectoryData
from hpp_framework.prediction.library import expected_metadata, file_name
from hpp_framework.predictor import PredictorTraining
from hpp_framework.registry import hub
from hpp_framework.robot import RobotSpec
from hpp_framework.seeding import child_seed, numpy_rng
from hpp_framework.team import Member

REPORT_EVERY = 500
SNAPSHOT_EVERY = 10 * REPORT_EVERY
VALIDATION_BATCHES = 20


@dataclass(frozen=True)
class Recipe:
    """What differs between kinds of motion models.

    Attributes:
        kind: registered predictor name.
        build: makes the network for the predicting agent's robot.
        offsets: control steps ahead of the targets.
        scan_history: newest scans a sample needs.
        loss: of a network on a batch.
        errors: named validation errors of a network on a batch, in metres or as named.
        headline: which of these errors is reported while training, and that of constant velocity, in metres.
    """

    kind: str
    build: Callable[[RobotSpec], nn.Module]
    offsets: tuple[int, ...]
    scan_history: int
    loss: Callable[[nn.Module, Batch], Tensor]
    errors: Callable[[nn.Module, Batch], dict[str, float]]
    headline: tuple[str, str]


def train_model(config: PredictorTraining, recipe: Recipe) -> Path:
    """Train one model and write weights and card; returns the weights file.

    A cosine schedule lowers Adam's learning rate; state is saved every few thousand steps and training
    resumes from it with the same batches to come. Errors on held-out worlds are printed early and at every
    snapshot, so that a hopeless training can be stopped.

    Raises:
        ConfigError: if ``agent`` or ``subject`` is not in the collected team, or ``out`` holds a snapshot of
            another training.
        CheckpointError: if the snapshot is damaged, or weights cannot be written.
    """
    torch.set_num_threads(config.threads)
    data = TrajectoryData(config.data)
    agent, subject = _members(data, config)
    own = config.agent == config.subject
    torch.manual_seed(
        child_seed(config.seed, "network")
    )  # torch's layers initialise from the global generator only
    model = recipe.build(agent.robot)
    file = config.out / recipe.kind / f"{file_name(agent, subject, own=own)}.safetensors"
    with Progress() as progress:
        curve = _fit(model, data, config, recipe, file, progress)
        validation = _validate(model, data, config, recipe)
        _report(progress, file, config.steps, validation, recipe)
    metadata = {
        **expected_metadata(recipe.kind, agent, subject, own=own),
        "command": _command(config, recipe),
        "seed": config.seed,
        "steps": config.steps,
        "batch": config.batch,
        "learning_rate": config.learning_rate,
        "data": data.meta,
        "trajectories": data.trajectories,
        "validation": validation,
        "curve": curve,
    }
    save_checkpoint(file, model.state_dict(), metadata)
    _resume_file(file).unlink(missing_ok=True)
    _resume_file(file).with_suffix(".json").unlink(missing_ok=True)
    return file


def _command(config: PredictorTraining, recipe: Recipe) -> str:
    """Return the command line that repeats a training."""
    return (
        f"hpp train predictor {recipe.kind} --data {portable(config.data)} --agent {config.agent} "
        f"--subject {config.subject} --steps {config.steps} --batch {config.batch} --seed {config.seed} "
        f"--threads {config.threads}"
    )


def _run(config: PredictorTraining, recipe: Recipe, data: TrajectoryData) -> dict[str, Any]:
    """Return what a snapshot must share with a training that resumes from it."""
    return {
        "predictor": recipe.kind,
        "agent": config.agent,
        "subject": config.subject,
        "seed": config.seed,
        "steps": config.steps,
        "batch": config.batch,
        "learning_rate": config.learning_rate,
        "data": data.meta,
        "trajectories": data.trajectories,
    }


def _members(data: TrajectoryData, config: PredictorTraining) -> tuple[Member, Member]:
    team = [
        Member(id=m["id"], robot=hub().robots.create(m["robot"]), skill=m["skill"]) for m in data.meta["team"]
    ]
    for name in ("agent", "subject"):
        if not 0 <= getattr(config, name) < len(team):
            raise ConfigError(
                f"--{name} {getattr(config, name)}: '{config.data}' has robots 0 to {len(team) - 1}."
            )
    return team[config.agent], team[config.subject]


def _fit(
    model: nn.Module,
    data: TrajectoryData,
    config: PredictorTraining,
    recipe: Recipe,
    file: Path,
    progress: Progress,
) -> list[list[float]]:
    optimiser = torch.optim.Adam(model.parameters(), lr=config.learning_rate)
    run = _run(config, recipe, data)
    start, curve = _resume(model, optimiser, file, run)
    running: list[float] = []
    began = time()
    bar = progress.add_task(file.stem, total=config.steps, completed=start)
    for step in range(start, config.steps):
        running.append(_learn(model, optimiser, data, config, recipe, step))
        done = step + 1
        if done % REPORT_EVERY == 0 or done == config.steps:
            curve.append([done, round(float(np.mean(running)), 6)])
            running.clear()
            rate = (done - start) / (time() - began)
            text = f"{file.stem} loss {curve[-1][1]:.4f} {rate:.0f}/s"
            progress.update(bar, completed=done, description=text)
        if (done == REPORT_EVERY or done % SNAPSHOT_EVERY == 0) and done < config.steps:
            _report(progress, file, done, _validate(model, data, config, recipe), recipe)
        if done % SNAPSHOT_EVERY == 0 and done < config.steps:
            _save_resume(model, optimiser, file, {"step": done, "curve": curve, "run": run})
    return curve


def _learn(
    model: nn.Module,
    optimiser: torch.optim.Optimizer,
    data: TrajectoryData,
    config: PredictorTraining,
    recipe: Recipe,
    step: int,
) -> float:
    """Take one gradient step; returns its loss."""
    for group in optimiser.param_groups:
        group["lr"] = config.learning_rate * (
            0.02 + 0.98 * 0.5 * (1 + math.cos(math.pi * step / config.steps))
        )
    loss = recipe.loss(model, _sample(data, "train", config, recipe, numpy_rng(config.seed, "batch", step)))
    optimiser.zero_grad(set_to_none=True)
    loss.backward()
    optimiser.step()
    return float(loss.detach())


def _report(progress: Progress, file: Path, step: int, errors: dict[str, float], recipe: Recipe) -> None:
    """Print the error on held-out worlds beside that of constant velocity, above the progress bar."""
    ours, theirs = recipe.headline
    progress.console.print(
        f"{file.stem}, step {step}, held-out worlds: {ours} {errors[ours]:.4f}, "
        f"{theirs} {errors[theirs]:.4f}",
        soft_wrap=True,
        highlight=False,
    )


def _sample(
    data: TrajectoryData, part: str, config: PredictorTraining, recipe: Recipe, rng: np.random.Generator
) -> Batch:
    return data.sample(
        part, config.batch, rng, agent=config.agent, subject=config.subject, offsets=recipe.offsets,
        scan_history=recipe.scan_history,
    )  # fmt: skip


@torch.no_grad()
def _validate(
    model: nn.Module, data: TrajectoryData, config: PredictorTraining, recipe: Recipe
) -> dict[str, float]:
    """Return the mean errors on held-out worlds, the same batches for everybody."""
    rng = numpy_rng(0, "validation")
    rows = [
        recipe.errors(model, _sample(data, "validation", config, recipe, rng))
        for _ in range(VALIDATION_BATCHES)
    ]
    with warnings.catch_warnings():
        # a horizon that no sample of tiny batches reaches is NaN
        warnings.filterwarnings("ignore", "Mean of empty slice", RuntimeWarning)
        return {key: round(float(np.nanmean([row[key] for row in rows])), 4) for key in rows[0]}


def _resume_file(file: Path) -> Path:
    return file.with_name(f"{file.stem}.resume.safetensors")


def _save_resume(
    model: nn.Module, optimiser: torch.optim.Optimizer, file: Path, metadata: dict[str, Any]
) -> None:
    weights = {f"model.{name}": value for name, value in model.state_dict().items()}
    for index, entry in optimiser.state_dict()["state"].items():
        weights |= {
            f"adam.{index}.{name}": value.reshape(value.shape or (1,)) for name, value in entry.items()
        }
    save_checkpoint(_resume_file(file), weights, metadata)


def _resume(
    model: nn.Module, optimiser: torch.optim.Optimizer, file: Path, run: dict[str, Any]
) -> tuple[int, list[list[float]]]:
    """Load the snapshot of this training, if there is one; returns the next step and the curve so far."""
    snapshot = _resume_file(file)
    if not snapshot.exists():
        return 0, []
    try:
        weights, metadata = load_checkpoint(snapshot, {})
    except CheckpointError as error:
        raise CheckpointError(f"{error} Or delete this snapshot to begin anew.") from error
    require_same_run(snapshot, metadata.get("run", {}), run)
    load_into(model, {n[6:]: v for n, v in weights.items() if n.startswith("model.")}, snapshot)
    state: dict[int, dict[str, Any]] = {}
    for name, value in weights.items():
        if name.startswith("adam."):
            _, index, key = name.split(".")
            state.setdefault(int(index), {})[key] = value.reshape(()) if key == "step" else value
    optimiser.load_state_dict({"state": state, "param_groups": optimiser.state_dict()["param_groups"]})
    return metadata["step"], metadata["curve"]


def constant_velocity_error(batch: Batch, offsets: tuple[int, ...]) -> Tensor:
    """Return the position error (b, t) in metres of going on with the last displacement."""
    last, before = batch.subject_poses[:, -1, :2], batch.subject_poses[:, -2, :2]
    ahead = torch.tensor(offsets, dtype=torch.float32)[None, :, None]
    guess = last[:, None] + (last - before)[:, None] * ahead
    return (guess - batch.future[..., :2]).norm(dim=-1)
