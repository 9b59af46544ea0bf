"""Conditions that hold in every state that fulfils a task: data from which least times are computed.

A task states its requirement, terms of a composed task state theirs, and
:mod:`hpp_framework.evaluation.task_bounds` computes the time before which no team can meet it. A condition
that is left out makes the bound lower, never wrong.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias


@dataclass(frozen=True)
class Gathering:
    """Robots are within a radius of one place.

    Attributes:
        radius: metres.
        robots: indices in the team; None for all robots.
        point: the place, world frame, metres; None for any place.
    """

    radius: float
    robots: tuple[int, ...] | None = None
    point: tuple[float, float] | None = None


@dataclass(frozen=True)
class Apart:
    """Two robots are at least a distance apart.

    Attributes:
        one: index in the team.
        other: index in the team.
        least: metres.
    """

    one: int
    other: int
    least: float


@dataclass(frozen=True)
class AllOf:
    """All parts hold."""

    parts: tuple[Requirement, ...]


@dataclass(frozen=True)
class AnyOf:
    """At least one part holds."""

    parts: tuple[Requirement, ...]


Requirement: TypeAlias = "Gathering | Apart | AllOf | AnyOf"
