"""``check_predictor``: whether imagined motion begins now, moves on in time, and keeps its shapes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from hpp_framework.core.predictor import Predictor, PredictorRequest
from hpp_framework.core.team import Team
from hpp_framework.core.types import Observation, Trajectories
from hpp_framework.plugins.build import parse_team
from hpp_framework.testing.build import WEIGHTS, Source, build, find_source
from hpp_framework.testing.purity import DTYPE, NOT_FINITE, SHAPE, check_pure, check_rows, gap, tensors
from hpp_framework.testing.report import Report, Rule
from hpp_framework.testing.scene import EPISODES, find_teams, make_scene
from hpp_framework.utils.errors import CheckpointError
from hpp_framework.utils.seeding import torch_rng

TIMES = Rule(
    name="times",
    why="rewards are averaged over the times, and plans are matched with what happened at them.",
    fix="Trajectories.times (horizon,): seconds ahead of now, the first above 0, increasing, e.g. "
    "torch.arange(1, horizon + 1) * 0.2.",
)
HORIZON = Rule(
    name="horizon",
    why="planners say how far they want to look ahead, and pay for it.",
    fix="one predicted pose for each of the horizon steps, whatever horizon is asked for.",
)
JUMPS = Rule(
    name="jumps",
    why="imagined motion must begin where robots are, in world coordinates; otherwise every score is about "
    "another place.",
    fix="poses in the world frame: observation.team_poses plus the predicted change (geometry.compose "
    "if it is in "
    "a robot's frame), times in seconds.",
)
STD = Rule(
    name="std",
    why="planners divide by it and take its logarithm.",
    fix="a standard deviation in metres, (episodes, goals, times, robots), above 0; None if there is none.",
)
GOAL_ORDER = Rule(
    name="goal-order",
    why="candidates of a search are independent questions in no particular order.",
    fix="the same computation for every goal: nothing along the dimension of goals but broadcasting.",
)
CONDITION = Rule(
    name="condition",
    why="planners search by condition(); evaluations and figures ask rollout(): both must imagine the same.",
    fix="condition() that only computes in advance what does not depend on the goals; leave it out at first.",
)
AGENT = Rule(
    name="agent",
    why="every robot of a team predicts from its own view.",
    fix="PredictorRequest.agent and observation.agent wherever the predicting robot is meant, never index 0.",
)
RULES = (TIMES, HORIZON, JUMPS, STD, GOAL_ORDER, CONDITION, AGENT)

SIGNATURE = "(request: PredictorRequest) -> Predictor"
GOALS, STEPS = 5, 3
ROUNDED = 2e-3
"""Metres by which rounding may change a prediction."""
LATE = 60.0
"""Seconds after which a first time is one in milliseconds, in all likelihood."""
SLACK = 0.6
"""Metres that a step may lead farther than 1.5 times what the drive allows: learned models err."""


def check_predictor(
    predictor: str | Predictor | Callable[[PredictorRequest], Predictor], *, team: str | Team | None = None
) -> None:
    """Check a predictor by questions about a team in a room.

    Args:
        predictor: registered name, factory or object.
        team: that is predicted, e.g. ``"rover,rover"``; None for the first pair that it can be built for.

    Raises:
        CheckError: if anything is wrong; holds everything that was found.
        UnknownNameError: if nothing has that name.
    """
    source, report = find_source("predictor", predictor, Predictor)
    known, made = _build(source, report, team)
    if known is not None and made is not None:
        scene = make_scene(known)
        _check_rollout(report, made, scene.observations[0], known)
        if source.factory is not None and len(known) > 1:
            with report.guarded("the predictor of robot 1", rule=AGENT):
                other: Predictor = source.factory(PredictorRequest(team=known, agent=1))
                _check_shape(
                    report, other.rollout(scene.observations[1], _goals(scene.observations[1]), STEPS),
                    "the predictor of robot 1: rollout()", len(known), STEPS,
                )  # fmt: skip
    report.finish()


def _build(source: Source, report: Report, team: str | Team | None) -> tuple[Team | None, Predictor | None]:
    if team is None:
        candidates = find_teams(source.distribution)
    else:
        candidates = iter([parse_team(team) if isinstance(team, str) else team])
    missing = ""
    for known in candidates:
        try:
            request = PredictorRequest(team=known, agent=0)
            return known, build(source, report, (request,), Predictor, SIGNATURE)
        except CheckpointError as error:
            missing = missing or str(error)
    report.add(WEIGHTS, "the factory", f"finds no weights: {missing}")
    return None, None


def _goals(seen: Observation) -> Tensor:
    around = 6 * torch.rand(len(seen.poses), GOALS, 2, generator=torch_rng(0, "checks", "goals")) - 3
    return seen.pose[:, None, :2] + around


@torch.no_grad()
def _check_rollout(report: Report, model: Predictor, seen: Observation, team: Team) -> None:
    goals = _goals(seen)
    other = goals.flip(0) + 0.5
    answer: Any = check_pure(
        report, "rollout()", lambda: model.rollout(seen, goals, STEPS), (seen, goals),
        lambda: model.rollout(seen, other, STEPS),
    )  # fmt: skip
    if answer is None or not _check_shape(report, answer, "rollout()", len(team), STEPS):
        return
    check_rows(
        report, "rollout()", _timeless(answer),
        lambda row: _timeless(
            model.rollout(seen.episodes(slice(row, row + 1)), goals[row : row + 1], STEPS)
        ),
        (0, EPISODES - 1), ROUNDED,
    )  # fmt: skip
    _check_motion(report, answer, seen, team)
    with report.guarded("rollout()", "for another horizon"):
        longer = model.rollout(seen, goals, STEPS + 2)
        report.require(
            longer.poses.shape[2] == STEPS + 2, HORIZON, "rollout()",
            f"returned {longer.poses.shape[2]} times for a horizon of {STEPS + 2}.",
        )  # fmt: skip
    first = [each.clone() for each in tensors(_timeless(answer))]
    with report.guarded("rollout()", "for goals in another order"):
        turned = [each.flip(1) for each in tensors(_timeless(model.rollout(seen, goals.flip(1), STEPS)))]
        apart = gap(first, turned)
        report.require(
            apart <= ROUNDED, GOAL_ORDER, "rollout()",
            f"answers goals in another order otherwise, by up to {apart:.3g} m.",
        )  # fmt: skip
    with report.guarded("condition()", rule=CONDITION):
        apart = gap(first, list(tensors(_timeless(model.condition(seen, STEPS)(goals)))))
        report.require(
            apart <= ROUNDED,
            CONDITION,
            "condition()",
            f"imagines otherwise than rollout(), by up to {apart:.3g}.",
        )


def _timeless(answer: Trajectories) -> tuple[Tensor | None, ...]:
    return answer.poses[..., :2], answer.std


def _check_shape(report: Report, answer: Any, of: str, robots: int, steps: int) -> bool:
    if not isinstance(answer, Trajectories):
        report.add(SHAPE, of, f"returned {type(answer).__name__}, not Trajectories(poses, times, std).")
        return False
    expected = (EPISODES, GOALS, steps, robots, 3)
    shape = tuple(answer.poses.shape)
    if len(shape) == 5 and shape[2] != steps and shape[:2] == expected[:2]:
        report.add(HORIZON, of, f"returned {shape[2]} times for a horizon of {steps}.")
        return False
    if not report.require(
        shape == expected, SHAPE, of,
        f"has poses of shape {shape}, not {expected}, (episodes, goals, times, robots, [x, y, heading]).",
    ):  # fmt: skip
        return False
    report.require(answer.poses.dtype == torch.float32, DTYPE, of, f"has poses of type {answer.poses.dtype}.")
    bad = int((~torch.isfinite(answer.poses[..., :2])).sum())
    report.require(bad == 0, NOT_FINITE, of, f"has {bad} coordinates that are NaN or infinite.")
    times = answer.times
    if tuple(times.shape) != (steps,) or not bool((times.diff() > 0).all()) or not 0 < float(times[0]) < LATE:
        report.add(TIMES, of, f"has times {times.tolist()} for {steps} steps.")
        return False
    return bad == 0


def _check_motion(report: Report, answer: Trajectories, seen: Observation, team: Team) -> None:
    start = seen.team_poses[:, None, None, :, :2].expand(-1, GOALS, 1, -1, -1)
    steps = torch.cat([start, answer.poses[..., :2]], 2).diff(dim=2).norm(dim=-1)
    seconds = torch.cat([torch.zeros(1), answer.times.to(steps)]).diff()
    top = torch.tensor([max(map(abs, robot.drive.speed)) for robot in team.robots])
    excess = steps - 1.5 * seconds[:, None] * top - SLACK
    if bool((excess > 0).any()):
        time, robot = torch.nonzero(excess.amax((0, 1)) > 0)[0].tolist()
        report.add(
            JUMPS, "rollout()",
            f"moves robot {robot} by {float(steps[..., time, robot].max()):.2f} m between time {time} and "
            f"{time + 1} ({float(seconds[time]):.2f} s; time 0 is now), at a top speed of "
            f"{float(top[robot]):g} m/s.",
        )  # fmt: skip
    if answer.std is None:
        return
    if tuple(answer.std.shape) != tuple(answer.poses.shape[:-1]) or not bool((answer.std > 0).all()):
        report.add(
            STD, "rollout()",
            f"has std of shape {tuple(answer.std.shape)} from {float(answer.std.min()):.3g} m on.",
        )  # fmt: skip
