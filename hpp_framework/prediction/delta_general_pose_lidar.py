"""The paper's ablation ``delta-general-pose-lidar``: poses relative to the agent, whole scans (appendix D.2).

The answer is the subject's next pose in the frame of the agent's newest pose. Of the agent itself that is its
change of pose, as in ``delta-pose-lidar``; only the lidar differs there.
"""

from __future__ import annotations

from pathlib import Path

from hpp_framework.core.predictor import PredictorRequest, PredictorTraining
from hpp_framework.prediction.one_step import ROOM_SCALE, STEP_SCALE, Form, train_form
from hpp_framework.prediction.one_step_rollout import OneStep, create_form

FORM = Form(
    kind="delta-general-pose-lidar", in_world=False, pose_changes=False, scan_changes=False,
    own_scale=STEP_SCALE, other_scale=ROOM_SCALE, scan_scale=3.0,
)  # fmt: skip


def create(request: PredictorRequest) -> OneStep:
    """Load the models of a team (see :func:`hpp_framework.prediction.library.load_models` for the errors)."""
    return create_form(FORM, request)


def train(config: PredictorTraining) -> Path:
    """Train one model (see :func:`hpp_framework.prediction.one_step.train_form` for the errors)."""
    return train_form(FORM, config)
