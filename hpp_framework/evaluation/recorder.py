"""Remembers an episode while it runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from torch import Tensor

from hpp_framework.core.agent import Agent
from hpp_framework.core.planner import Belief
from hpp_framework.core.team import Team
from hpp_framework.core.types import Observation, State
from hpp_framework.core.world import World
from hpp_framework.evaluation.rollout import Episodes
from hpp_framework.viz.floor_plan import floor_plan
from hpp_framework.viz.record import AgentRecord, EpisodeRecord, Plan


@dataclass
class Recorder:
    """Watches one episode of a batch.

    Attributes:
        index: of the episode in the batch.
    """

    index: int = 0
    _moments: list[_Moment] = field(default_factory=list)
    _plans: list[list[Plan]] = field(default_factory=list)
    _beliefs: list[Belief | None] = field(default_factory=list)

    def __call__(
        self, step: int, state: State, agents: Sequence[Agent], observations: Sequence[Observation]
    ) -> None:
        """Remember one control step; called after planning."""
        if not self._plans:
            self._plans = [[] for _ in agents]
            self._beliefs = [None for _ in agents]
        for number, agent in enumerate(agents):
            # a planner that returns the belief it was given has decided nothing
            if agent.belief is not None and agent.belief is not self._beliefs[number]:
                self._beliefs[number] = agent.belief
                self._plans[number].append(self._plan(step, agent.goal, agent.belief))
        i = self.index
        self._moments.append(
            _Moment(
                seen=[_array(o.team_poses[i]) for o in observations],
                scans=[_array(o.scan[i]) for o in observations],
                goals=[_array(agent.goal[i]) for agent in agents],
                resting=[not bool(agent.command[i].any()) for agent in agents],
                people=None if state.people is None else _array(state.people.poses[i]),
            )
        )

    def record(
        self, about: Mapping[str, Any], world: World, team: Team, episodes: Episodes, *, period: float
    ) -> EpisodeRecord:
        """Return the episode, cut where it ended.

        Args:
            about: what it was, plain data; how it ended is added.
            world: its world.
            team: all robots.
            episodes: the whole batch.
            period: seconds per control step.
        """
        last = int(episodes.last_step()[self.index])
        moments = self._moments[: last + 1]
        agents = tuple(
            AgentRecord(
                id=member.id, robot=member.robot,
                seen=np.stack([m.seen[i] for m in moments]), scans=np.stack([m.scans[i] for m in moments]),
                goals=np.stack([m.goals[i] for m in moments]),
                resting=np.array([m.resting[i] for m in moments]),
                plans=tuple(plan for plan in self._plans[i] if plan.step <= last),
            )
            for i, member in enumerate(team.members)
        )  # fmt: skip
        return EpisodeRecord(
            about={**about, **_outcome(episodes, self.index, period)},
            period=period,
            ground=floor_plan(world, body_height=max(robot.height for robot in team.robots)),
            poses=_array(episodes.poses[self.index, : last + 1]),
            agents=agents,
            people=_people(world, [moment.people for moment in moments]),
            moving=_moving(world, np.arange(len(moments)) * period),
        )

    def _plan(self, step: int, goal: Tensor, belief: Belief) -> Plan:
        i, count = self.index, len(self._plans)
        place: dict[str, Any] = {
            "step": step, "goal": _array(goal[i]),
            "mean": _array(belief.mean[i]), "std": _array(belief.std[i]),
        }  # fmt: skip
        imagined = belief.imagination
        if imagined is None:
            none = np.zeros(0, np.float32)
            return Plan(
                **place, candidates=none.reshape(0, 2), scores=none, times=none,
                paths=none.reshape(0, 0, count, 2),
            )  # fmt: skip
        return Plan(
            **place, candidates=_array(imagined.goals[i]), scores=_array(imagined.scores[i]),
            paths=_array(imagined.trajectories.poses[i, ..., :2]), times=_array(imagined.trajectories.times),
        )  # fmt: skip


@dataclass(frozen=True)
class _Moment:
    """One control step; a list entry per agent."""

    seen: list[np.ndarray]
    scans: list[np.ndarray]
    goals: list[np.ndarray]
    resting: list[bool]
    people: np.ndarray | None = None


def _people(world: World, poses: Sequence[np.ndarray | None]) -> np.ndarray | None:
    """Return x, y, heading and radius (s, p, 4) of the people of a world at all moments."""
    if not world.people:
        return None
    radii = np.array([person.radius for person in world.people], np.float32)
    known = np.stack([each[: len(radii)] for each in poses if each is not None])
    return np.concatenate([known, np.broadcast_to(radii[:, None], (*known.shape[:2], 1))], -1)


def _moving(world: World, times: np.ndarray) -> np.ndarray | None:
    """Return the outlines (s, m, 24, 2) of the moving obstacles of a world at all times."""
    if not world.moving:
        return None
    return np.array(
        [[obstacle.outline(float(time)) for obstacle in world.moving] for time in times], np.float32
    )


def _outcome(episodes: Episodes, index: int, period: float) -> dict[str, Any]:
    done, contact = int(episodes.done_step[index]), int(episodes.contact_step[index])
    last = int(episodes.last_step()[index])
    return {
        "success": done >= 0,
        "time_s": round(done * period, 2) if done >= 0 else None,
        "first_contact_s": round(contact * period, 2) if contact >= 0 else None,
        "collided": bool(episodes.collided[index]),
        "final_distance_m": round(float(episodes.spread()[index, last]), 4),
    }


def _array(values: Tensor) -> np.ndarray:
    """Return a copy in single precision; simulators and planners may reuse their memory."""
    return np.array(values.detach().cpu().numpy(), np.float32)
