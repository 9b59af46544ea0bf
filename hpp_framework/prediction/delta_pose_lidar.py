"""The paper's own one-step model, ``delta-pose-lidar``: changes of pose and lidar (Eq. 2 and 3).

Poses, goals and pose changes are expressed in the frame of the predicting agent's own (predicted) pose.
"""

from __future__ import annotations

from pathlib import Path

from hpp_framework.core.predictor import PredictorRequest, PredictorTraining
from hpp_framework.prediction.one_step import STEP_SCALE, Form, train_form
from hpp_framework.prediction.one_step_rollout import OneStep, create_form

FORM = Form(
    kind="delta-pose-lidar", in_world=False, pose_changes=True, scan_changes=True,
    own_scale=STEP_SCALE, other_scale=STEP_SCALE, scan_scale=1.0,
)  # fmt: skip


def create(request: PredictorRequest) -> OneStep:
    """Load the models of a team (see :func:`hpp_framework.prediction.library.load_models` for the errors)."""
    return create_form(FORM, request)


def train(config: PredictorTraining) -> Path:
    """Train one model (see :func:`hpp_framework.prediction.one_step.train_form` for the errors)."""
    return train_form(FORM, config)
