"""``check_skill``: whether a skill drives a robot to goals, and is a pure function of what it is given."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.skill import Skill
from hpp_framework.core.team import Member, Team
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import Observation
from hpp_framework.core.world import World
from hpp_framework.episodes.core import EpisodeBatch
from hpp_framework.plugins.registry import hub
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.testing.build import WEIGHTS, Source, build, find_source
from hpp_framework.testing.purity import check_pure, check_rows, check_tensor
from hpp_framework.testing.report import Report, Rule
from hpp_framework.testing.scene import EPISODES, find_robots, make_scene
from hpp_framework.utils.errors import CheckpointError

LIMITS = Rule(
    name="beyond-limits",
    why="the drive clips such commands: the robot does not do what was decided, and predictors learn "
    "it wrongly.",
    fix="command.clamp to robot.drive.speed and to -turn_rate..turn_rate (rad/s) of the robot given to "
    "the factory.",
)
GOAL_IGNORED = Rule(
    name="goal-ignored",
    why="planners steer a robot by its goal alone; they would have no influence.",
    fix="commands from geometry.polar(observation.pose, goal): distance and bearing of the goal, seen "
    "from the robot.",
)
NO_PROGRESS = Rule(
    name="no-progress",
    why="in open space nothing is in its way; a skill that does not arrive there arrives nowhere.",
    fix="commands that turn towards the goal (positive omega for a goal to the left) and drive; poses "
    "are those "
    "of robot observation.agent, not [0]; angles in radians, goals in world coordinates.",
)
DRIVES_ON = Rule(
    name="drives-on",
    why="tasks are fulfilled at rest; a robot that passes its goal never stays where it was sent.",
    fix="zero speed near the goal (within some 0.2 m), and slowing down in time: v <= sqrt(2 * a * "
    "distance).",
)
RULES = (LIMITS, GOAL_IGNORED, NO_PROGRESS, DRIVES_ON)

SIGNATURE = "(robot: RobotSpec) -> Skill"
MEANING = "(episodes, [v in m/s, omega in rad/s])"
AGENT = 1
"""The robot that is driven: a skill that reads the poses of robot 0 drives by the wrong ones."""
DIRECTIONS = {"ahead": 0.0, "left": math.pi / 2, "behind": math.pi, "right": -math.pi / 2}
FAR = 2.5
"""Metres to the goals of the episode."""
OPEN = World(name="open", bounds=(-50.0, -50.0, 50.0, 50.0), walled=False)
EXACT, ROUNDED = 1e-3, 2e-3
"""Largest excess over a limit, and difference between a batch and its members, in m/s and rad/s."""


def check_skill(
    skill: str | Skill | Callable[[RobotSpec], Skill], *, robot: str | RobotSpec | None = None
) -> None:
    """Check a skill by questions, and by an episode in open space in the batch simulator.

    Args:
        skill: registered name, factory or object.
        robot: to drive; None for the first that the skill can be built for, of its own distribution first.

    Raises:
        CheckError: if anything is wrong; holds everything that was found.
        UnknownNameError: if nothing has that name.
    """
    source, report = find_source("skill", skill, Skill)
    spec, made = _build(source, report, robot)
    if made is not None and spec is not None:
        team = Team(tuple(Member(id=name, robot=spec, skill="") for name in ("other", "driven")))
        observation = make_scene(team).observations[AGENT]
        if _check_questions(report, made, observation, spec):
            with report.guarded("act()", "in an episode in open space"):
                _check_episode(report, made, spec)
    report.finish()


def _build(
    source: Source, report: Report, robot: str | RobotSpec | None
) -> tuple[RobotSpec | None, Skill | None]:
    if robot is None:
        candidates = find_robots(source.distribution)
    else:
        candidates = iter([hub().robots.create(robot) if isinstance(robot, str) else robot])
    missing = ""
    for spec in candidates:
        try:
            return spec, build(source, report, (spec,), Skill, SIGNATURE)
        except CheckpointError as error:
            missing = missing or str(error)
    report.add(WEIGHTS, "the factory", f"finds no weights: {missing}")
    return None, None


@torch.no_grad()
def _check_questions(report: Report, skill: Skill, seen: Observation, robot: RobotSpec) -> bool:
    near = seen.pose[:, :2] + torch.tensor([1.5, 0.5])
    far = seen.pose[:, :2] - torch.tensor([1.0, 4.0])
    command: Any = check_pure(
        report, "act()", lambda: skill.act(seen, near), (seen, near), lambda: skill.act(seen, far)
    )
    if report.findings and command is None:
        return False
    if not check_tensor(report, "act()", command, (EPISODES, 2), MEANING):
        return False
    _check_limits(report, command, robot)
    check_rows(
        report, "act()", command,
        lambda row: skill.act(seen.episodes(slice(row, row + 1)), near[row : row + 1]),
        (0, EPISODES - 1), ROUNDED,
    )  # fmt: skip
    _check_corners(report, skill, seen, robot)
    around = [seen.pose[:, :2] + FAR * torch.tensor([math.cos(a), math.sin(a)]) for a in DIRECTIONS.values()]
    with report.guarded("act()", "for goals all around"):
        answers = [skill.act(seen, goal).clone() for goal in around]
        report.require(
            any(not torch.equal(answers[0], other) for other in answers[1:]), GOAL_IGNORED, "act()",
            f"commands {command[0].tolist()} for goals in all directions.",
        )  # fmt: skip
    return True


def _check_limits(report: Report, command: Tensor, robot: RobotSpec) -> None:
    (low, high), turn = robot.drive.speed, robot.drive.turn_rate
    speed, rate = command[:, 0], command[:, 1].abs()
    report.require(
        bool((speed >= low - EXACT).all() and (speed <= high + EXACT).all() and (rate <= turn + EXACT).all()),
        LIMITS, "act()",
        f"commands up to {float(speed.min()):.3g} .. {float(speed.max()):.3g} m/s and "
        f"{float(rate.max()):.3g} rad/s; "
        f"{robot.name} does {low:g} .. {high:g} m/s and {turn:g} rad/s.",
    )  # fmt: skip


def _check_corners(report: Report, skill: Skill, seen: Observation, robot: RobotSpec) -> None:
    """Ask what is rare: a goal right under the robot, nothing seen at all, everything right before it."""
    here = seen.pose[:, :2].clone()
    there = here + FAR
    cases = {
        "for a goal at the robot's own place": (seen, here),
        "where the lidar sees nothing": (_with_scans(seen, robot.lidar.max_range), there),
        "where the lidar sees everything at its least range": (
            _with_scans(seen, robot.lidar.min_range),
            there,
        ),
    }
    for when, (observation, goal) in cases.items():
        failed = len(report.findings)
        command: Any = None
        with report.guarded(f"act() {when}"):
            command = skill.act(observation, goal)
        if len(report.findings) > failed:
            continue
        if check_tensor(report, f"act() {when}", command, (EPISODES, 2), MEANING):
            _check_limits(report, command, robot)


def _with_scans(seen: Observation, distance: float) -> Observation:
    keyframes = seen.keyframes and replace(
        seen.keyframes, scans=torch.full_like(seen.keyframes.scans, distance)
    )
    return replace(seen, scans=torch.full_like(seen.scans, distance), keyframes=keyframes)


@torch.no_grad()
def _check_episode(report: Report, skill: Skill, robot: RobotSpec) -> None:
    """Drive to goals ahead, left, behind and right, another robot standing far away."""
    heading = torch.tensor([0.3, 1.9, -1.2, 3.0])
    direction = heading + torch.tensor(list(DIRECTIONS.values()))
    place = torch.tensor([[1.0, -2.0]]).expand(len(DIRECTIONS), -1)
    goal = place + FAR * torch.stack([direction.cos(), direction.sin()], -1)
    driven = torch.cat([place, heading[:, None]], -1)
    parked = torch.tensor([[30.0, 30.0, 0.0]]).expand(len(DIRECTIONS), -1)
    seconds = 6 + 3 * FAR / robot.drive.speed[1] + 2 * math.pi / robot.drive.turn_rate
    nearest = torch.full((len(DIRECTIONS),), math.inf)
    left = nearest
    with BatchSimulator([robot, robot], threads=1) as simulator:
        batch = EpisodeBatch(simulator)
        batch.begin([OPEN] * len(DIRECTIONS), torch.stack([parked, driven], 1), range(len(DIRECTIONS)))
        for _ in range(min(round(seconds / CONTROL_PERIOD), 400)):
            command = skill.act(batch.observe(AGENT), goal)
            state = batch.step(torch.stack([torch.zeros_like(command), command], 1))
            left = (state.poses[:, AGENT, :2] - goal).norm(dim=-1)
            nearest = torch.minimum(nearest, left)
    shown = ", ".join(f"{name} {float(d):.1f} m" for name, d in zip(DIRECTIONS, left, strict=True))
    if bool((nearest > 0.5 * FAR).any()):
        report.add(
            NO_PROGRESS, "act()",
            f"leaves {robot.name} after {seconds:.0f} s at these distances from goals {FAR} m away: {shown}.",
        )  # fmt: skip
    elif bool(((left > 1.0) & (left > nearest + 0.5)).any()):
        report.add(DRIVES_ON, "act()", f"is away from its goals again after {seconds:.0f} s: {shown}.")
