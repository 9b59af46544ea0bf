"""Shapes that robots stand in: places in metres, their mean at the origin."""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor

Offsets = Float[Tensor, "n 2"]


def line(count: int, spacing: float) -> Offsets:
    """Return places in a row along x, metres."""
    x = (torch.arange(count) - (count - 1) / 2) * spacing
    return torch.stack([x, torch.zeros_like(x)], -1)


def ring(count: int, spacing: float) -> Offsets:
    """Return places at equal distances on a circle, neighbours ``spacing`` metres from each other."""
    radius = spacing / (2 * math.sin(math.pi / count)) if count > 1 else 0.0
    angles = torch.arange(count) * (2 * math.pi / count)
    return radius * torch.stack([angles.cos(), angles.sin()], -1)


def turned(places: Float[Tensor, "*b n 2"], positions: Float[Tensor, "*b n 2"]) -> Float[Tensor, "*b n 2"]:
    """Return places turned about the origin so that they fit positions best."""
    (px, py), (qx, qy) = places.unbind(-1), positions.unbind(-1)
    angle = torch.atan2((px * qy - py * qx).sum(-1), (px * qx + py * qy).sum(-1))[..., None]
    cos, sin = angle.cos(), angle.sin()
    return torch.stack([cos * px - sin * py, sin * px + cos * py], -1)
