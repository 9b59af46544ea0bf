"""One episode as it is remembered: what happened, what each agent saw, and what it weighed at each plan.

Looks on while :func:`hpp_framework.evaluation.rollout.run_episodes` runs::

    recorder = Recorder()
    episodes = run_episodes(..., watch=recorder)
    record = recorder.record(about, world, team, episodes)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from hpp_framework.core.robot import RobotSpec
from hpp_framework.viz.floor_plan import FloorPlan

Floats = np.ndarray


@dataclass(frozen=True, kw_only=True)
class Plan:
    """One decision of one agent.

    A planner that imagines nothing has no candidates (g = 0).

    Attributes:
        step: control step at which it was made.
        goal: what the agent's skill was told, metres, world frame.
        mean: of the belief over goals, metres.
        std: of the belief over goals, metres, an axis each.
        candidates: goals that were weighed.
        scores: of the candidates; higher is better.
        paths: imagined positions of all robots for each candidate, metres.
        times: of the imagined positions, seconds ahead of the plan.
    """

    step: int
    goal: Float[Floats, "2"]
    mean: Float[Floats, "2"]
    std: Float[Floats, "2"]
    candidates: Float[Floats, "g 2"]
    scores: Float[Floats, "g"]
    paths: Float[Floats, "g t n 2"]
    times: Float[Floats, "t"]

    def order(self) -> list[int]:
        """Return the candidates with a finite score, best first."""
        finite = np.flatnonzero(np.isfinite(self.scores))
        return finite[np.argsort(-self.scores[finite], kind="stable")].tolist()

    def chosen(self) -> int | None:
        """Return the candidate nearest to the goal, None where nothing was imagined.

        The paper's planner takes the mean of its last samples, which need not be one of them.
        """
        if not len(self.candidates):
            return None
        return int(np.linalg.norm(self.candidates - self.goal, axis=-1).argmin())


@dataclass(frozen=True, kw_only=True)
class AgentRecord:
    """What one agent saw and decided; ``s`` counts control steps, the start included.

    Attributes:
        id: in the team.
        robot: its data, without a body.
        seen: poses of all robots as the agent observed them.
        scans: own lidar, metres.
        goals: of the skill.
        resting: whether the agent commanded no motion.
        plans: in the order of their steps.
    """

    id: str
    robot: RobotSpec
    seen: Float[Floats, "s n 3"]
    scans: Float[Floats, "s k"]
    goals: Float[Floats, "s 2"]
    resting: Bool[np.ndarray, "s"]
    plans: tuple[Plan, ...]

    def plan_at(self, step: int) -> Plan | None:
        """Return the plan in force at a control step, None before the first."""
        return next((plan for plan in reversed(self.plans) if plan.step <= step), None)


@dataclass(frozen=True, kw_only=True)
class EpisodeRecord:
    """An episode.

    Attributes:
        about: plain data: what it was (world, planner, preset, team, backend, seed, episode, config), and how
            it ended.
        period: seconds per control step.
        ground: the world from above.
        poses: true poses, the start first.
        agents: in team order.
        people: x, y, heading and radius of all people who walked around; None without people.
        moving: outlines of moving obstacles, metres; None for none.
    """

    about: dict[str, Any]
    period: float
    ground: FloorPlan
    poses: Float[Floats, "s n 3"]
    agents: tuple[AgentRecord, ...]
    people: Float[Floats, "s p 4"] | None = None
    moving: Float[Floats, "s m q 2"] | None = None

    @property
    def robots(self) -> tuple[RobotSpec, ...]:
        """Robot data in team order."""
        return tuple(agent.robot for agent in self.agents)

    def goals(self) -> Float[Floats, "s n 2"]:
        """Return the goal of each agent's skill at each control step, metres."""
        return np.stack([agent.goals for agent in self.agents], 1)
