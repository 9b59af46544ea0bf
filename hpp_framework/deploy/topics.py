"""Which topics a robot's agent reads and writes; the same for every backend that has topics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hpp_framework.config.deployment import topics_of
from hpp_framework.core.team import Team

STOP = "hpp/stop"
PLAN = "hpp/plan"
EPISODE = "/hpp/episode"
ALL_STOP = f"/{STOP}"


@dataclass(frozen=True)
class TopicNames:
    """Absolute names of the topics that one agent reads and writes.

    Attributes:
        scan: LaserScan, its own.
        odom: Odometry, its own.
        poses: PoseWithCovarianceStamped of all robots, by id; all it hears of teammates.
        stops: Bool, emergency stops of this robot and of all.
        cmd_vel: Twist, or TwistStamped, out.
        plan: MarkerArray, out.
        stamped: whether commands are TwistStamped.
    """

    scan: str
    odom: str
    poses: Mapping[str, str]
    stops: tuple[str, ...]
    cmd_vel: str
    plan: str
    stamped: bool

    def read(self) -> tuple[str, ...]:
        """Return all that the agent subscribes to."""
        return (self.scan, self.odom, *self.poses.values(), *self.stops)


def topic_names(team: Team, me: int, members: Mapping[str, Any]) -> TopicNames:
    """Return the topics of one robot's agent.

    Args:
        team: all robots.
        me: its index.
        members: the effective team, empty without a team file.
    """
    robot = team.ids[me]
    own = topics_of(members, robot)
    each = {name: topics_of(members, name) for name in team.ids}
    return TopicNames(
        scan=own.full(own.scan, robot), odom=own.full(own.odom, robot),
        poses={name: topics.full(topics.pose, name) for name, topics in each.items()},
        stops=(own.full(STOP, robot), ALL_STOP), cmd_vel=own.full(own.cmd_vel, robot),
        plan=own.full(PLAN, robot), stamped=own.stamped,
    )  # fmt: skip
