"""Coordination of a team: agreement of goals, changes of goals, and robots that follow each other.

Everything is counted from the start to the end of an episode: success, or out of time.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.evaluation.rollout import Episodes

AGREED = 0.5
"""Metres between the goals of two robots below which they agree."""
ASIDE = 0.5
"""Metres from the line to the others at which a goal lies on a side of it."""


@dataclass(frozen=True)
class Coordination:
    r"""One entry per episode.

    Attributes:
        goal_gap: mean distance between two robots' goals, over pairs and time, metres.
        agreement: seconds from which on all goals stay within :data:`AGREED` of each other, NaN if they do
            not in the end; 0 for a lone robot.
        side_flips: times that a robot changed the side on which it means to pass what lies between it and
            the others, all robots together. Its line leads from its start through the middle of all starts,
            and it changes sides when its goal, having been at least :data:`ASIDE` to one side of the line,
            is so on the other.
        chase: share of the path that two robots spent on one following the other, 0 to 1: with the steps
            :math:`m_i, m_j` of both and the unit vector :math:`u_{ij}` from one to the other, the sum over
            pairs and time of :math:`2 \min(m_i \cdot u_{ij}, m_j \cdot u_{ij})`, where both are positive,
            over that of :math:`|m_i| + |m_j|`.
    """

    goal_gap: Float[Tensor, "b"]
    agreement: Float[Tensor, "b"]
    side_flips: Int[Tensor, "b"]
    chase: Float[Tensor, "b"]


def coordination(episodes: Episodes) -> Coordination:
    """Return how the robots of each episode got along."""
    goals, poses, last = episodes.goals, episodes.poses, episodes.last_step()
    under_way = torch.arange(goals.shape[1]) < last[:, None]
    one, other = torch.triu_indices(*[goals.shape[2]] * 2, offset=1)
    gaps = (goals[:, :, one] - goals[:, :, other]).norm(dim=-1)
    counted = under_way[..., None].expand_as(gaps)
    if episodes.present is not None:
        # those who do not take part have no goal
        present = episodes.present[: goals.shape[1]]
        counted = counted & present[:, one] & present[:, other]
    gaps = gaps * counted
    mean_gap = gaps.sum((1, 2)) / counted.sum((1, 2)).clamp(min=1)
    return Coordination(
        goal_gap=mean_gap,
        agreement=_agreement((gaps > AGREED).any(-1), under_way),
        side_flips=_side_flips(goals, poses[:, 0, :, :2], under_way),
        chase=_chase(poses[..., :2], one, other, under_way),
    )


def _agreement(apart: Bool[Tensor, "b s"], under_way: Bool[Tensor, "b s"]) -> Float[Tensor, "b"]:
    """Return when the last disagreement was over, NaN if that was the end of the episode."""
    steps = torch.arange(1, apart.shape[1] + 1)
    over = (steps * (apart & under_way)).amax(1)
    ended = under_way.sum(1)
    return (over * CONTROL_PERIOD).masked_fill((over == ended) & (ended > 0), torch.nan)


def _side_flips(
    goals: Float[Tensor, "b s n 2"], starts: Float[Tensor, "b n 2"], under_way: Bool[Tensor, "b s"]
) -> Int[Tensor, "b"]:
    line = starts.mean(1, keepdim=True) - starts
    line = line / line.norm(dim=-1, keepdim=True).clamp(min=1e-9)
    offset = goals - starts[:, None]
    aside = line[:, None, :, 0] * offset[..., 1] - line[:, None, :, 1] * offset[..., 0]
    sides = aside.sign() * (aside.abs() >= ASIDE) * under_way[..., None]
    flips = torch.zeros(len(goals), dtype=torch.int64)
    side = torch.zeros_like(sides[:, 0])
    for now in sides.unbind(1):
        flips += (side * now < 0).sum(1)
        side = torch.where(now != 0, now, side)
    return flips


def _chase(
    xy: Float[Tensor, "b t n 2"],
    one: Int[Tensor, "p"],
    other: Int[Tensor, "p"],
    under_way: Bool[Tensor, "b s"],
) -> Float[Tensor, "b"]:
    motion = xy.diff(dim=1)
    between = xy[:, :-1, other] - xy[:, :-1, one]
    between = between / between.norm(dim=-1, keepdim=True).clamp(min=1e-9)
    first, second = ((motion[:, :, each] * between).sum(-1) for each in (one, other))
    # along the line between both: both forward, or both backward
    followed = 2 * torch.where(first * second > 0, torch.minimum(first.abs(), second.abs()), 0.0)
    lengths = motion.norm(dim=-1)
    moved = lengths[:, :, one] + lengths[:, :, other]
    counted = under_way[..., None]
    return (followed * counted).sum((1, 2)) / (moved * counted).sum((1, 2)).clamp(min=1e-9)
