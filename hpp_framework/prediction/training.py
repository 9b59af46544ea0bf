"""The training loop of all motion models: progress, resumption, held-out worlds, curves and cards."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import time
from typing import Any

import numpy as np
import torch
from rich.progress import Progress
from torch import Tensor, nn

from hpp_framework.checkpoints import load_checkpoint, load_into, save_checkpoint
from hpp_framework.errors import ConfigError
from hpp_framework.prediction.dataset import Batch, TrajectoryData
from hpp_framework.prediction.library import expected_metadata, file_name
from hpp_framework.predictor import PredictorTraining
from hpp_framework.registry import hub
from hpp_framework.robot import RobotSpec
from hpp_framework.seeding import child_seed, numpy_rng
from hpp_framework.team import Member

REPORT_EVERY = 500
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
    """

    kind: str
    build: Callable[[RobotSpec], nn.Module]
    offsets: tuple[int, ...]
    scan_history: int
    loss: Callable[[nn.Module, Batch], Tensor]
    errors: Callable[[nn.Module, Batch], dict[str, float]]


def train_model(config: PredictorTraining, recipe: Recipe) -> Path:
    """Train one model and write weights and card; returns the weights file.

    A cosine schedule lowers Adam's learning rate; state is saved every few thousand steps and training
    resumes from it with the same batches to come.

    Raises:
        ConfigError: if ``agent`` or ``subject`` is not in the collected team.
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
    curve = _fit(model, data, config, recipe, file)
    validation = _validate(model, data, config, recipe)
    metadata = {
        **expected_metadata(recipe.kind, agent, subject, own=own),
        "command": f"hpp train predictor {recipe.kind} --agent {config.agent} --subject {config.subject} "
        f"--steps {config.steps} --batch {config.batch} --seed {config.seed}",
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
    model: nn.Module, data: TrajectoryData, config: PredictorTraining, recipe: Recipe, file: Path
) -> list[list[float]]:
    optimiser = torch.optim.Adam(model.parameters(), lr=config.learning_rate)
    start, curve = _resume(model, optimiser, file)
    running: list[float] = []
    began = time()
    with Progress() as progress:
        bar = progress.add_task(file.stem, total=config.steps, completed=start)
        for step in range(start, config.steps):
            rng = numpy_rng(config.seed, "batch", step)
            for group in optimiser.param_groups:
                group["lr"] = config.learning_rate * (
                    0.02 + 0.98 * 0.5 * (1 + math.cos(math.pi * step / config.steps))
                )
            loss = recipe.loss(model, _sample(data, "train", config, recipe, rng))
            optimiser.zero_grad(set_to_none=True)
            loss.backward()
            optimiser.step()
            running.append(float(loss.detach()))
            if (step + 1) % REPORT_EVERY == 0 or step + 1 == config.steps:
                curve.append([step + 1, round(float(np.mean(running)), 6)])
                running.clear()
                rate = (step + 1 - start) / (time() - began)
                progress.update(
                    bar, completed=step + 1, description=f"{file.stem} loss {curve[-1][1]:.4f} {rate:.0f}/s"
                )
            if (step + 1) % (10 * REPORT_EVERY) == 0 and step + 1 < config.steps:
                _save_resume(model, optimiser, file, step + 1, curve)
    return curve


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
    return {key: round(float(np.nanmean([row[key] for row in rows])), 4) for key in rows[0]}


def _resume_file(file: Path) -> Path:
    return file.with_name(f"{file.stem}.resume.safetensors")


def _save_resume(
    model: nn.Module, optimiser: torch.optim.Optimizer, file: Path, step: int, curve: list[list[float]]
) -> None:
    weights = {f"model.{name}": value for name, value in model.state_dict().items()}
    for index, entry in optimiser.state_dict()["state"].items():
        weights |= {
            f"adam.{index}.{name}": value.reshape(value.shape or (1,)) for name, value in entry.items()
        }
    save_checkpoint(_resume_file(file), weights, {"step": step, "curve": curve})


def _resume(model: nn.Module, optimiser: torch.optim.Optimizer, file: Path) -> tuple[int, list[list[float]]]:
    if not _resume_file(file).exists():
        return 0, []
    weights, metadata = load_checkpoint(_resume_file(file), {})
    load_into(model, {n[6:]: v for n, v in weights.items() if n.startswith("model.")}, _resume_file(file))
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
