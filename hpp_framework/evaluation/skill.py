"""How well a skill reaches goals in worlds it has not seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from hpp_framework.config.sensing_choice import make_estimators, parse_disturbances
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.skill import Skill
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.episodes.core import EpisodeBatch
from hpp_framework.evaluation.navigation_tasks import NavigationTasks, Progress, draw_navigation_tasks
from hpp_framework.evaluation.skill_score import SkillRow, SkillScore, score
from hpp_framework.evaluation.trial import ARRIVAL, Trial
from hpp_framework.plugins.builtin import DEFAULT_WORLD, UNDISTURBED
from hpp_framework.sim import make_simulator
from hpp_framework.sim.simulator import Simulator
from hpp_framework.utils.seeding import child_seed

CHUNK = {"batch": 250, "sapien": 10}
"""Episodes that run side by side."""
FREEZE_SECONDS, FREEZE_METRES = 5.0, 0.25
"""A failed robot froze if it got less far than this in its last seconds."""


@dataclass(frozen=True)
class Drives:
    """Outcomes of navigation tasks.

    Attributes:
        done: control step at which an episode succeeded, -1 for failures.
        collided: whether it touched anything, before it succeeded if it did.
        driven: path until success or the end, metres.
        left: distance to the goal then, metres.
        moved: net distance of the last 5 s, metres.
    """

    done: Int[Tensor, "b"]
    collided: Bool[Tensor, "b"]
    driven: Float[Tensor, "b"]
    left: Float[Tensor, "b"]
    moved: Float[Tensor, "b"]


def evaluate_skill(
    skill: Skill,
    robot: RobotSpec,
    *,
    world: str = DEFAULT_WORLD,
    episodes: int = 500,
    goal_distance: tuple[float, float] = (5.0, 10.0),
    clearance: float = 0.15,
    steps: int = 200,
    disturbances: str = UNDISTURBED,
    estimator: str = "none",
    backend: str = "batch",
    seed: int = 0,
) -> SkillScore:
    """Drive one robot to one reachable goal an episode, each episode in a world of its own.

    :func:`skill_episodes` does the same and returns the single episodes; :func:`score` sums them up.

    Args:
        skill: what drives.
        robot: what it drives.
        world: registered world or world file.
        episodes: how many.
        goal_distance: nearest and farthest goal, straight line, in metres.
        clearance: gap between the footprint and obstacles at start and goal and on some path, in metres.
        steps: control steps before an episode counts as failed (200 are 40 s).
        disturbances: of sensing and acting: a profile, with settings or without.
        estimator: registered estimator, with settings or without.
        backend: ``"batch"`` or ``"sapien"``.
        seed: of worlds, starts, goals and disturbances.

    Raises:
        HppError: if the world or backend is unknown, or a world has no goal at the distance asked for.
    """
    trial = Trial(
        world=world, episodes=episodes, goal_distance=goal_distance, clearance=clearance, steps=steps,
        disturbances=disturbances, estimator=estimator, backend=backend, seed=seed,
    )  # fmt: skip
    return score(skill_episodes(skill, robot, trial))


def skill_episodes(
    skill: Skill,
    robot: RobotSpec,
    trial: Trial,
    *,
    name: str = "",
    tasks: NavigationTasks | None = None,
    progress: Progress = lambda _: None,
) -> list[SkillRow]:
    """Drive the navigation tasks of a trial and return one row per episode.

    Args:
        skill: what drives.
        robot: what it drives.
        trial: where, and under what disturbances.
        name: of the skill in the rows.
        tasks: of this trial, drawn before; or None to draw them.
        progress: called with the number of episodes driven, those under way in part.

    Raises:
        HppError: if the trial cannot be had, see :func:`draw_navigation_tasks` and
            :func:`hpp_framework.sim.make_simulator`.
    """
    rows: list[SkillRow] = []
    with make_simulator(trial.backend, [robot]) as simulator:
        known = tasks or draw_navigation_tasks(robot, trial)
        chunk = CHUNK[trial.backend]
        for first in range(0, len(known), chunk):
            wanted = slice(first, min(first + chunk, len(known)))
            size = wanted.stop - first

            def report(step: int, first: int = first, size: int = size) -> None:
                progress(first + size * step // trial.steps)

            drives = drive_tasks(skill, simulator, known, wanted, trial, progress=report)
            rows += _rows(name, trial.world, known, wanted, drives)
            progress(wanted.stop)
    return rows


@torch.no_grad()
def drive_tasks(
    skill: Skill,
    simulator: Simulator,
    tasks: NavigationTasks,
    wanted: slice,
    trial: Trial,
    *,
    progress: Progress = lambda _: None,
) -> Drives:
    """Drive some navigation tasks side by side, until all have succeeded or the trial's steps are over.

    Args:
        skill: what drives.
        simulator: of one robot.
        tasks: all of them.
        wanted: which.
        trial: steps, disturbances and seed.
        progress: called with the number of steps done.
    """
    goal = tasks.goals[wanted]
    disturbances = [parse_disturbances(trial.disturbances)]
    estimators = make_estimators(trial.estimator, simulator.robots, disturbances)
    batch = EpisodeBatch(simulator, disturbances=disturbances, estimators=estimators, keyframes=0)
    seeds = [child_seed(trial.seed, trial.world, number) for number in range(wanted.start, wanted.stop)]
    batch.begin(tasks.worlds[wanted], tasks.poses[wanted], seeds)
    done = torch.full((len(goal),), -1)
    dwelt = torch.zeros(len(goal), dtype=torch.int64)
    touched = torch.zeros(len(goal), dtype=torch.bool)
    places = [batch.state.poses[:, 0, :2].clone()]
    for step in range(1, trial.steps + 1):
        state = batch.step(skill.act(batch.observe(0), goal)[:, None])
        places.append(state.poses[:, 0, :2].clone())
        touched |= state.collided[:, 0] & (done < 0)
        near = (places[-1] - goal).norm(dim=1) < ARRIVAL.goal_radius
        resting = state.velocities[:, 0, 0].abs() < ARRIVAL.rest_speed
        dwelt = torch.where(near & resting, dwelt + 1, 0)
        done = torch.where((done < 0) & (dwelt >= ARRIVAL.dwell), step, done)
        progress(step)
        if bool((done >= 0).all()):
            break
    return _drives(torch.stack(places, 1), goal, done, touched)


def _drives(
    places: Float[Tensor, "b t 2"],
    goal: Float[Tensor, "b 2"],
    done: Int[Tensor, "b"],
    touched: Bool[Tensor, "b"],
) -> Drives:
    rows = torch.arange(len(goal))
    end = torch.where(done >= 0, done, places.shape[1] - 1)
    before = (end - round(FREEZE_SECONDS / CONTROL_PERIOD)).clamp(min=0)
    driven = places.diff(dim=1).norm(dim=-1).cumsum(1)
    return Drives(
        done=done,
        collided=touched,
        driven=driven[rows, end - 1],
        left=(places[rows, end] - goal).norm(dim=1),
        moved=(places[rows, end] - places[rows, before]).norm(dim=1),
    )


def _rows(name: str, world: str, tasks: NavigationTasks, wanted: slice, drives: Drives) -> list[SkillRow]:
    success = (drives.done >= 0).numpy()
    collided = drives.collided.numpy()
    frozen = ~success & (drives.moved < FREEZE_METRES).numpy()
    driven, left = drives.driven.double().numpy(), drives.left.double().numpy()
    shortest, bound = tasks.shortest[wanted], tasks.bound[wanted]
    reference = np.maximum(shortest - left, 0)
    spl = np.where(success, reference / np.maximum(np.maximum(driven, reference), 1e-9), 0)
    time = np.where(success, drives.done.numpy() * CONTROL_PERIOD, np.nan)
    return [
        SkillRow(
            skill=name, world=world, episode=wanted.start + i,
            distance_m=_short(tasks.distance[wanted][i]),
            clearance_m=float(tasks.clearance[wanted][i]),
            shortest_m=_short(shortest[i]), bound_s=_short(bound[i]),
            success=int(success[i]), clean=int(success[i] and not collided[i]), collision=int(collided[i]),
            freeze=int(frozen[i]), timeout=int(not success[i] and not frozen[i]),
            time_s=_short(time[i]), driven_m=_short(driven[i]), left_m=_short(left[i]),
            spl=_short(spl[i]), time_ratio=_short(time[i] / bound[i]),
        )
        for i in range(len(success))
    ]  # fmt: skip


def _short(value: float) -> float:
    return round(float(value), 4)
