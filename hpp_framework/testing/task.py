"""``check_task``: whether reward and success agree, and take whatever planners and evaluations ask."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.task import Task
from hpp_framework.testing.build import BUILD, Source, build, find_source
from hpp_framework.testing.purity import check_pure, check_rows, check_tensor
from hpp_framework.testing.report import Report, Rule
from hpp_framework.testing.scene import find_robots, first
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.seeding import torch_rng

SUSTAIN = Rule(
    name="sustain-steps",
    why="success() must hold so many control steps on end; 0 or less is success before anything happened.",
    fix="sustain_steps: int = 5, at least 1.",
)
RADIUS = Rule(
    name="radius",
    why="figures draw it, and lower bounds of the time are worked out from it.",
    fix="a positive number of metres, or radius = None where the objective is no distance from the "
    "team's centre.",
)
CONSTANT = Rule(
    name="reward-constant",
    why="planners compare imagined rewards; where all are equal they choose blindly.",
    fix="a reward that grows as the team comes nearer to the objective, e.g. minus a distance.",
)
MISLEADS = Rule(
    name="reward-misleads",
    why="the reward is followed, success() is judged: a team that does what the reward says would never "
    "succeed.",
    fix="a reward that is highest exactly where success() holds; higher is better, so distances count "
    "negative.",
)
WITHOUT_CONTACT = Rule(
    name="success-without-contact",
    why="first contact, success(poses), comes before success(poses, velocities); figures and times rely on "
    "it.",
    fix="near = ...; return near if velocities is None else near & (whatever motion allows).",
)
NEVER_SUCCEEDS = Rule(
    name="never-succeeds",
    why="no episode could succeed.",
    fix="a success() that holds with velocities of 0 where it holds without velocities.",
)
SUCCESS_DRIVING = Rule(
    name="success-driving",
    why="a team that races past each other would count as a success.",
    fix="& (relative_speed(poses, velocities) < 0.1) where velocities are told, or halts = False for an "
    "objective in motion.",
)
HEADING_WRAP = Rule(
    name="heading-wrap",
    why="headings wrap at pi: the same pose comes as theta and as theta + 2*pi.",
    fix="sines and cosines of headings, or geometry.wrap_angle(difference).",
)
NAN_HEADING = Rule(
    name="nan-heading",
    why="some predictors, the default one too, foresee positions without headings, which are NaN then; a NaN "
    "reward makes the planner choose blindly.",
    fix="terms that leave headings out where they are NaN: torch.where(heading.isnan(), 0.0, term).",
)
RULES = (
    SUSTAIN, RADIUS, CONSTANT, MISLEADS, WITHOUT_CONTACT, NEVER_SUCCEEDS, SUCCESS_DRIVING, HEADING_WRAP,
    NAN_HEADING,
)  # fmt: skip

SIGNATURE = "(robots: Sequence[RobotSpec]) -> Task"
SIZES = (2, 3, 4)
"""Teams that a task is built for; one that wants more robots says so by ConfigError."""
SPREAD = 5.0
"""Metres around the origin in which the search begins."""
RESTARTS, CROWD, PARENTS, ROUNDS = 4, 200, 20, 40


def check_task(
    task: str | Task | Callable[[Sequence[RobotSpec]], Task], *, robots: Sequence[RobotSpec] | None = None
) -> None:
    """Check a task by questions, and by a search for the poses that its reward leads to.

    Args:
        task: registered name, factory or object.
        robots: team that it is built for; None for two robots, or three or four if it asks for more.

    Raises:
        CheckError: if anything is wrong; holds everything that was found.
        UnknownNameError: if nothing has that name.
    """
    source, report = find_source("task", task, Task)
    made, count = _build(source, report, robots)
    if made is not None:
        _check_attributes(report, made)
        rng = torch_rng(0, "checks", "task")
        if _check_answers(report, made, count, rng):
            _check_headings(report, made, count, rng)
            with report.guarded("reward()", "following the reward"):
                _check_agreement(report, made, count, rng)
    report.finish()


def _build(source: Source, report: Report, robots: Sequence[RobotSpec] | None) -> tuple[Task | None, int]:
    if source.factory is None:
        return source.made, 2 if robots is None else len(robots)
    teams = [first(find_robots(source.distribution), size) for size in SIZES] if robots is None else [robots]
    refused = ""
    for team in teams:
        try:
            source.factory(list(team))
        except ConfigError as error:
            # this one wants another number of robots
            refused = refused or str(error)
            continue
        except Exception:
            # said by what follows
            refused = ""
        return build(source, report, (list(team),), Task, SIGNATURE), len(team)
    report.add(BUILD, "the factory", f"refuses every team that was tried: {refused}")
    return None, 0


def _check_attributes(report: Report, task: Task) -> None:
    # plugins are not always typed
    steps: Any = task.sustain_steps
    radius: Any = task.radius
    report.require(
        isinstance(steps, int) and steps >= 1,
        SUSTAIN,
        "sustain_steps",
        f"is {steps!r}; it must be 1 or more.",
    )
    fine = radius is None or (isinstance(radius, int | float) and math.isfinite(radius) and radius > 0)
    report.require(fine, RADIUS, "radius", f"is {radius!r}.")


def _random(rng: torch.Generator, *shape: int) -> Float[Tensor, "*b 3"]:
    spread = torch.tensor([2 * SPREAD, 2 * SPREAD, 2 * math.pi])
    return (torch.rand(*shape, 3, generator=rng) - 0.5) * spread


@torch.no_grad()
def _check_answers(report: Report, task: Task, count: int, rng: torch.Generator) -> bool:
    """Check shapes, purity and batches of all functions; return whether they can be computed with."""
    poses, others = _random(rng, 4, count), _random(rng, 6, count)
    still = torch.zeros(4, count, 2)
    calls: dict[str, tuple[Callable[[Any, Any], Any], torch.dtype]] = {
        "reward()": (lambda at, _: task.reward(at), torch.float32),
        "success(poses)": (lambda at, _: task.success(at), torch.bool),
        "success()": (task.success, torch.bool),
    }
    fine = True
    for of, (call, dtype) in calls.items():
        answer = check_pure(
            report, of, lambda call=call: call(poses, still), (poses, still),
            lambda call=call: call(others, torch.ones(6, count, 2)),
        )  # fmt: skip
        if answer is None or not check_tensor(report, of, answer, (4,), "(episodes,)", dtype=dtype):
            fine = False
            continue
        check_rows(
            report, of, answer,
            lambda row, call=call: call(poses[row : row + 1], still[row : row + 1]), (0, 3), 1e-3,
        )  # fmt: skip
        deep = poses.reshape(2, 2, 1, count, 3).expand(2, 2, 3, count, 3)
        with report.guarded(of, "for poses with three leading dimensions"):
            answer = call(deep, torch.zeros(2, 2, 3, count, 2))
            fine &= check_tensor(
                report, f"{of} of poses (2, 2, 3, {count}, 3)", answer, (2, 2, 3), "all but the last two",
                dtype=dtype,
            )  # fmt: skip
    with report.guarded("trajectory_reward()"):
        value = task.trajectory_reward(_random(rng, 4, 5, count))
        check_tensor(report, "trajectory_reward()", value, (4,), "(episodes,), the times summed up")
    _check_targets(report, task, poses)
    return fine


def _check_targets(report: Report, task: Task, poses: Float[Tensor, "b n 3"]) -> None:
    goals = poses[:, 0, :2] + 1.0
    targets = check_pure(report, "targets()", lambda: task.targets(goals, poses), (), lent=(goals, poses))
    if targets is not None:
        shape, meaning = tuple(poses.shape), "(episodes, robots, [x, y, heading])"
        # a heading is NaN where any will do
        if check_tensor(report, "targets()", targets, shape, meaning, finite=False):
            check_tensor(report, "targets()", targets[..., :2], (*shape[:2], 2), "places")


@torch.no_grad()
def _check_headings(report: Report, task: Task, count: int, rng: torch.Generator) -> None:
    """Check rare poses: all in one spot, far away, turned by 2 pi, without headings."""
    poses = _random(rng, 64, count)
    corners = {
        "with all robots in one place": torch.zeros(2, count, 3),
        "a kilometre away": poses[:2] + torch.tensor([1e3, 1e3, 0.0]),
    }
    for when, at in corners.items():
        with report.guarded(f"reward() {when}"):
            check_tensor(report, f"reward() {when}", task.reward(at), (2,), "(episodes,)")
    with report.guarded("reward()", "for a heading turned by 2 pi"):
        turned = poses.clone()
        turned[:, 0, 2] += 2 * math.pi
        reward = task.reward(poses)
        apart = float((reward - task.reward(turned)).abs().max())
        report.require(
            apart <= 1e-3 * (1 + float(reward.abs().max())), HEADING_WRAP, "reward()",
            f"changes by up to {apart:.3g} when robot 0's heading is turned by 2 pi.",
        )  # fmt: skip
    blind = poses.clone()
    blind[..., 2] = math.nan
    with report.guarded("reward()", "for poses without headings"):
        bad = int(task.reward(blind).isnan().sum())
        report.require(bad == 0, NAN_HEADING, "reward()", f"is NaN for {bad} of 64 poses without headings.")


@torch.no_grad()
def _check_agreement(report: Report, task: Task, count: int, rng: torch.Generator) -> None:
    """Follow the reward from several starts, and compare where it leads with what success() says."""
    everywhere = _random(rng, 1024, count)
    rewards = task.reward(everywhere)
    if float(rewards.max() - rewards.min()) == 0:
        report.add(
            CONSTANT, "reward()", f"is {float(rewards[0]):g} for each of {len(rewards)} random team poses."
        )
    crowd = climb(task, count, rng)
    flat = crowd.flatten(0, 1)
    found, reward = task.success(flat), task.reward(flat)
    best = crowd[:, 0]
    if not bool(task.success(best).any()):
        report.add(
            MISLEADS, "reward()",
            f"leads to {[[round(v, 1) for v in p] for p in best[0].tolist()]} with a reward of "
            f"{float(reward.max()):.3g}, where success() is false, and to nothing better from {RESTARTS} "
            "starts.",
        )  # fmt: skip
    _check_done(report, task, torch.cat([everywhere, flat]), flat[found], rng)


def _check_done(
    report: Report,
    task: Task,
    poses: Float[Tensor, "b n 3"],
    met: Float[Tensor, "m n 3"],
    rng: torch.Generator,
) -> None:
    done = task.success(poses, torch.zeros_like(poses[..., :2]))
    wrong = int((done & ~task.success(poses)).sum())
    report.require(
        wrong == 0, WITHOUT_CONTACT, "success()",
        f"holds at rest for {wrong} of {len(poses)} team poses, but not without velocities.",
    )  # fmt: skip
    if len(met) == 0:
        return
    at_rest = task.success(met, torch.zeros_like(met[..., :2]))
    if not report.require(
        bool(at_rest.any()),
        NEVER_SUCCEEDS,
        "success()",
        f"is false at rest for all of {len(met)} team poses.",
    ):
        return
    # every robot at 1 to 2 m/s, to and fro
    speed = 1 + torch.rand(*met.shape[:-1], 2, generator=rng)
    driving = task.success(met, speed * (2.0 * torch.randint(0, 2, speed.shape, generator=rng) - 1))
    if task.halts and bool(driving[at_rest].all()):
        report.add(
            SUCCESS_DRIVING,
            "success()",
            f"holds for all of {int(at_rest.sum())} fulfilled team poses at 1 to 2 m/s and rad/s.",
        )


def climb(task: Task, count: int, rng: torch.Generator) -> Float[Tensor, "s c n 3"]:
    """Return team poses that a search for reward ends with, from several starts, best first.

    Args:
        task: whose reward is followed.
        count: robots.
        rng: of the search.
    """
    crowd = _random(rng, RESTARTS, CROWD, count)
    rows = torch.arange(RESTARTS)[:, None]
    for width in torch.logspace(math.log10(2.0), math.log10(0.02), ROUNDS).tolist():
        order = task.reward(crowd).nan_to_num(nan=-math.inf).argsort(1, descending=True)
        parents = crowd[rows, order[:, :PARENTS]]
        chosen = torch.randint(0, PARENTS, (RESTARTS, CROWD - PARENTS), generator=rng)
        children = parents[rows, chosen]
        children = children + width * torch.randn(children.shape, generator=rng)
        crowd = torch.cat([parents, children], 1)
    order = task.reward(crowd).nan_to_num(nan=-math.inf).argsort(1, descending=True)
    return crowd[rows, order]
