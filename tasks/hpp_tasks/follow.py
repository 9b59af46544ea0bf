"""Follow: all robots keep at a distance from a leader, which goes where its planner leads it."""

from __future__ import annotations

from collections.abc import Sequence

from hpp_framework.core.composition import ComposedTask, Limit, Rules, Weighed
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.team import robot_index
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.utils.errors import ConfigError
from hpp_tasks.formation import eq1_weight
from hpp_tasks.terms.leaders import Escort


def follow(
    robots: Sequence[RobotSpec],
    *,
    ids: Sequence[str] = (),
    leader: str = "",
    least: float = 0.8,
    most: float = 2.4,
    seconds: float = 5.0,
) -> ComposedTask:
    """Build the task for a team.

    Args:
        robots: the team.
        ids: of the robots.
        leader: id of the leader; empty for the first robot.
        least: distance from the leader, metres.
        most: the same.
        seconds: for which it must be kept without a break.

    Raises:
        ConfigError: if the team has fewer than two robots, or no such leader.
    """
    if len(robots) < 2:
        raise ConfigError("following takes two robots.")
    index = robot_index(leader, ids, "the leader", 0)
    term = Escort(len(robots), index, least, most)
    rules = Rules(sustain_steps=control_steps(seconds), rest_speed=None, halts=False)
    return ComposedTask([Weighed(term, eq1_weight(2))], [Limit(term)], rules)


def control_steps(seconds: float) -> int:
    """Return the control steps that so many seconds are, at least one."""
    return max(round(seconds / CONTROL_PERIOD), 1)
