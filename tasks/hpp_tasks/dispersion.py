"""Dispersion: all robots far from each other, at rest."""

from __future__ import annotations

from collections.abc import Sequence

from hpp_framework.core.composition import ComposedTask, Limit, Weighed
from hpp_framework.core.robot import RobotSpec
from hpp_tasks.terms.distances import spacing

EQ1_PAIR = 2.0
"""What a metre of one pair costs in Eq. 1, which counts it twice."""


def dispersion(robots: Sequence[RobotSpec], *, least: float = 6.0) -> ComposedTask:
    """Build the task for a team.

    Args:
        robots: the team.
        least: distance between the centres of any two robots, at least, metres.
    """
    term = spacing(robots, least=least)
    return ComposedTask([Weighed(term, EQ1_PAIR)], [Limit(term)])
