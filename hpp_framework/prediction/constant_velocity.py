"""The simplest motion model: all robots go on as now, whatever the goal."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.predictor import Predictor, PredictorRequest
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import Observation, Trajectories


class ConstantVelocity(Predictor):
    """Repeats the last observed displacement; a step is one control period."""

    def rollout(self, observation: Observation, goals: Float[Tensor, "b g 2"], horizon: int) -> Trajectories:
        """Imagine straight-line motion, the same for every goal."""
        steps = torch.arange(1, horizon + 1, device=goals.device, dtype=goals.dtype)
        last, before = observation.poses[:, -1], observation.poses[:, -2]
        moved = (last - before)[:, None] * torch.tensor([1.0, 1.0, 0.0], device=goals.device)
        poses = last[:, None] + moved * steps[:, None, None]
        return Trajectories(poses[:, None].expand(-1, goals.shape[1], -1, -1, -1), steps * CONTROL_PERIOD)


def create(request: PredictorRequest) -> ConstantVelocity:
    """Build the model; any team will do."""
    del request
    return ConstantVelocity()
