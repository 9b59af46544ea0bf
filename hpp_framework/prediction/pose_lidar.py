"""The paper's ablation ``pose-lidar``: the next pose and the next scan themselves (appendix D.2).

"Directly outputs the next pose" is read as: in world coordinates, in which poses are observed (appendix C).
In the agent's frame nothing would tell it from ``delta-general-pose-lidar``. Poses and goals go in likewise.
"""

from __future__ import annotations

from pathlib import Path

from hpp_framework.core.predictor import PredictorRequest, PredictorTraining
from hpp_framework.prediction.one_step import ROOM_SCALE, Form, train_form
from hpp_framework.prediction.one_step_rollout import OneStep, create_form

FORM = Form(
    kind="pose-lidar", in_world=True, pose_changes=False, scan_changes=False,
    own_scale=ROOM_SCALE, other_scale=ROOM_SCALE, scan_scale=3.0,
)  # fmt: skip


def create(request: PredictorRequest) -> OneStep:
    """Load the models of a team (see :func:`hpp_framework.prediction.library.load_models` for the errors)."""
    return create_form(FORM, request)


def train(config: PredictorTraining) -> Path:
    """Train one model (see :func:`hpp_framework.prediction.one_step.train_form` for the errors)."""
    return train_form(FORM, config)
