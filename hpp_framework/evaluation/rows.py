"""Results of single episodes of a team, as rows of ``episodes.csv``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch

from hpp_framework.evaluation.rollout import Episodes, median_ms
from hpp_framework.sim.simulator import CONTROL_PERIOD


@dataclass(frozen=True, kw_only=True)
class EpisodeRow:
    """One line of ``episodes.csv``; times are NaN where the event never came."""

    world: str
    planner: str
    episode: int
    success: int
    time_s: float
    first_contact: int
    first_contact_s: float
    collided: int
    final_distance_m: float
    steps: int
    plan_ms: float


def to_rows(world: str, planner: str, numbers: Sequence[int], episodes: Episodes) -> list[EpisodeRow]:
    """Return one row an episode.

    Args:
        world: as the user named it.
        planner: registered meta-planner.
        numbers: of the episodes, in the order of the batch.
        episodes: what happened in them.
    """
    last = episodes.last_step()
    final = episodes.spread()[torch.arange(len(last)), last]
    plan_ms = median_ms(episodes.plan_seconds)
    done, contact = episodes.done_step.tolist(), episodes.contact_step.tolist()

    def seconds(step: int) -> float:
        return round(step * CONTROL_PERIOD, 3) if step >= 0 else math.nan

    return [
        EpisodeRow(
            world=world, planner=planner, episode=number,
            success=int(done[i] >= 0), time_s=seconds(done[i]),
            first_contact=int(contact[i] >= 0), first_contact_s=seconds(contact[i]),
            collided=int(episodes.collided[i]), final_distance_m=round(float(final[i]), 4),
            steps=int(last[i]), plan_ms=round(plan_ms, 4),
        )
        for i, number in enumerate(numbers)
    ]  # fmt: skip
