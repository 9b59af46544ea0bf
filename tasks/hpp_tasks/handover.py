"""Handover: two robots of the team face to face, within arm's reach, at rest."""

from __future__ import annotations

from collections.abc import Sequence

from hpp_framework.core.composition import ComposedTask, Limit, Weighed
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.team import robot_index
from hpp_framework.utils.errors import ConfigError
from hpp_tasks.formation import eq1_weight
from hpp_tasks.terms.distances import Between
from hpp_tasks.terms.headings import Facing

GAP = 0.1
"""Metres between the two footprints, at least."""
SLACK = 0.8
"""Share of the reach that robots count on where they turn to each other."""
TURN_WEIGHT = 0.5
"""What a radian costs that one of the two looks aside."""


def handover(
    robots: Sequence[RobotSpec],
    *,
    ids: Sequence[str] = (),
    first: str = "",
    second: str = "",
    reach: float = 1.0,
    angle: float = 0.6,
) -> ComposedTask:
    """Build the task for a team.

    Args:
        robots: the team.
        ids: of the robots.
        first: id of one of the two; empty for the first robot.
        second: id of the other; empty for the second robot.
        reach: gap between the two footprints, at most, metres.
        angle: at which each may see the other aside of straight ahead, radians.

    Raises:
        ConfigError: if the team has fewer than two robots, or the two are not two of them.
    """
    if len(robots) < 2:
        raise ConfigError("a handover needs two robots.")
    pair = (
        robot_index(first, ids, "the first robot", 0),
        robot_index(second, ids, "the second robot", 1),
    )
    if not reach > GAP:
        raise ConfigError(f"the reach of a handover must be more than {GAP} m, got {reach}.")
    touching = robots[pair[0]].footprint_radius + robots[pair[1]].footprint_radius
    near = Between([pair], [touching + GAP], touching + reach)
    facing = Facing(*pair, apart=touching + (GAP + reach) / 2, slack=SLACK * (reach - GAP) / 2)
    return ComposedTask(
        [Weighed(near, eq1_weight(2)), Weighed(facing, TURN_WEIGHT)], [Limit(near), Limit(facing, angle)]
    )
