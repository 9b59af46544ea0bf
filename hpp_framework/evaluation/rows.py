"""Results of single episodes of a team, as rows of ``episodes.csv``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.evaluation.coordination import coordination
from hpp_framework.evaluation.rollout import Episodes, median_ms


@dataclass(frozen=True, kw_only=True)
class EpisodeRow:
    """One line of ``episodes.csv``; times are NaN where the event never came.

    ``bound_s`` is from :func:`~hpp_framework.evaluation.task_bounds.task_bounds`, ``rpl`` is success times
    bound over time; ``goal_gap_m``, ``agreement_s``, ``side_flips`` and ``chase`` are from
    :class:`~hpp_framework.evaluation.coordination.Coordination`; ``touched_person`` is missing in tables of
    earlier versions, where no people walked.
    """

    world: str
    planner: str
    episode: int
    success: int
    time_s: float
    first_contact: int
    first_contact_s: float
    collided: int
    touched_obstacle: int
    touched_robot: int
    final_distance_m: float
    steps: int
    plan_ms: float
    bound_s: float
    rpl: float
    goal_gap_m: float
    agreement_s: float
    side_flips: int
    chase: float
    touched_person: int = 0


def to_rows(
    world: str, planner: str, numbers: Sequence[int], episodes: Episodes, bounds: Float[np.ndarray, "b"]
) -> list[EpisodeRow]:
    """Return one row per episode.

    Args:
        world: as the user named it.
        planner: registered meta-planner.
        numbers: of the episodes, in the order of the batch.
        episodes: what happened in them.
        bounds: seconds that no team beats, NaN where none is known.
    """
    together = coordination(episodes)
    last = episodes.last_step()
    final = episodes.spread()[torch.arange(len(last)), last]
    people = torch.zeros_like(last) if episodes.touched_person is None else episodes.touched_person
    plan_ms = median_ms(episodes.plan_seconds)
    done, contact = episodes.done_step.tolist(), episodes.contact_step.tolist()

    def seconds(step: int) -> float:
        return round(step * CONTROL_PERIOD, 3) if step >= 0 else math.nan

    return [
        EpisodeRow(
            world=world, planner=planner, episode=number,
            success=int(done[i] >= 0), time_s=seconds(done[i]),
            first_contact=int(contact[i] >= 0), first_contact_s=seconds(contact[i]),
            collided=int(episodes.collided[i]),
            touched_obstacle=int(episodes.touched_obstacle[i]), touched_robot=int(episodes.touched_robot[i]),
            final_distance_m=round(float(final[i]), 4),
            steps=int(last[i]), plan_ms=round(plan_ms, 4),
            bound_s=round(float(bounds[i]), 3), rpl=round(_rpl(seconds(done[i]), float(bounds[i])), 4),
            goal_gap_m=round(float(together.goal_gap[i]), 4),
            agreement_s=round(float(together.agreement[i]), 3),
            side_flips=int(together.side_flips[i]), chase=round(float(together.chase[i]), 4),
            touched_person=int(people[i]),
        )
        for i, number in enumerate(numbers)
    ]  # fmt: skip


def _rpl(time: float, bound: float) -> float:
    """Return success weighted by bound over time (like SPL, Anderson et al. 2018), NaN without a bound."""
    # a failure without a bound must be NaN too: the mean over a cell would be that of the failures alone
    if math.isnan(bound):
        return math.nan
    return 0.0 if math.isnan(time) else bound / max(time, bound)
