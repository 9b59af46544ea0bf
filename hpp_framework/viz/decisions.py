"""An episode decision by decision: what each agent chose, why, and what came of what it imagined."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from hpp_framework.viz.record import EpisodeRecord, Plan

Floats = np.ndarray

HORIZONS = (1.0, 2.0, 5.0)
"""Seconds ahead at which imagination is compared with what happened."""

TOP = 5
SAME_GOAL = 0.005
"""Goals nearer than this are the same, metres; records are rounded."""

SAME_SCORE = 0.0015
WEIGHED = 0.05
"""A goal with a candidate as near as this was weighed itself, metres."""


@dataclass(frozen=True, kw_only=True)
class Decision:
    """One plan of one agent, and what it led to.

    Attributes:
        agent: index in the team.
        plan: what was weighed and chosen.
        time: of the plan, seconds.
        kind: whether the goal is the agent's first, the one it had, or another.
        moved: distance from the goal before, metres; 0 for the first.
        why: a sentence.
        top: the best candidates, best first.
        errors: distance of each robot's true position from the imagined one at each of :data:`HORIZONS`,
            metres; NaN beyond what was imagined or happened, and where nothing was imagined.
        disagreement: largest distance between the agents' goals after this step's plans, metres.
    """

    agent: int
    plan: Plan
    time: float
    kind: Literal["first", "kept", "changed"]
    moved: float
    why: str
    top: tuple[int, ...]
    errors: Float[Floats, "h n"]
    disagreement: float


def decisions(record: EpisodeRecord) -> list[Decision]:
    """Return all plans of an episode by time, then by agent."""
    found: list[Decision] = []
    for number, agent in enumerate(record.agents):
        before: Plan | None = None
        for plan in agent.plans:
            found.append(_decision(record, number, before, plan))
            before = plan
    return sorted(found, key=lambda decision: (decision.plan.step, decision.agent))


def goal_disagreement(record: EpisodeRecord, step: int) -> float:
    """Return the largest distance between agents' goals at a control step, metres (0 for a lone robot)."""
    goals = record.goals()[step].astype(np.float64)
    return float(np.linalg.norm(goals[:, None] - goals[None], axis=-1).max())


def imagined(plan: Plan, start: Float[Floats, "n 2"]) -> tuple[Floats, Floats] | None:
    """Return times (t + 1,) and the team's imagined positions (t + 1, n, 2) for the chosen goal.

    Args:
        plan: of one agent.
        start: where the agent saw the team when it planned.

    Returns:
        The path from ``start`` on, or None where nothing was imagined.
    """
    chosen = plan.chosen()
    if chosen is None:
        return None
    return np.concatenate([[0.0], plan.times]), np.concatenate([start[None], plan.paths[chosen]])


def _decision(record: EpisodeRecord, number: int, before: Plan | None, plan: Plan) -> Decision:
    moved = 0.0 if before is None else float(np.linalg.norm(plan.goal - before.goal))
    kind = "first" if before is None else "kept" if moved < SAME_GOAL else "changed"
    hysteresis = _hysteresis(record.about)
    return Decision(
        agent=number, plan=plan, time=plan.step * record.period, kind=kind, moved=moved,
        why=_why(plan, before, kind, moved, hysteresis), top=tuple(plan.order()[:TOP]),
        errors=_errors(record, number, plan), disagreement=goal_disagreement(record, plan.step),
    )  # fmt: skip


def _hysteresis(about: Mapping[str, Any]) -> float | None:
    """Return by how much another goal must be better, if the planner says so."""
    settings = about.get("planner_config")
    hysteresis = settings.get("hysteresis") if isinstance(settings, dict) else None
    return hysteresis if isinstance(hysteresis, int | float) and not isinstance(hysteresis, bool) else None


def _why(plan: Plan, before: Plan | None, kind: str, moved: float, hysteresis: float | None) -> str:
    order, chosen = plan.order(), plan.chosen()
    if chosen is None or not order:
        return {"first": "a rule sets the goal", "kept": "the rule's goal has not moved"}.get(
            kind, f"the rule's goal moved by {moved:.2f} m"
        )
    best, score = float(plan.scores[order[0]]), float(plan.scores[chosen])
    gap = best - score
    if float(np.linalg.norm(plan.candidates[chosen] - plan.goal)) > WEIGHED:
        own = f"the middle of the search; the nearest of {len(order)} samples scores {gap:.2f} below the best"
    elif gap <= SAME_SCORE:
        own = f"the best of {len(order)} candidates"
    else:
        own = f"the best of {len(order)} candidates scores only {gap:.2f} better"
        own += f", {hysteresis:g} would be needed" if hysteresis is not None and kind == "kept" else ""
    if kind != "changed" or before is None:
        return own
    return f"{own}; moved by {moved:.2f} m, {_old_score(plan, before, score)}"


def _old_score(plan: Plan, before: Plan, score: float) -> str:
    gaps = np.linalg.norm(plan.candidates - before.goal, axis=-1)
    nearest = int(gaps.argmin())
    if gaps[nearest] > WEIGHED:
        return "the goal before is no candidate any more"
    change = score - float(plan.scores[nearest])
    return f"{abs(change):.2f} {'better' if change >= 0 else 'worse'} than the goal before"


def _errors(record: EpisodeRecord, number: int, plan: Plan) -> Floats:
    errors = np.full((len(HORIZONS), len(record.agents)), np.nan)
    ahead = imagined(plan, record.agents[number].seen[plan.step, :, :2])
    if ahead is None:
        return errors
    times, paths = ahead
    for h, seconds in enumerate(HORIZONS):
        step = plan.step + round(seconds / record.period)
        if step >= len(record.poses) or seconds > times[-1] + 1e-6:
            continue
        for i in range(len(record.agents)):
            place = [np.interp(seconds, times, paths[:, i, axis]) for axis in (0, 1)]
            errors[h, i] = np.linalg.norm(record.poses[step, i, :2] - place)
    return errors
