"""Pursuit: a robot stays near a stranger, which moves as its planner says."""

from __future__ import annotations

from collections.abc import Sequence

from hpp_framework.core.composition import ComposedTask, Limit, Rules, Weighed
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.team import robot_index
from hpp_framework.utils.errors import ConfigError
from hpp_tasks.follow import control_steps
from hpp_tasks.formation import eq1_weight
from hpp_tasks.terms.leaders import Caught, pursuers


def pursuit(
    robots: Sequence[RobotSpec],
    *,
    ids: Sequence[str] = (),
    stranger: str = "",
    near: float = 1.2,
    seconds: float = 1.0,
) -> ComposedTask:
    """Build the task for a team.

    Args:
        robots: the team.
        ids: of the robots.
        stranger: id of the one who is pursued; empty for the last robot.
        near: distance of the centres that counts as caught, metres.
        seconds: for which one of the others must be that near, not always the same.

    Raises:
        ConfigError: if the team has fewer than two robots, or no such stranger.
    """
    if len(robots) < 2:
        raise ConfigError("a pursuit takes two robots.")
    index = robot_index(stranger, ids, "the stranger", len(robots) - 1)
    chase = pursuers(len(robots), index, near)
    rules = Rules(sustain_steps=control_steps(seconds), rest_speed=None, halts=False)
    return ComposedTask([Weighed(chase, eq1_weight(2))], [Limit(Caught(chase))], rules)
