"""Who takes part when: robots that join late, robots that drop out, and agents that cope with both.

A robot that does not take part stands, and nobody hears of its poses: for the others it is an obstacle that
their lidars see. Those who take part are a team of their own, with the task of that team.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.agents.hierarchical import Agent
from hpp_framework.core.planner import Belief
from hpp_framework.core.task import Task
from hpp_framework.core.team import Team
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import Keyframes, Observation, Trajectories
from hpp_framework.utils.errors import ConfigError


@dataclass(frozen=True)
class Shift:
    """A time in which the same robots take part.

    Attributes:
        first: its first control step; it ends where the next one begins.
        present: indices of these robots in the whole team, in order.
        complete: whether everybody has joined by now; no episode is over before.
        task: of these robots.
    """

    first: int
    present: tuple[int, ...]
    complete: bool
    task: Task

    def begun(self, step: int) -> bool:
        """Return whether a control step lies in this shift or later."""
        return self.first <= step


def shifts(team: Team, make_task: Callable[[Team], Task]) -> tuple[Shift, ...]:
    """Return the shifts of an episode, one if everybody takes part all the time.

    Args:
        team: everybody.
        make_task: builds the task of those who take part.

    Raises:
        ConfigError: if at some time nobody takes part, or the task is none for those who do.
    """
    joins = [_step(member.joins_at) for member in team.members]
    leaves = [None if member.leaves_at is None else _step(member.leaves_at) for member in team.members]
    found: list[Shift] = []
    for first in sorted({0, *joins, *(step for step in leaves if step is not None)}):
        present = tuple(
            i
            for i, (join, leave) in enumerate(zip(joins, leaves, strict=True))
            if join <= first and (leave is None or first < leave)
        )
        if not present:
            raise ConfigError(
                f"from {first * CONTROL_PERIOD:g} s on nobody of the team takes part; let at least one robot "
                "do so at any time (joins_at, leaves_at)."
            )
        found.append(Shift(first, present, max(joins) <= first, make_task(team.part(present))))
    return tuple(found)


def attendance(turns: Sequence[Shift], steps: int, robots: int) -> Bool[Tensor, "s n"]:
    """Return who takes part in each control step.

    Args:
        turns: from :func:`shifts`.
        steps: as many.
        robots: of the whole team.
    """
    present = torch.zeros(steps, robots, dtype=torch.bool)
    for turn in turns:
        present[turn.first :] = False
        present[turn.first :, list(turn.present)] = True
    return present


def _step(seconds: float) -> int:
    return round(seconds / CONTROL_PERIOD)


def heard(observation: Observation, present: Sequence[int]) -> Observation:
    """Return what an agent knows while it hears of some of the robots only, itself among them.

    Args:
        observation: of the agent, of the whole team.
        present: indices of these robots.
    """
    chosen = list(present)
    kept = observation.keyframes
    return Observation(
        agent=chosen.index(observation.agent),
        poses=observation.poses[:, :, chosen],
        scans=observation.scans,
        velocity=observation.velocity,
        keyframes=None if kept is None else Keyframes(kept.poses[:, :, chosen], kept.scans),
    )


class PartTimeAgent(Agent):
    """A robot of a team that changes: an agent for each shift in which it takes part, and none in others.

    At each change of the team it plans anew; a planner that heeds nobody goes on as before. To those who look
    on it shows beliefs about the whole team, in which absent robots stand.

    Args:
        turns: each shift and the robot's agent in it, None where it does not take part.
    """

    def __init__(self, turns: Sequence[tuple[Shift, Agent | None]]) -> None:
        first = next(agent for _, agent in turns if agent is not None)
        super().__init__(first.skill, first.planner, None, first.rng, first.guard, first.guide)
        self._turns = list(turns)
        self._step = 0
        self._now: Agent | None = None
        self._before: Agent | None = None
        self._begin()

    def act(self, observation: Observation) -> Float[Tensor, "b 2"]:
        """Return commands [v, omega] for this control step: 0 while it does not take part."""
        self._begin()
        self._step += 1
        if self._now is None:
            self.goal = self.waypoint = observation.pose[:, :2]
            self.belief = None
            return torch.zeros_like(observation.velocity)
        before = self._now.belief
        command = self._now.act(self.view(observation))
        self.goal, self.waypoint = self._now.goal, self._now.waypoint
        if self._now.belief is not before or self.belief is None:
            self.belief = self._shown(self._now.belief, observation)
        return command

    def plan(self, observation: Observation) -> Belief:
        """Choose a goal now; see :meth:`Agent.plan`."""
        if self._now is None:
            raise ConfigError("a robot that does not take part cannot plan.")
        self._now.plan(self.view(observation))
        self.goal, self.waypoint = self._now.goal, self._now.waypoint
        shown = self._shown(self._now.belief, observation)
        assert shown is not None
        self.belief = shown
        return shown

    def view(self, observation: Observation) -> Observation:
        """Return what its planner is shown: nothing of those who do not take part."""
        return heard(observation, self._shift.present) if self.present else observation

    def resting(self, observation: Observation) -> Bool[Tensor, "b"]:
        """Return whether it halts because that fulfils the task; see :meth:`Agent.resting`."""
        if self._now is None:
            return torch.zeros(len(observation.pose), dtype=torch.bool, device=observation.pose.device)
        return self._now.resting(self.view(observation))

    def _begin(self) -> None:
        """Take up the shift that has begun, if one has."""
        while self._turns and self._turns[0][0].begun(self._step):
            self._shift, self._now = self._turns.pop(0)
            self.present = self._now is not None
            if self._now is None:
                continue
            if self._before is not None and self._now.planner.heedless:
                self._now.go_on_from(self._before)
            self._before = self._now
            self.planner = self._now.planner
            self.belief = None

    def _shown(self, belief: Belief | None, observation: Observation) -> Belief | None:
        """Return a belief in which those who do not take part stand where they are."""
        if belief is None or belief.imagination is None:
            return belief
        imagined = belief.imagination.trajectories
        everybody = observation.team_poses[:, None, None].repeat(1, *imagined.poses.shape[1:3], 1, 1)
        everybody[..., list(self._shift.present), :] = imagined.poses
        shown = replace(belief.imagination, trajectories=Trajectories(everybody, imagined.times))
        return Belief(belief.goal, belief.mean, belief.std, shown)
