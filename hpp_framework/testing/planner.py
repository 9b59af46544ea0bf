"""``check_planner``: whether plans are goals within the world, repeatable, and belong to one agent alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from itertools import combinations
from typing import Any

import torch
from torch import Tensor

from hpp_framework.agents.build import AgentConfig, build_agents
from hpp_framework.core.planner import Decision, MetaPlanner, PlannerContext
from hpp_framework.core.schedule import permanent
from hpp_framework.core.task import Task
from hpp_framework.core.team import Team
from hpp_framework.core.types import Observation
from hpp_framework.evaluation.rollout import Episodes, run_episodes
from hpp_framework.plugins.build import make_skills, parse_team
from hpp_framework.plugins.builtin import DEFAULT_TASK
from hpp_framework.plugins.registry import hub
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.testing.build import SHARED, WEIGHTS, Source, build, find_source
from hpp_framework.testing.purity import (
    NOT_REPEATABLE,
    check_pure,
    check_rows,
    check_tensor,
)
from hpp_framework.testing.report import Report, Rule
from hpp_framework.testing.scene import EPISODES, Scene, find_teams, make_scene
from hpp_framework.utils.errors import CheckpointError, ConfigError
from hpp_framework.utils.seeding import EpisodeRng

PLAN_EVERY = Rule(
    name="plan-every",
    why="agents count control steps down to the next plan; below 1 they never plan again.",
    fix="plan_every: int = 10, at least 1 (control steps of 0.2 s).",
)
SHARED_RNG = Rule(
    name="shared-rng",
    why="it decides whether all agents share one source of randomness; text and None are taken for an "
    "answer.",
    fix="shared_rng: bool = False, or True.",
)
BELIEF = Rule(
    name="belief",
    why="the next call gets it back: it is all that a planner may remember, and what figures show.",
    fix="return Decision(goal, Belief(goal=..., mean=..., std=...)), each (episodes, 2), std 0 or more; "
    "certain(goal) is a belief without doubt.",
)
OUTSIDE = Rule(
    name="goal-outside",
    why="no robot gets there: goals are world coordinates in metres, not in a robot's frame, not in pixels.",
    fix="goals within context.bounds (x_min, y_min, x_max, y_max): geometry.to_world for goals in a "
    "robot's frame, "
    "and clamp.",
)
TASK = DEFAULT_TASK
"""The task of commands."""
RULES = (PLAN_EVERY, SHARED_RNG, BELIEF, OUTSIDE)

Factory = Callable[[PlannerContext], MetaPlanner]
SIGNATURE = "(context: PlannerContext) -> MetaPlanner"
MEANING = "(episodes, [x, y])"
STEPS = 12
"""Control steps of the episode."""
ROUNDED = 1e-3
"""Metres by which rounding may change a goal."""
SAME = 1e-4
"""Metres by which two equal episodes may differ."""


def check_planner(
    planner: str | MetaPlanner | Callable[[PlannerContext], MetaPlanner],
    *,
    team: str | Team | None = None,
    task: str | Task | None = None,
    preset: str = "best",
    settings: Mapping[str, Any] | None = None,
) -> None:
    """Check a planner by questions, and by an episode of its team in the batch simulator.

    An object belongs to one robot, so that there is no episode for it.

    Args:
        planner: registered name, factory or object.
        team: that plans, e.g. ``"rover,rover"``; None for the first pair that it can be built for.
        task: of the team, by name or as an object; None for that of the commands.
        preset: of planners that have presets.
        settings: of planners that have some, by dotted name, e.g. ``{"cem.samples": 5}`` for a quicker check.

    Raises:
        CheckError: if anything is wrong; holds everything that was found.
        UnknownNameError: if nothing has that name.
    """
    source, report = find_source("planner", planner, MetaPlanner)
    contexts = _contexts(source.distribution, team, task, preset, settings or {})
    context, made = _build(source, report, contexts)
    if context is not None and made is not None:
        scene = make_scene(context.team)
        _check_attributes(report, made)
        fine = _is_oracle(made, scene.observations[0]) or _check_plans(
            report, made, scene.observations[0], context
        )
        if fine and source.factory is not None:
            with report.guarded("plan()", f"in an episode of {STEPS} control steps"):
                _check_episode(report, source.factory, scene, context)
    report.finish()


def _build(
    source: Source, report: Report, contexts: Iterator[PlannerContext]
) -> tuple[PlannerContext | None, MetaPlanner | None]:
    missing = ""
    for context in contexts:
        try:
            make_skills(context.team)
        except Exception as error:
            # the skill's own check says so
            missing = missing or str(error)
            continue
        try:
            return context, build(source, report, (context,), MetaPlanner, SIGNATURE)
        except CheckpointError as error:
            missing = missing or str(error)
    report.add(WEIGHTS, "the factory", f"finds no weights: {missing}")
    return None, None


def _contexts(
    distribution: str,
    team: str | Team | None,
    task: str | Task | None,
    preset: str,
    settings: Mapping[str, Any],
) -> Iterator[PlannerContext]:
    teams = find_teams(distribution)
    if team is not None:
        teams = iter([parse_team(team) if isinstance(team, str) else team])
    for known in teams:
        objective = task if isinstance(task, Task) else hub().tasks.create(task or TASK, known.robots)
        bounds = make_scene(known, episodes=1).world.bounds
        yield PlannerContext(
            team=known, agent=0, task=objective, preset=preset, bounds=bounds, settings=settings
        )


def _is_oracle(planner: MetaPlanner, seen: Observation) -> bool:
    """Return whether a planner plans only where it is told what no robot knows: in episodes."""
    try:
        planner.plan(seen, None, _rng())
    except ConfigError as error:
        return "is an oracle" in str(error)
    except Exception:  # the checks say what is wrong
        return False
    return False


def _check_attributes(report: Report, planner: MetaPlanner) -> None:
    every: Any = planner.plan_every
    fine = isinstance(every, int) and not isinstance(every, bool) and every >= 1
    report.require(fine, PLAN_EVERY, "plan_every", f"is {every!r}.")
    value: Any = planner.shared_rng
    report.require(isinstance(value, bool), SHARED_RNG, "shared_rng", f"is {value!r}, not True or False.")


def _rng(count: int = EPISODES) -> EpisodeRng:
    return EpisodeRng(range(11, 11 + count))


@torch.no_grad()
def _check_plans(report: Report, planner: MetaPlanner, seen: Observation, context: PlannerContext) -> bool:
    other = seen.episodes(slice(0, 2))
    answer: Any = check_pure(
        report,
        "plan()",
        lambda: planner.plan(seen, None, _rng()),
        seen,
        lambda: planner.plan(other, None, _rng(2)),
    )
    if answer is None or not _check_answer(report, "plan()", answer, context):
        return False
    decision: Decision = answer
    belief = decision.belief
    with report.guarded("plan()", "with the belief that it returned"):
        again: Any = check_pure(
            report, "plan() with a belief", lambda: planner.plan(seen, belief, _rng()), seen, lent=belief
        )
        if again is None or not _check_answer(report, "plan() with a belief", again, context):
            return False
    check_rows(
        report, "plan()", decision.goal,
        lambda row: planner.plan(seen.episodes(slice(row, row + 1)), None, EpisodeRng([11 + row])).goal,
        (0, EPISODES - 1), ROUNDED,
    )  # fmt: skip
    with report.guarded("follow()"):
        _check_answer(report, "follow()", planner.follow(seen, decision), context)
    return True


def _check_answer(report: Report, of: str, answer: Any, context: PlannerContext) -> bool:
    if not isinstance(answer, Decision):
        report.add(BELIEF, of, f"returned {type(answer).__name__}, not a Decision.")
        return False
    goal, belief = answer.goal, answer.belief
    fine = check_tensor(report, of, goal, (EPISODES, 2), MEANING)
    for name in ("goal", "mean", "std"):
        value: Any = getattr(belief, name)
        if (
            not isinstance(value, Tensor)
            or value.shape != (EPISODES, 2)
            or not bool(torch.isfinite(value).all())
        ):
            shape = tuple(value.shape) if isinstance(value, Tensor) else type(value).__name__
            report.add(
                BELIEF, of, f"has a belief whose {name} is {shape} or not finite, not {(EPISODES, 2)}."
            )
            fine = False
    if not fine:
        return False
    report.require(
        bool((belief.std >= 0).all()),
        BELIEF,
        of,
        f"has a belief with a negative std, {float(belief.std.min()):.3g}.",
    )
    low, high = torch.tensor(context.bounds[:2]), torch.tensor(context.bounds[2:])
    out = (goal < low) | (goal > high)
    if bool(out.any()):
        worst = goal[out.any(-1)][0].tolist()
        report.add(
            OUTSIDE, of, f"sends the robot to {[round(v, 2) for v in worst]}; bounds are {context.bounds}."
        )
    return True


def _check_episode(report: Report, make: Factory, scene: Scene, context: PlannerContext) -> None:
    """Run an episode twice, with agents built anew and the same seed."""
    planners = [make(replace(context, agent=index)) for index in range(len(context.team))]
    if any(one is other for one, other in combinations(planners, 2)):
        report.add(SHARED, "the factory", "returned one object for two robots.")
    first, second = (_episode(make, scene, context) for _ in range(2))
    same = first.poses.shape == second.poses.shape
    apart = float((first.poses - second.poses).abs().max()) if same else math.inf
    report.require(
        apart <= SAME, NOT_REPEATABLE, "an episode",
        f"with the same seed and new agents ends elsewhere the second time, by up to {apart:.3g} m.",
    )  # fmt: skip


def _episode(make: Factory, scene: Scene, context: PlannerContext) -> Episodes:
    team = context.team
    config = AgentConfig(planner=lambda own: make(_told(own, context)))
    agents = build_agents(team, context.task, config, context.bounds)
    schedule = permanent(context.task, len(team))
    with BatchSimulator(team.robots, threads=1) as simulator:
        return run_episodes(
            simulator, [scene.world] * 2, scene.starts[:2], agents, schedule, seeds=(0, 1), steps=STEPS
        )


def _told(own: PlannerContext, context: PlannerContext) -> PlannerContext:
    """Return a context with the preset and settings that are checked."""
    return replace(own, preset=context.preset, settings=context.settings)
