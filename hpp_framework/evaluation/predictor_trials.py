"""Asks predictors where a team will be, and measures how far off they were.

Fresh trajectories are driven in memory, the whole team towards the same goal. On the way, at a few moments,
every robot's predictor is asked through nothing but :meth:`~hpp_framework.core.predictor.Predictor.rollout`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.config.sensing_choice import make_estimators, parse_disturbances
from hpp_framework.core.predictor import Predictor
from hpp_framework.core.team import Team
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import Observation, Trajectories
from hpp_framework.perception.sensing import KEYFRAMES
from hpp_framework.prediction.collect import Collection, drive
from hpp_framework.utils.errors import ConfigError

MOMENTS = (0, 15, 40)
"""Control steps of a trajectory at which predictors are asked: at rest, on the way, late."""
SLICE = 200
"""Episodes that are predicted at once, which bounds the memory."""
WORLDS = 100
"""Different worlds per cell, at most."""


@dataclass(frozen=True)
class Question:
    """A moment of many trajectories, and what came of it.

    Attributes:
        observations: one per robot.
        goals: of all robots, world coordinates.
        future: positions of all robots one control step ahead, two, ...
    """

    observations: list[Observation]
    goals: Float[Tensor, "b 2"]
    future: Float[Tensor, "b t n 2"]


@dataclass(frozen=True)
class Misses:
    """How far off one robot's predictor was about one robot.

    Attributes:
        times: seconds ahead.
        distance: in metres, of every question about every trajectory.
        std: that the predictor said, in metres along each axis, or None.
        trajectory: of each row; rows of one trajectory hang together.
    """

    times: Float[Tensor, "t"]
    distance: Float[Tensor, "q t"]
    std: Float[Tensor, "q t"] | None
    trajectory: Float[Tensor, "q"]


def draw_questions(
    team: Team, world: str, *, trajectories: int, seconds: float, seed: int, disturbances: str, estimator: str
) -> list[Question]:
    """Drive a team through worlds drawn by seed and stop it, so to speak, at :data:`MOMENTS`.

    Args:
        team: who drives.
        world: registered world or world file.
        trajectories: how many.
        seconds: that are to be predicted, at most.
        seed: of worlds, starts, goals and disturbances.
        disturbances: of sensing and acting: a profile, with settings or without.
        estimator: registered estimator, with settings or without.

    Raises:
        ConfigError: if the world cannot be made, or has no room for the team.
    """
    ahead = round(seconds / CONTROL_PERIOD)
    config = Collection(
        trajectories=trajectories, chunk=trajectories, worlds=min(WORLDS, trajectories), world=world,
        steps=MOMENTS[-1] + ahead + 1, switch_share=0.0, seed=seed,
    )  # fmt: skip
    asked: list[tuple[list[Observation], Tensor]] = []
    positions: list[Tensor] = []
    errors = [parse_disturbances(disturbances)] * len(team)
    estimators = make_estimators(estimator, team.robots, errors)
    for moment in drive(
        team, config, "evaluation", disturbances=errors, estimators=estimators, keyframes=KEYFRAMES
    ):
        positions.append(moment.state.poses[..., :2].clone())
        if moment.step in MOMENTS:
            asked.append(([_keep(own) for own in moment.observations], moment.goals))
    driven = torch.stack(positions, 1)
    return [
        Question(seen, goals, driven[:, step + 1 : step + 1 + ahead])
        for step, (seen, goals) in zip(MOMENTS, asked, strict=True)
    ]


def _keep(seen: Observation) -> Observation:
    """Return an observation that shares no memory with the simulator."""
    return Observation(seen.agent, seen.poses, seen.scans, seen.velocity.clone(), seen.keyframes)


def misses(predictor: Predictor, agent: int, questions: list[Question]) -> list[Misses]:
    """Ask one robot's predictor every question; returns one entry per predicted robot, in team order.

    Raises:
        ConfigError: if the predictor cannot look as far as a control step, or its times fall between them.
    """
    horizon, times = _reach(predictor, agent, questions[0])
    steps = _control_steps(times)
    distances: list[Tensor] = []
    stds: list[Tensor] = []
    for question in questions:
        for part, imagined in _ask(predictor, agent, question, horizon):
            truth = question.future[part][:, steps - 1]
            distances.append((imagined.poses[:, 0, : len(steps), :, :2] - truth).norm(dim=-1))
            if imagined.std is not None:
                stds.append(imagined.std[:, 0, : len(steps)])
    distance, std = torch.cat(distances), torch.cat(stds) if stds else None
    trajectory = torch.arange(len(questions[0].goals), dtype=torch.float32).repeat(len(questions))
    return [
        Misses(times, distance[..., robot], None if std is None else std[..., robot], trajectory)
        for robot in range(distance.shape[-1])
    ]


def _ask(
    predictor: Predictor, agent: int, question: Question, horizon: int
) -> Iterator[tuple[slice, Trajectories]]:
    seen = question.observations[agent]
    for first in range(0, len(question.goals), SLICE):
        part = slice(first, first + SLICE)
        yield part, predictor.rollout(seen.episodes(part), question.goals[part, None], horizon)


def _reach(predictor: Predictor, agent: int, question: Question) -> tuple[int, Float[Tensor, "t"]]:
    """Return the longest horizon that a predictor takes, and its times that lie in the known future."""
    seen, goals = question.observations[agent].episodes(slice(0, 1)), question.goals[:1, None]
    seconds = question.future.shape[1] * CONTROL_PERIOD + 1e-3
    step = float(predictor.rollout(seen, goals, 1).times[0])
    for horizon in range(max(1, int(seconds / step)), 0, -1):
        try:
            times = predictor.rollout(seen, goals, horizon).times
        except ConfigError:
            continue  # farther than it looks
        if bool((times <= seconds).any()):
            return horizon, times[times <= seconds]
    raise ConfigError(f"the predictor's first step is {step:g} s long; ask for more --seconds than that.")


def _control_steps(times: Float[Tensor, "t"]) -> Tensor:
    steps = (times / CONTROL_PERIOD).round()
    if (steps * CONTROL_PERIOD - times).abs().max() > 1e-3:
        raise ConfigError(f"predicted times must be multiples of {CONTROL_PERIOD:g} s, got {times.tolist()}.")
    return steps.long()
