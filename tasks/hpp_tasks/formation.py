"""Formation: each robot in its place of a shape, at rest, wherever the shape is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hpp_framework.core.composition import ComposedTask, Limit, Weighed
from hpp_framework.core.robot import RobotSpec
from hpp_tasks.terms import formation as terms

TOLERANCE = 0.4
"""Metres that each robot may be off its place."""


def formation(
    robots: Sequence[RobotSpec],
    *,
    shape: str = "line",
    spacing: float = terms.SPACING,
    offsets: tuple[Any, ...] = (),
    roles: str = "nearest",
    turn: bool = False,
    tolerance: float = TOLERANCE,
) -> ComposedTask:
    """Build the task for a team; see :func:`hpp_tasks.terms.formation.formation` for its settings.

    An error of a metre costs as much a robot as a metre of distance does in Eq. 1 with as many robots.
    """
    term = terms.formation(robots, shape=shape, spacing=spacing, offsets=offsets, roles=roles, turn=turn)
    return ComposedTask([Weighed(term, eq1_weight(len(robots)))], [Limit(term, tolerance)])


def eq1_weight(count: int) -> float:
    """Return what a metre of one robot costs in Eq. 1: it is one to each of the others, counted twice."""
    return 2.0 * max(count - 1, 1)
