"""Where the robots of a large team stop around a goal that they share.

Two robots that make for one point meet. Of eight, the first stands on it, and those who come next stand
around the first, too far out: nobody makes room. So each gets a spot of its own, spread over the disc in
which the team has met: one in the middle or a few on an inner ring, all others on an outer one.
"""

from __future__ import annotations

import math
from functools import cache

import torch
from jaxtyping import Bool, Float
from torch import Tensor

STEPS = 20
"""Radii of an inner ring that are tried."""

Rings = tuple[tuple[int, float], ...]
"""Robots and radius in metres of each ring, from the middle outwards."""


@cache
def rings(count: int, radius: float) -> Rings:
    """Return one or two rings on which robots stand as far apart as can be.

    Args:
        count: of robots.
        radius: of the outer ring, metres.
    """
    found: Rings = ((count, radius),)
    best = _apart(count, radius)
    for inner in range(1, count // 2 + 1):
        for step in range(STEPS if inner > 1 else 1):
            within = radius * step / STEPS
            apart = min(_apart(inner, within), _apart(count - inner, radius), radius - within)
            # a little farther apart is not worth another ring
            if apart > best * 1.02:
                found, best = ((inner, within), (count - inner, radius)), apart
    return found


def _apart(count: int, radius: float) -> float:
    return 2 * radius * math.sin(math.pi / count) if count > 1 else math.inf


def spots(
    goals: Float[Tensor, "*b 2"], poses: Float[Tensor, "*b n 3"], radius: float
) -> Float[Tensor, "*b n 2"]:
    """Return a spot around a goal for each robot; the same whoever asks.

    The nearest robots get the inner ring. On a ring, robots keep the order in which they stand around the
    goal, and the ring is turned so that they have the least way; if all come from one side, the flanks go to
    the far side. So spots change little as robots go to them.

    Args:
        goals: world frame, metres.
        poses: of the team.
        radius: of the outer ring, metres.
    """
    offset = poses[..., :2] - goals[..., None, :]
    # ties go by the order in the team
    nearer = offset.norm(dim=-1).argsort(dim=-1, stable=True).argsort(-1)
    bearing = torch.atan2(offset[..., 1], offset[..., 0])
    out = torch.empty_like(offset)
    first = 0
    for count, distance in rings(poses.shape[-2], radius):
        chosen = (nearer >= first) & (nearer < first + count)
        angle = _angles(bearing, chosen, count)
        spot = goals[..., None, :] + distance * torch.stack([angle.cos(), angle.sin()], -1)
        out = torch.where(chosen[..., None], spot, out)
        first += count
    return out


def _angles(
    bearing: Float[Tensor, "*b n"], chosen: Bool[Tensor, "*b n"], count: int
) -> Float[Tensor, "*b n"]:
    """Return where on a ring the chosen robots stand, all equally far apart."""
    x, y = ((each * chosen).sum(-1, keepdim=True) / count for each in (bearing.cos(), bearing.sin()))
    side = torch.atan2(y, x)
    relative = torch.remainder(bearing - side + math.pi, 2 * math.pi) - math.pi
    relative = relative.masked_fill(~chosen, math.inf)
    rank = relative.argsort(dim=-1, stable=True).argsort(-1)
    slot = (rank - (count - 1) / 2) * (2 * math.pi / count)
    off = torch.where(chosen, relative - slot, torch.zeros_like(slot))
    # where all come from one side, any turn fits as well: then none
    sine, cosine = ((each * chosen).sum(-1, keepdim=True) / count for each in (off.sin(), off.cos()))
    turn = torch.atan2(sine, cosine + torch.hypot(x, y))
    return side + turn + slot
