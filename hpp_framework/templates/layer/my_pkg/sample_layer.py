"""A control layer that drives slowly near teammates."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.config.settings import altered
from hpp_framework.core.control import ControlContext, ControlLayer
from hpp_framework.core.types import Observation


@dataclass(frozen=True, kw_only=True)
class SampleLayerConfig:
    """How slowly, and how near.

    Attributes:
        speed: largest forward speed near a teammate, m/s.
        near: metres between two robots' centres.
    """

    speed: float = 0.3
    near: float = 1.5


class SampleLayer(ControlLayer):
    """Limits the forward speed where any teammate is near.

    Args:
        config: how slowly, and how near.
    """

    def __init__(self, config: SampleLayerConfig) -> None:
        self.config = config

    def filter(
        self, observation: Observation, waypoint: Float[Tensor, "b 2"], command: Float[Tensor, "b 2"]
    ) -> Float[Tensor, "b 2"]:
        """Return the command, slower near teammates."""
        del waypoint
        apart = (observation.team_poses[..., :2] - observation.pose[:, None, :2]).norm(dim=-1)
        mates = torch.arange(apart.shape[1]) != observation.agent
        near = (apart[:, mates] < self.config.near).any(-1)
        slow = command[:, 0].clamp(max=self.config.speed)
        return torch.stack([torch.where(near, slow, command[:, 0]), command[:, 1]], -1)


def sample_layer(context: ControlContext) -> SampleLayer:
    """Build the layer."""
    return SampleLayer(altered(SampleLayerConfig(), context.settings, "layer 'sample-layer'"))
