"""The reward of a goal of one's own while the others pursue goals that one can only guess.

A planner that scores *shared* goals assumes that all robots choose the same goal. Where two paths round a
wall are nearly equal, robots that see different things then set out for different ends and wait for each
other. The answer of game theory is the best response: score one's own goal against what the others probably
do.
"""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor

from hpp_framework.core.task import Task
from hpp_framework.core.types import Trajectories

EPISODES_AT_ONCE = 8
"""Episodes whose pairs of goals are scored together: more do not fit in the cache."""


def pair_rewards(
    task: Task, imagined: Trajectories, agent: int, others: Float[Tensor, "b k"], chosen: Int[Tensor, "b k"]
) -> Float[Tensor, "b g t"]:
    """Return the expected reward over time of each goal of one's own.

    Args:
        task: the shared objective.
        imagined: the team's motion for each goal.
        agent: index of the robot that chooses.
        others: probability that all others pursue a goal, for the goals in ``chosen``; sums to 1.
        chosen: indices of these goals.
    """
    parts = [
        _pair_rewards(task, *part, agent)
        for part in zip(
            imagined.poses.split(EPISODES_AT_ONCE),
            others.split(EPISODES_AT_ONCE),
            chosen.split(EPISODES_AT_ONCE),
            strict=True,
        )
    ]
    return torch.cat(parts)


def _pair_rewards(
    task: Task,
    poses: Float[Tensor, "b g t n 3"],
    others: Float[Tensor, "b k"],
    chosen: Int[Tensor, "b k"],
    agent: int,
) -> Float[Tensor, "b g t"]:
    rows = torch.arange(len(poses))[:, None]
    theirs = poses[rows, chosen]
    pairs = theirs[:, None].repeat(1, poses.shape[1], 1, 1, 1, 1)
    pairs[..., agent, :] = poses[:, :, None, :, agent]
    return torch.einsum("bgkt,bk->bgt", task.reward(pairs), others)


def likeliest(logits: Float[Tensor, "b g"], count: int) -> tuple[Float[Tensor, "b k"], Int[Tensor, "b k"]]:
    """Return the probabilities of the likeliest goals, summing to 1, and their indices."""
    top = logits.topk(min(count, logits.shape[1]), dim=1)
    return top.values.softmax(1), top.indices


def as_one_gaussian(logits: Float[Tensor, "b g"], goals: Float[Tensor, "b g 2"]) -> Float[Tensor, "b g"]:
    """Return the log-density of the Gaussian with the mean and deviation of a belief over goals.

    What a belief loses that cannot have two peaks; for comparison.
    """
    mean, std = moments(logits, goals)
    return -((goals - mean[:, None]) / std[:, None].clamp(min=0.1)).square().sum(-1) / 2


def moments(
    logits: Float[Tensor, "b g"], goals: Float[Tensor, "b g 2"]
) -> tuple[Float[Tensor, "b 2"], Float[Tensor, "b 2"]]:
    """Return mean and standard deviation, an axis each, of a belief over goals."""
    weights = logits.softmax(1)[..., None]
    mean = (weights * goals).sum(1)
    return mean, (weights * (goals - mean[:, None]).square()).sum(1).sqrt()
