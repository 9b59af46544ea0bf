"""A team: a mapping from user-chosen ids to robots and their skills. It is not a robot."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hpp_framework.core.robot import RobotSpec
from hpp_framework.utils.errors import ConfigError


def _mapping() -> Any:
    return field(default_factory=dict[str, Any], hash=False)


@dataclass(frozen=True, kw_only=True)
class Member:
    """One robot of a team.

    Attributes:
        id: unique name in the team.
        robot: its data.
        skill: registered name of its skill.
        planner: registered meta-planner, with settings of its own or without; None for that of all robots.
        control: its control stack; None for that of all robots.
        believes: what this robot wrongly takes others for, by id; it predicts them with the models of those.
            Of itself it may be wrong about its skill.
        weights: folder of the predictor weights by which it predicts a robot, by that robot's id (its own is
            possible); robots that are not named are looked for in the folders of all robots.
        disturbances: of its sensing and acting, as an experiment names them; None for those of all robots.
        joins_at: seconds from which on it takes part; it stands until then.
        leaves_at: seconds from which on it stands and takes part no longer; None for never.
    """

    id: str
    robot: RobotSpec
    skill: str
    planner: str | None = None
    control: str | None = None
    believes: Mapping[str, Member] = _mapping()
    weights: Mapping[str, Path] = _mapping()
    disturbances: str | None = None
    joins_at: float = 0.0
    leaves_at: float | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.joins_at < (math.inf if self.leaves_at is None else self.leaves_at):
            raise ConfigError(
                f"robot '{self.id}' joins at {self.joins_at:g} s and leaves at {self.leaves_at} s; it must "
                "join at 0 s or later, and leave after that."
            )


@dataclass(frozen=True)
class Team:
    """All robots, in a fixed order."""

    members: tuple[Member, ...]

    def __post_init__(self) -> None:
        if not self.members:
            raise ConfigError("a team needs at least one robot, e.g. 'fetch,freight'.")
        twice = [name for name, count in Counter(m.id for m in self.members).items() if count > 1]
        if twice:
            raise ConfigError(f"robot id '{twice[0]}' is used twice; every robot of a team needs its own id.")

    @property
    def robots(self) -> tuple[RobotSpec, ...]:
        """Robot data in team order."""
        return tuple(member.robot for member in self.members)

    @property
    def ids(self) -> tuple[str, ...]:
        """Robot ids in team order."""
        return tuple(member.id for member in self.members)

    def __len__(self) -> int:
        return len(self.members)

    def as_believed_by(self, agent: int) -> Team:
        """Return the team as one robot takes it to be, by its index; see ``Member.believes``."""
        believes = self.members[agent].believes
        return Team(tuple(believes.get(member.id, member) for member in self.members))

    def part(self, chosen: Sequence[int]) -> Team:
        """Return the team of some of the robots, by their indices."""
        return Team(tuple(self.members[index] for index in chosen))


def robot_index(name: str, ids: Sequence[str], role: str, default: int | None = None) -> int:
    """Return the index of a robot that a task gives a role.

    Args:
        name: its id.
        ids: of the team.
        role: for messages, e.g. ``"the leader"``.
        default: index of the one that has the role where no name is given.

    Raises:
        ConfigError: if there is no such robot.
    """
    if not name and default is not None:
        return default
    if name not in ids:
        raise ConfigError(f"{role} '{name}' is no robot of the team; its robots are {', '.join(ids)}.")
    return tuple(ids).index(name)
