"""The paper's ``delta-pose-lidar``: one-step models of change, rolled out (Eq. 2 and 3, Algorithm 1).

Poses, goals and pose changes are expressed in the frame of the predicting agent's own (predicted) pose.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor, nn

from hpp_framework import geometry
from hpp_framework.prediction.dataset import Batch
from hpp_framework.prediction.training import Recipe, constant_velocity_error, train_model
from hpp_framework.predictor import PredictorTraining
from hpp_framework.robot import RobotSpec
from hpp_framework.sensing import HISTORY

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
        split = poses.shape[1] * poses.shape[2]
        # written in place: allocating what torch.cat needs costs more than the first layer
        x = poses.new_empty(len(poses), split + scans.shape[1] * self.beams + 2)
        x[:, :split] = poses.flatten(1)
        torch.clamp(scans.flatten(1), max=RANGE_CAP, out=x[:, split:-2]).div_(RANGE_CAP)
        x[:, -2:] = goals / RANGE_CAP
        return self.output(self.layers(x))

    def change(self, out: Float[Tensor, "b c"]) -> tuple[Float[Tensor, "b 3"], Float[Tensor, "b k"]]:
        """Return the change of pose (m, m, rad; agent's frame) and of the capped lidar (m)."""
        return out[:, :3] * self.pose_scale, out[:, 3:] * SCAN_SCALE


def build(robot: RobotSpec) -> DeltaNetwork:
    """Make the network of an agent with this robot."""
    return DeltaNetwork(robot.lidar.beams)


def train(config: PredictorTraining) -> Path:
    """Train one model by mean squared error on scaled changes, pose and lidar weighted alike."""
    return train_model(
        config,
        Recipe(
            kind=KIND, build=build, offsets=(1,), scan_history=HISTORY, scan_future=1, loss=_loss,
            errors=_errors, headline=("position_error_m", "constant_velocity_error_m"),
        ),
    )  # fmt: skip


def _forward(model: nn.Module, batch: Batch) -> tuple[Float[Tensor, "b c"], Float[Tensor, "b c"]]:
    """Return scaled output and target, pose before lidar."""
    assert isinstance(model, DeltaNetwork)
    frame = batch.agent_poses[:, -1]
    local = geometry.between(frame[:, None], torch.cat([batch.subject_poses, batch.future[:, :1]], 1))
    out = model(local[:, :-1], batch.scans, geometry.to_frame(frame, batch.goals))
    change = local[:, -1] - local[:, -2]
    change[:, 2] = geometry.wrap_angle(change[:, 2])
    seen = batch.future_scans[:, 0].clamp(max=RANGE_CAP) - batch.scans[:, -1].clamp(max=RANGE_CAP)
    return out, torch.cat([change / model.pose_scale, seen.div_(SCAN_SCALE)], 1)


def _loss(model: nn.Module, batch: Batch) -> Tensor:
    out, target = _forward(model, batch)
    weights = torch.full_like(out[0], 1 / (out[:, 3:].numel()))
    weights[:3] = 1 / out[:, :3].numel()
    # one pass over both parts: slicing them apart makes their gradients expensive
    return ((out - target).square() * weights).sum()


def _errors(model: nn.Module, batch: Batch) -> dict[str, float]:
    assert isinstance(model, DeltaNetwork)
    out, target = _forward(model, batch)
    moved, seen = model.change(out)
    truly_moved, truly_seen = model.change(target)
    position = (moved - truly_moved)[:, :2].norm(dim=1)
    return {
        "position_error_m": float(position.mean()),
        "constant_velocity_error_m": float(constant_velocity_error(batch, (1,)).mean()),
        "lidar_error_m": float((seen - truly_seen).abs().mean()),
        "lidar_unchanged_error_m": float(truly_seen.abs().mean()),
    }
