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
    return circle(count, spacing / (2 * math.sin(math.pi / count)) if count > 1 else 0.0)


def circle(count: int, radius: float) -> Offsets:
    """Return places at equal distances on a circle, also for a lone robot, metres."""
    angles = torch.arange(count) * (2 * math.pi / count)
    return radius * torch.stack([angles.cos(), angles.sin()], -1)


def turned(places: Float[Tensor, "*b n 2"], positions: Float[Tensor, "*b n 2"]) -> Float[Tensor, "*b n 2"]:
    """Return places turned about the origin so that they fit positions best."""
    (px, py), (qx, qy) = places.unbind(-1), positions.unbind(-1)
    angle = torch.atan2((px * qy - py * qx).sum(-1), (px * qx + py * qy).sum(-1))[..., None]
    cos, sin = angle.cos(), angle.sin()
    return torch.stack([cos * px - sin * py, sin * px + cos * py], -1)


def in_order(places: Offsets, positions: Float[Tensor, "*b n 2"]) -> Float[Tensor, "*b n 2"]:
    """Return places on a circle in the order in which robots stand around its middle, turned to fit them.

    Args:
        places: in the order of their angles.
        positions: of the robots, metres from the middle.
    """
    order = torch.atan2(positions[..., 1], positions[..., 0]).argsort(-1).argsort(-1)
    return turned(places.to(positions)[order], positions)
