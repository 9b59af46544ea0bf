"""Region: all robots at a given place, at rest, for instance in a door."""

from __future__ import annotations

from collections.abc import Sequence

from hpp_framework.core.composition import ComposedTask, Limit, Weighed
from hpp_framework.core.robot import RobotSpec
from hpp_tasks.formation import eq1_weight
from hpp_tasks.rendezvous import rendezvous_radius
from hpp_tasks.terms.places import Region


def region(
    robots: Sequence[RobotSpec], *, x: float = 0.0, y: float = 0.0, radius: float | None = None
) -> ComposedTask:
    """Build the task for a team.

    Args:
        robots: the team.
        x: of the region's centre, world frame, metres.
        y: the same.
        radius: of the region, metres; None for half a metre more than a rendezvous needs.
    """
    wide = rendezvous_radius(robots) + 0.5 if radius is None else float(radius)
    term = Region(range(len(robots)), (x, y), wide)
    return ComposedTask([Weighed(term, eq1_weight(len(robots)))], [Limit(term)])
