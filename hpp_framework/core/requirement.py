"""What must hold in any state that fulfils a task: data from which least times are proven.

A task says it, terms of a composed task say it for themselves, and
:mod:`hpp_framework.evaluation.task_bounds` works out the time before which no team can be in such a state.
What a requirement leaves out makes the bound lower, never wrong.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias


@dataclass(frozen=True)
class Gathering:
    """Robots are within a radius of one place, wherever that is.

    Attributes:
        radius: metres.
        robots: indices in the team; None for everybody.
    """

    radius: float
    robots: tuple[int, ...] | None = None


@dataclass(frozen=True)
class Visit:
    """A robot is within a radius of a given point.

    Attributes:
        robot: index in the team.
        point: world frame, metres.
        radius: metres.
    """

    robot: int
    point: tuple[float, float]
    radius: float


@dataclass(frozen=True)
class Apart:
    """The distance of two robots lies between two values.

    Attributes:
        one: index in the team.
        other: index in the team.
        least: metres.
        most: metres.
    """

    one: int
    other: int
    least: float = 0.0
    most: float = math.inf


@dataclass(frozen=True)
class Displaced:
    """A robot is where another one's position and a vector lead, give or take some slack.

    Attributes:
        one: index in the team.
        other: index in the team.
        vector: from the other to the one, world frame, metres.
        slack: metres.
    """

    one: int
    other: int
    vector: tuple[float, float]
    slack: float


@dataclass(frozen=True)
class AllOf:
    """All parts hold."""

    parts: tuple[Requirement, ...]


@dataclass(frozen=True)
class AnyOf:
    """At least one part holds."""

    parts: tuple[Requirement, ...]


Requirement: TypeAlias = "Gathering | Visit | Apart | Displaced | AllOf | AnyOf"
