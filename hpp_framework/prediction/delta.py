"""The paper's ``delta-pose-lidar``: one-step models of change, rolled out (Eq. 2 and 3, Algorithm 1).

Poses, goals and pose changes are expressed in the frame of the predicting agent's own (predicted) pose.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import cast

import torch
from jaxtyping import Float
from torch import Tensor, nn

from hpp_framework import geometry
from hpp_framework.prediction.dataset import Batch
from hpp_framework.prediction.library import load_models
from hpp_framework.prediction.training import Recipe, constant_velocity_error, train_model
from hpp_framework.predictor import Predictor, PredictorRequest, PredictorTraining
from hpp_framework.robot import RobotSpec
from hpp_framework.sensing import HISTORY
from hpp_framework.sim.simulator import CONTROL_PERIOD
from hpp_framework.types import Observation, Trajectories

KIND = "delta-pose-lidar"
HIDDEN = (64, 128, 128, 64)
"""Units of the four layers (appendix C.3)."""

RANGE_CAP = 10.0
"""Ranges are capped here for the networks, in metres: what is farther does not matter within a second."""

POSE_SCALE = (0.02, 0.02, 0.04)
SCAN_SCALE = 1.0
"""Targets are divided by these (metres, metres, radians; metres), which weighs pose against lidar."""


class DeltaNetwork(nn.Module):
    """Four fully connected layers from history and goal to the next change of pose and lidar.

    Args:
        beams: of the predicting agent's lidar.
    """

    pose_scale: Tensor

    def __init__(self, beams: int) -> None:
        super().__init__()
        self.beams = beams
        widths = (HISTORY * (3 + beams) + 2, *HIDDEN)
        layers = [nn.Linear(a, b) for a, b in pairwise(widths)]
        self.layers = nn.Sequential(*(m for layer in layers for m in (layer, nn.ReLU())))
        self.output = nn.Linear(HIDDEN[-1], 3 + beams)
        self.register_buffer("pose_scale", torch.tensor(POSE_SCALE), persistent=False)

    def forward(
        self, poses: Float[Tensor, "b h 3"], scans: Float[Tensor, "b h k"], goals: Float[Tensor, "b 2"]
    ) -> Float[Tensor, "b c"]:
        """Return scaled changes (pose 3, lidar k) of poses and goals given in the agent's frame."""
        x = torch.cat(
            [poses.flatten(1), scans.clamp(max=RANGE_CAP).flatten(1) / RANGE_CAP, goals / RANGE_CAP], 1
        )
        return self.output(self.layers(x))

    def change(self, out: Float[Tensor, "b c"]) -> tuple[Float[Tensor, "b 3"], Float[Tensor, "b k"]]:
        """Return the change of pose (m, m, rad; agent's frame) and of the capped lidar (m)."""
        return out[:, :3] * self.pose_scale, out[:, 3:] * SCAN_SCALE


class DeltaPoseLidar(Predictor):
    """Rolls the one-step models of the whole team out together.

    Args:
        models: one a robot, in team order; that of the agent is its self-predictor.
        agent: index of the predicting agent.
    """

    def __init__(self, models: list[DeltaNetwork], agent: int) -> None:
        self.models = models
        self.agent = agent

    @torch.no_grad()
    def rollout(self, observation: Observation, goals: Float[Tensor, "b g 2"], horizon: int) -> Trajectories:
        """Imagine ``horizon`` control steps; every model keeps a lidar imagination of its own."""
        count, candidates = goals.shape[:2]
        flat_goals = goals.reshape(-1, 2)

        def for_each_goal(x: Tensor) -> Tensor:
            return x[:, None].expand(-1, candidates, *x.shape[1:]).reshape(-1, *x.shape[1:])

        poses = for_each_goal(observation.poses)
        scans = [for_each_goal(observation.scans.clamp(max=RANGE_CAP))] * len(self.models)
        out: list[Tensor] = []
        for _ in range(horizon):
            frame = poses[:, -1, self.agent]
            goal = geometry.to_frame(frame, flat_goals)
            newest: list[Tensor] = []
            for subject, model in enumerate(self.models):
                local = geometry.between(frame[:, None], poses[:, :, subject])
                moved, seen = model.change(model(local, scans[subject], goal))
                newest.append(_moved(frame, local[:, -1], moved))
                scan = (scans[subject][:, -1] + seen).clamp(0.0, RANGE_CAP)
                scans[subject] = torch.cat([scans[subject][:, 1:], scan[:, None]], 1)
            out.append(torch.stack(newest, 1))
            poses = torch.cat([poses[:, 1:], out[-1][:, None]], 1)
        imagined = torch.stack(out, 1).reshape(count, candidates, horizon, len(self.models), 3)
        times = torch.arange(1, horizon + 1, device=goals.device, dtype=goals.dtype) * CONTROL_PERIOD
        return Trajectories(imagined, times)


def _moved(frame: Tensor, local: Tensor, change: Tensor) -> Tensor:
    return geometry.compose(frame, local + change)


def _build(robot: RobotSpec) -> DeltaNetwork:
    return DeltaNetwork(robot.lidar.beams)


def create(request: PredictorRequest) -> DeltaPoseLidar:
    """Load the models of a team (see :func:`hpp_framework.prediction.library.load_models` for the errors)."""
    models = load_models(KIND, request, _build)
    return DeltaPoseLidar(cast("list[DeltaNetwork]", models), request.agent)


def train(config: PredictorTraining) -> Path:
    """Train one model by mean squared error on scaled changes, pose and lidar weighted alike."""
    return train_model(
        config,
        Recipe(
            kind=KIND, build=_build, offsets=(1,), scan_history=HISTORY,
            loss=_loss, errors=_errors, headline=("position_error_m", "constant_velocity_error_m"),
        ),
    )  # fmt: skip


def _forward(model: nn.Module, batch: Batch) -> tuple[Tensor, Tensor, Tensor]:
    """Return scaled output, scaled pose target, scaled lidar target."""
    assert isinstance(model, DeltaNetwork)
    frame = batch.agent_poses[:, -1]
    local = geometry.between(frame[:, None], batch.subject_poses)
    out = model(local, batch.scans, geometry.to_frame(frame, batch.goals))
    change = geometry.between(frame, batch.future[:, 0]) - local[:, -1]
    change = torch.cat([change[:, :2], geometry.wrap_angle(change[:, 2:])], 1) / model.pose_scale
    seen = batch.future_scans.clamp(max=RANGE_CAP) - batch.scans[:, -1].clamp(max=RANGE_CAP)
    return out, change, seen / SCAN_SCALE


def _loss(model: nn.Module, batch: Batch) -> Tensor:
    out, change, seen = _forward(model, batch)
    return (out[:, :3] - change).square().mean() + (out[:, 3:] - seen).square().mean()


def _errors(model: nn.Module, batch: Batch) -> dict[str, float]:
    assert isinstance(model, DeltaNetwork)
    out, change, seen = _forward(model, batch)
    moved, scan = model.change(out)
    position = (moved - change * model.pose_scale)[:, :2].norm(dim=1)
    return {
        "position_error_m": float(position.mean()),
        "constant_velocity_error_m": float(constant_velocity_error(batch, (1,)).mean()),
        "lidar_error_m": float((scan - seen * SCAN_SCALE).abs().mean()),
        "lidar_unchanged_error_m": float((seen * SCAN_SCALE).abs().mean()),
    }
