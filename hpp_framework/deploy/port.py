"""What a robot offers an agent: its newest data with their times, and somewhere to send commands.

The loop that uses one, once a control period::

    inbox = port.latest()
    command = ...
    port.send(command)

Times are seconds of two clocks. ``arrived`` and ``now`` are of a clock that never jumps, ``stamp`` and
``clock`` of the one that senders share, which an administrator or a time server may step.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

Command = tuple[float, float]
"""Forward speed in m/s and turn rate in rad/s."""

HALT: Command = (0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class Message:
    """Something that came.

    Attributes:
        stamp: when it was measured, by the sender's clock.
        arrived: when it came, by the clock that never jumps.
    """

    stamp: float
    arrived: float


@dataclass(frozen=True, kw_only=True)
class Scan(Message):
    """Ranges of a lidar, as REP 117 has them: inf for no hit, -inf for too close, NaN for no range.

    Attributes:
        ranges: metres.
        angle_min: of the first beam, radians.
        angle_increment: to the next beam, radians; negative for a lidar that turns clockwise.
        range_min: metres; nearer ones are no ranges.
        range_max: metres; farther ones are no ranges.
    """

    ranges: Float[np.ndarray, "k"]
    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float


@dataclass(frozen=True, kw_only=True)
class Motion(Message):
    """Odometry.

    Attributes:
        velocity: forward speed in m/s and turn rate in rad/s.
    """

    velocity: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Fix(Message):
    """A localised pose.

    Attributes:
        pose: x, y in metres, heading in radians, in the map's frame.
    """

    pose: tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Inbox:
    """The newest of everything.

    Attributes:
        now: by the clock that never jumps.
        clock: by the clock that senders share.
        scan: own; None before the first.
        motion: own; None before the first.
        fixes: of the robots whose pose has come, by id.
        stopped: whether an emergency stop is pressed and not yet released.
    """

    now: float
    clock: float
    scan: Scan | None = None
    motion: Motion | None = None
    fixes: Mapping[str, Fix] = field(default_factory=lambda: dict[str, Fix]())
    stopped: bool = False


@dataclass(frozen=True, kw_only=True)
class View:
    """What an agent is up to, to look at only.

    Attributes:
        goal: of the team, metres.
        waypoint: where its skill is sent, metres.
        mean: of its belief over goals, metres.
        std: of its belief, metres.
        paths: predicted for the best goal, one for each robot, metres.
        reasons: why the gate brakes.
    """

    goal: tuple[float, float]
    waypoint: tuple[float, float]
    mean: tuple[float, float] | None = None
    std: tuple[float, float] | None = None
    paths: Float[np.ndarray, "n t 2"] | None = None
    reasons: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Traffic:
    """What has come on one topic.

    Attributes:
        topic: its name.
        type: of its messages.
        count: messages.
        age: seconds from the newest one's stamp to its arrival; NaN where there is none.
        frame: of the newest one.
        others: topics of this type that there are, if none came.
    """

    topic: str
    type: str
    count: int = 0
    age: float = float("nan")
    frame: str = ""
    others: tuple[str, ...] = ()


class RobotPort(ABC):
    """One robot. It reads the robot's own sensors, and of teammates their poses alone.

    Attributes:
        episode: seed of the episode that the world of a rehearsal has begun; None on robots.
    """

    episode: int | None = None

    @abstractmethod
    def latest(self) -> Inbox:
        """Return the newest of everything."""

    @abstractmethod
    def send(self, command: Command) -> None:
        """Send a command to the wheels."""

    def show(self, view: View) -> None:
        """Publish what the agent is up to; nothing unless a backend can."""
        del view

    def wait(self, until: float, *, for_scan: bool = False) -> None:
        """Let messages come until a time of the clock that never jumps; nothing where time is simulated.

        Args:
            until: seconds.
            for_scan: whether a new scan ends it sooner.
        """
        del until, for_scan

    def traffic(self) -> list[Traffic]:
        """Return what has come on each topic so far; nothing where there are no topics."""
        return []

    def close(self) -> None:
        """Give back what the port holds; safe to call twice."""
        return


class TeamPort(ABC):
    """The other end: all robots of a simulated team, in real time.

    Attributes:
        goals: that the robots' agents show, by index; NaN before the first.
    """

    goals: list[tuple[float, float]]

    @abstractmethod
    def publish(self, robot: int, scan: Scan, motion: Motion, fix: Fix) -> None:
        """Send what one robot's sensors say."""

    @abstractmethod
    def times(self) -> tuple[float, float]:
        """Return the time by the clock that never jumps, and by the one that all share."""

    @abstractmethod
    def wait(self, until: float) -> list[tuple[int, Command]]:
        """Return the commands, by robot, that come until a time of the clock that never jumps."""

    def begin(self, seed: int) -> None:
        """Tell all agents that a new episode begins."""
        del seed

    def close(self) -> None:
        """Give back what the port holds; safe to call twice."""
        return
