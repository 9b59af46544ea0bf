"""Backends by name, imported when first asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import Any

from hpp_framework.core.team import Team
from hpp_framework.deploy.port import RobotPort, TeamPort
from hpp_framework.deploy.topics import topic_names
from hpp_framework.utils.errors import ConfigError


def open_port(
    backend: str, team: Team, me: int, members: Mapping[str, Any], *, rehearsed: bool = False
) -> RobotPort:
    """Connect to one robot.

    Args:
        backend: ``"ros2"``.
        team: all robots.
        me: index of the robot.
        members: the effective team, empty without a team file.
        rehearsed: whether the world of a rehearsal may begin episodes.

    Raises:
        ConfigError: if the packages behind the backend are missing.
    """
    module: Any = _backend(backend)
    return module.Ros2Port(team.ids[me], topic_names(team, me, members), rehearsed=rehearsed)


def open_team_port(backend: str, team: Team, members: Mapping[str, Any]) -> TeamPort:
    """Connect a simulated team to its agents; see :func:`open_port`."""
    module: Any = _backend(backend)
    names: Sequence[Any] = [topic_names(team, index, members) for index in range(len(team))]
    return module.Ros2TeamPort(names, team.ids)


def _backend(name: str) -> ModuleType:
    if name != "ros2":
        raise ConfigError(f"backend '{name}' connects to no robots; use ros2.")
    try:
        from hpp_framework.deploy import ros2
    except ImportError as error:
        raise ConfigError(
            f"backend 'ros2' needs ROS 2, but: {error}. On a robot, source its setup.bash; elsewhere install "
            "the extra: pip install 'hpp-framework[ros]' (Linux x86-64)."
        ) from error
    return ros2
