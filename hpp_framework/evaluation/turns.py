"""Least times in which teams can succeed, whichever robots take part."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from hpp_framework.core.schedule import Schedule
from hpp_framework.core.team import Team
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.world import World
from hpp_framework.evaluation.task_bounds import task_bounds


def least_times(
    worlds: Sequence[World], starts: Float[np.ndarray, "b n 3"], team: Team, schedule: Schedule
) -> Float[np.ndarray, "b"]:
    """Return times in seconds that no team beats, whichever robots take part at the end.

    See :func:`~hpp_framework.evaluation.task_bounds.task_bounds`. A robot that joins late could have used
    that time, as far as this bound knows, so it is loose for those.

    Args:
        worlds: one per episode.
        starts: start poses, at rest.
        team: all robots.
        schedule: who takes part when.
    """
    least = np.full(len(worlds), np.inf)
    for stage in schedule:
        if stage.complete:
            those = list(stage.present)
            found = task_bounds(worlds, starts[:, those], team.part(those).robots, stage.task)
            begun = (stage.first + stage.task.sustain_steps) * CONTROL_PERIOD
            least = np.minimum(least, np.maximum(found, begun))
    return least
