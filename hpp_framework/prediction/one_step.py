"""The paper's one-step models (Eq. 2 and 3, appendix D.2): a network, its training, and three forms of it.

The forms see the same history and goal and have the same layers. They differ in whose coordinates they
think in, and in whether they answer with changes or with what comes next itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor, nn

from hpp_framework.core import geometry
from hpp_framework.core.predictor import PredictorTraining
from hpp_framework.core.robot import RobotSpec
from hpp_framework.perception.sensing import HISTORY
from hpp_framework.prediction.dataset import Batch
from hpp_framework.prediction.training import Recipe, constant_velocity_error, train_model

HIDDEN = (64, 128, 128, 64)
"""Units of the four layers (appendix C.3)."""

RANGE_CAP = 10.0
"""Ranges are capped here for the networks, in metres: what is farther does not matter within a second."""

PoseScale = tuple[float, float, float]
STEP_SCALE: PoseScale = (0.02, 0.02, 0.04)
"""About the deviation of pose changes within a control step, in metres and radians."""
ROOM_SCALE: PoseScale = (5.0, 5.0, 1.8)
"""About the deviation of poses within a room, in metres and radians."""


@dataclass(frozen=True, kw_only=True)
class Form:
    """What a kind of one-step model answers, and in whose coordinates.

    Outputs are in units of the scales, which weighs pose against lidar.

    Attributes:
        kind: registered predictor name.
        in_world: poses and goals are in world coordinates, not in the frame of the agent's newest pose.
        pose_changes: the answer is the change of the subject's pose, not its next pose.
        scan_changes: the answer is the change of the agent's lidar, not its next scan.
        own_scale: of poses, in self-prediction (metres, metres, radians).
        other_scale: of poses, in other-prediction.
        scan_scale: of the lidar, in metres.
    """

    kind: str
    in_world: bool
    pose_changes: bool
    scan_changes: bool
    own_scale: PoseScale
    other_scale: PoseScale
    scan_scale: float

    def pose_scale(self, *, own: bool) -> Float[Tensor, "3"]:
        """Return the scale of poses in self- or other-prediction."""
        return torch.tensor(self.own_scale if own else self.other_scale)

    def frame(self, agent: Float[Tensor, "b 3"]) -> Float[Tensor, "b 3"]:
        """Return the origin of the form's coordinates, given the agent's newest pose."""
        return torch.zeros_like(agent) if self.in_world else agent


class OneStepNetwork(nn.Module):
    """Four fully connected layers from history and goal to the next pose and lidar, or their changes.

    Args:
        beams: of the predicting agent's lidar.
    """

    def __init__(self, beams: int) -> None:
        super().__init__()
        self.beams = beams
        widths = (HISTORY * (3 + beams) + 2, *HIDDEN)
        layers = [nn.Linear(a, b) for a, b in pairwise(widths)]
        self.layers = nn.Sequential(*(m for layer in layers for m in (layer, nn.ReLU())))
        self.output = nn.Linear(HIDDEN[-1], 3 + beams)

    def forward(
        self, poses: Float[Tensor, "b h 3"], scans: Float[Tensor, "b h k"], goals: Float[Tensor, "b 2"]
    ) -> Float[Tensor, "b c"]:
        """Return what the form asks for (pose 3, lidar k), scaled, of poses and goals in its coordinates."""
        split = poses.shape[1] * poses.shape[2]
        # written in place: allocating what torch.cat needs costs more than the first layer
        x = poses.new_empty(len(poses), split + scans.shape[1] * self.beams + 2)
        x[:, :split] = poses.flatten(1)
        torch.clamp(scans.flatten(1), max=RANGE_CAP, out=x[:, split:-2]).div_(RANGE_CAP)
        x[:, -2:] = goals / RANGE_CAP
        return self.output(self.layers(x))


def build(robot: RobotSpec) -> OneStepNetwork:
    """Make the network of an agent with this robot."""
    return OneStepNetwork(robot.lidar.beams)


def train_form(form: Form, config: PredictorTraining) -> Path:
    """Train one model by mean squared error on scaled outputs, pose and lidar weighted alike.

    Raises:
        ConfigError: see :func:`hpp_framework.prediction.training.train_model`, as for ``CheckpointError``.
    """
    own = config.agent == config.subject
    return train_model(
        config,
        Recipe(
            kind=form.kind, build=build, offsets=(1,), scan_history=HISTORY, scan_future=1,
            loss=partial(_loss, form, own=own), errors=partial(_errors, form, own=own),
            headline=("position_error_m", "constant_velocity_error_m"),
        ),
    )  # fmt: skip


def _forward(
    form: Form, model: nn.Module, batch: Batch, *, own: bool
) -> tuple[Float[Tensor, "b c"], Float[Tensor, "b c"]]:
    """Return scaled output and target, pose before lidar."""
    frame = form.frame(batch.agent_poses[:, -1])
    local = geometry.between(frame[:, None], torch.cat([batch.subject_poses, batch.future[:, :1]], 1))
    out = model(local[:, :-1], batch.scans, geometry.to_frame(frame, batch.goals))
    now, target = local[:, -2], local[:, -1].clone()
    if form.pose_changes:
        target[:, :2] -= now[:, :2]
        target[:, 2] = geometry.wrap_angle(target[:, 2] - now[:, 2])
    else:
        # the turn of angles that is nearest to the newest heading
        target[:, 2] = now[:, 2] + geometry.wrap_angle(target[:, 2] - now[:, 2])
    seen = batch.future_scans[:, 0].clamp(max=RANGE_CAP)
    if form.scan_changes:
        seen -= batch.scans[:, -1].clamp(max=RANGE_CAP)
    return out, torch.cat([target / form.pose_scale(own=own), seen.div_(form.scan_scale)], 1)


def _loss(form: Form, model: nn.Module, batch: Batch, *, own: bool) -> Tensor:
    out, target = _forward(form, model, batch, own=own)
    weights = torch.full_like(out[0], 1 / (out[:, 3:].numel()))
    weights[:3] = 1 / out[:, :3].numel()
    # one pass over both parts: slicing them apart makes their gradients expensive
    return ((out - target).square() * weights).sum()


def _errors(form: Form, model: nn.Module, batch: Batch, *, own: bool) -> dict[str, float]:
    out, target = _forward(form, model, batch, own=own)
    missed = out - target
    position = (missed[:, :3] * form.pose_scale(own=own))[:, :2].norm(dim=1)
    newest, seen = batch.scans[:, -1].clamp(max=RANGE_CAP), batch.future_scans[:, 0].clamp(max=RANGE_CAP)
    return {
        "position_error_m": float(position.mean()),
        "constant_velocity_error_m": float(constant_velocity_error(batch, (1,)).mean()),
        "lidar_error_m": float(missed[:, 3:].abs().mean() * form.scan_scale),
        "lidar_unchanged_error_m": float((seen - newest).abs().mean()),
    }
