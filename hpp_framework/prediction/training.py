"""The training loop of all motion models: progress, resumption, held-out worlds, curves and cards."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from time import time
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from hpp_framework.core.predictor import PredictorTraining, TrainingProgress
from hpp_framework.core.robot import RobotSpec
from hpp_framework.plugins.snapshots import load_snapshot, remove_snapshot, save_snapshot
from hpp_framework.plugins.weights import load_checkpoint, portable, save_checkpoint
from hpp_framework.prediction.dataset import Batch, Prepared, TrajectoryData
from hpp_framework.prediction.library import expected_metadata, file_name, find_members
from hpp_framework.utils.errors import CheckpointError
from hpp_framework.utils.seeding import child_seed, numpy_rng

REPORT_EVERY = 500
VALIDATE_EVERY = 10 * REPORT_EVERY
SNAPSHOT_EVERY = 2 * REPORT_EVERY
"""Seconds apart, so that an interruption costs little."""
VALIDATION_BATCHES = 20
WARM_UP = 500
"""Gradient steps over which the learning rate rises; without, many units never fire."""
FINAL_RATE = 0.02
"""Share of the learning rate that is left at the end."""


@dataclass(frozen=True)
class Recipe:
    """What differs between kinds of motion models.

    Attributes:
        kind: registered predictor name.
        build: makes the network for the predicting agent's robot.
        offsets: control steps ahead of the targets.
        scan_history: newest scans a sample needs.
        scan_future: scans that a sample needs at the first offsets.
        loss: of a network on a batch.
        errors: named validation errors of a network on a batch, in metres or as named.
        headline: which of these errors is reported while training, and that of constant velocity, in metres.
        keyframes: of the predicting robot that a sample needs.
        prepare: computes what a network needs of a batch and does not learn, as ``Batch.prepared``.
        distinct: batches that a training draws before it goes through the same ones again, their ``prepared``
            kept in memory; None draws a new one for every gradient step.
    """

    kind: str
    build: Callable[[RobotSpec], nn.Module]
    offsets: tuple[int, ...]
    scan_history: int
    scan_future: int
    loss: Callable[[nn.Module, Batch], Tensor]
    errors: Callable[[nn.Module, Batch], dict[str, float]]
    headline: tuple[str, str]
    keyframes: int = 0
    prepare: Callable[[Batch], Prepared] | None = None
    distinct: int | None = None


def train_model(config: PredictorTraining, recipe: Recipe) -> Path:
    """Train one model and write weights and card; returns the weights file.

    Adam's learning rate follows :func:`learning_rate`; state is saved every thousand steps and training
    resumes from it with the same batches to come; a model that is finished already is left as it is. Errors
    on held-out worlds are reported early and then every 5,000 steps, so that a hopeless training can be
    stopped.

    Raises:
        ConfigError: if ``data`` is no data set, ``agent`` or ``subject`` is not in the collected team, or
            ``out`` holds a snapshot of another training.
        CheckpointError: if the snapshot is damaged, or weights cannot be written.
    """
    data = TrajectoryData(config.data)
    agent, subject = find_members(data.team, config.agent, config.subject)
    own = config.agent == config.subject
    file = config.out / recipe.kind / f"{file_name(agent, subject, own=own)}.safetensors"
    run = _run(config, data)
    if _is_finished(file, run):
        _report(config, file, config.steps, "finished", "is there already; delete it to train it again")
        return file
    torch.manual_seed(
        child_seed(config.seed, "network")
    )  # torch's layers initialise from the global generator only
    model = recipe.build(agent.robot)
    batches = _Batches(data, config, recipe)
    curve = _fit(model, batches, file)
    validation = _validate(model, batches)
    _report(config, file, config.steps, "finished", _held_out(validation, recipe))
    metadata = {
        **expected_metadata(recipe.kind, agent, subject, own=own),
        "command": _command(config, recipe),
        **run,
        "validation": validation,
        "curve": curve,
    }
    save_checkpoint(file, model.state_dict(), metadata)
    remove_snapshot(_resume_file(file))
    return file


def _command(config: PredictorTraining, recipe: Recipe) -> str:
    """Return the command line that repeats a training."""
    return (
        f"hpp train predictor {recipe.kind} --data {portable(config.data)} --agent {config.agent} "
        f"--subject {config.subject} --steps {config.steps} --batch {config.batch} --seed {config.seed}"
    )


def _run(config: PredictorTraining, data: TrajectoryData) -> dict[str, Any]:
    """Return what weights and snapshots have in common with the training that makes or resumes them."""
    return {
        "places": [config.agent, config.subject],
        "seed": config.seed,
        "steps": config.steps,
        "batch": config.batch,
        "learning_rate": config.learning_rate,
        "warm_up": WARM_UP,
        "data": data.meta,
        "trajectories": data.trajectories,
    }


def _fit(model: nn.Module, batches: _Batches, file: Path) -> list[list[float]]:
    """Take all gradient steps that are left; returns the curve of (step, mean loss)."""
    config, recipe = batches.config, batches.recipe
    optimiser = torch.optim.Adam(model.parameters(), lr=config.learning_rate, fused=True)
    run = _run(config, batches.data)
    counters = {"step": int, "curve": list}
    found = load_snapshot(_resume_file(file), model, optimiser, run, counters) or {"step": 0, "curve": []}
    start, curve = found["step"], found["curve"]
    _report(config, file, start, "")
    total = torch.zeros(())
    counted = 0
    began = time()
    for step in range(start, config.steps):
        total += _learn(model, optimiser, batches, step)
        counted += 1
        done = step + 1
        last = done == config.steps
        if done % REPORT_EVERY == 0 or last:
            curve.append([done, round(float(total) / counted, 6)])
            total.zero_()
            counted = 0
            _report(config, file, done, f"loss {curve[-1][1]:.4f}, {(done - start) / (time() - began):.0f}/s")
        if (done == REPORT_EVERY or done % VALIDATE_EVERY == 0) and not last:
            errors = _validate(model, batches)
            _report(config, file, done, "", _held_out(errors, recipe))
        if done % SNAPSHOT_EVERY == 0 and not last:
            metadata = {"step": done, "curve": curve, "run": run}
            save_snapshot(_resume_file(file), model, optimiser, metadata)
    return curve


def _learn(model: nn.Module, optimiser: torch.optim.Optimizer, batches: _Batches, step: int) -> Tensor:
    """Take one gradient step; returns its loss."""
    for group in optimiser.param_groups:
        group["lr"] = learning_rate(batches.config, step)
    loss = batches.recipe.loss(model, batches.train(step))
    optimiser.zero_grad(set_to_none=True)
    loss.backward()
    optimiser.step()
    return loss.detach()


def learning_rate(config: PredictorTraining, step: int) -> float:
    """Return the learning rate of a gradient step: a linear rise, then a cosine's fall."""
    cosine = FINAL_RATE + (1 - FINAL_RATE) * 0.5 * (1 + math.cos(math.pi * step / config.steps))
    return config.learning_rate * min(1.0, (step + 1) / WARM_UP) * cosine


def _report(config: PredictorTraining, file: Path, step: int, status: str, message: str = "") -> None:
    line = f"{file.stem}, step {step}, {message}" if message else ""
    config.report(TrainingProgress(file.stem, step, status, line))


def _held_out(errors: dict[str, float], recipe: Recipe) -> str:
    """Return the error on held-out worlds beside that of constant velocity."""
    ours, theirs = recipe.headline
    return f"held-out worlds: {ours} {errors[ours]:.4f}, {theirs} {errors[theirs]:.4f}"


class _Batches:
    """Draws the batches of a training, and keeps what was prepared for those that come again."""

    def __init__(self, data: TrajectoryData, config: PredictorTraining, recipe: Recipe) -> None:
        self.data = data
        self.config = config
        self.recipe = recipe
        self._prepared: dict[tuple[str, int], Prepared] = {}

    def train(self, step: int) -> Batch:
        """Return the batch of a gradient step."""
        index = step % self.recipe.distinct if self.recipe.distinct else step
        return self._draw("train", index, numpy_rng(self.config.seed, "batch", index))

    def validation(self) -> Iterator[Batch]:
        """Yield batches of held-out worlds, the same at every call."""
        rng = numpy_rng(0, "validation")
        for index in range(VALIDATION_BATCHES):
            yield self._draw("validation", index, rng)

    def _draw(self, part: str, index: int, rng: np.random.Generator) -> Batch:
        recipe, kept = self.recipe, self._prepared.get((part, index))
        batch = self.data.sample(
            part, self.config.batch, rng, agent=self.config.agent, subject=self.config.subject,
            offsets=recipe.offsets, scan_history=recipe.scan_history, scan_future=recipe.scan_future,
            keyframes=recipe.keyframes if kept is None else 0,
        )  # fmt: skip
        if recipe.prepare is None:
            return batch
        kept = kept or recipe.prepare(batch)
        if recipe.distinct or part == "validation":
            self._prepared[part, index] = kept
        return replace(batch, prepared=kept)


@torch.no_grad()
def _validate(model: nn.Module, batches: _Batches) -> dict[str, float]:
    """Return the mean errors on held-out worlds, the same batches for all models."""
    rows = [batches.recipe.errors(model, batch) for batch in batches.validation()]
    with warnings.catch_warnings():
        # a horizon that no sample of tiny batches reaches is NaN
        warnings.filterwarnings("ignore", "Mean of empty slice", RuntimeWarning)
        return {key: round(float(np.nanmean([row[key] for row in rows])), 4) for key in rows[0]}


def _is_finished(file: Path, run: dict[str, Any]) -> bool:
    """Return whether these weights are the result of this training."""
    try:
        _, card = load_checkpoint(file, {})
    except CheckpointError:
        return False  # there are none, or they are damaged
    return all(card.get(key) == value for key, value in run.items())


def _resume_file(file: Path) -> Path:
    return file.with_name(f"{file.stem}.resume.safetensors")


def constant_velocity_error(batch: Batch, offsets: tuple[int, ...]) -> Tensor:
    """Return the position error (b, t) in metres of going on with the last displacement."""
    last, before = batch.subject_poses[:, -1, :2], batch.subject_poses[:, -2, :2]
    ahead = torch.tensor(offsets, dtype=torch.float32)[None, :, None]
    guess = last[:, None] + (last - before)[:, None] * ahead
    return (guess - batch.future[..., :2]).norm(dim=-1)
