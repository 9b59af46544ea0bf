"""Schedules: who takes part when.

A robot that does not take part stands, and no other robot hears of its poses: for the others it is an
obstacle that their lidars see. Those who take part are a team of their own, with the task of that team.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool
from torch import Tensor

from hpp_framework.core.task import Task
from hpp_framework.core.team import Team
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.utils.errors import ConfigError


@dataclass(frozen=True)
class Stage:
    """A time in which the same robots take part.

    Attributes:
        first: its first control step; it ends where the next one begins.
        present: indices of these robots in the whole team, in order.
        complete: whether all robots have joined by now; no episode is over before.
        task: of these robots.
    """

    first: int
    present: tuple[int, ...]
    complete: bool
    task: Task

    def begun(self, step: int) -> bool:
        """Return whether a control step lies in this stage or later."""
        return self.first <= step


Schedule = tuple[Stage, ...]
"""The stages of an episode, one if all robots take part all the time."""


def make_schedule(team: Team, make_task: Callable[[Team], Task]) -> Schedule:
    """Return the stages of a team's episodes.

    Args:
        team: all robots.
        make_task: builds the task of those who take part.

    Raises:
        ConfigError: if at some time no robot takes part, or the task is none for those that do.
    """
    joins = [_step(member.joins_at) for member in team.members]
    leaves = [None if member.leaves_at is None else _step(member.leaves_at) for member in team.members]
    found: list[Stage] = []
    for first in sorted({0, *joins, *(step for step in leaves if step is not None)}):
        present = tuple(
            i
            for i, (join, leave) in enumerate(zip(joins, leaves, strict=True))
            if join <= first and (leave is None or first < leave)
        )
        if not present:
            raise ConfigError(
                f"from {first * CONTROL_PERIOD:g} s on no robot of the team takes part; let at least one do "
                "so at any time (joins_at, leaves_at)."
            )
        found.append(Stage(first, present, max(joins) <= first, make_task(team.part(present))))
    return tuple(found)


def permanent(task: Task, robots: int) -> Schedule:
    """Return the schedule of a team whose robots all take part all the time."""
    return (Stage(0, tuple(range(robots)), complete=True, task=task),)


def presence(schedule: Sequence[Stage], steps: int, robots: int) -> Bool[Tensor, "s n"]:
    """Return who takes part in each control step.

    Args:
        schedule: of the team.
        steps: as many.
        robots: of the whole team.
    """
    present = torch.zeros(steps, robots, dtype=torch.bool)
    for stage in schedule:
        present[stage.first :] = False
        present[stage.first :, list(stage.present)] = True
    return present


def _step(seconds: float) -> int:
    return round(seconds / CONTROL_PERIOD)
