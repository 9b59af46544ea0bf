"""Judges skills over worlds: cells of episodes, written as they finish, resumed where they stopped.

Episode ``e`` of world ``w`` under seed ``s`` is the same navigation task for every skill and backend, so that
comparisons are paired.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from hpp_framework.config.sensing_choice import make_estimators, parse_disturbances
from hpp_framework.core.robot import RobotSpec
from hpp_framework.evaluation import folder
from hpp_framework.evaluation.competence import competence_card, competence_map, write_competence
from hpp_framework.evaluation.navigation_tasks import NavigationTasks, draw_navigation_tasks
from hpp_framework.evaluation.skill import skill_episodes
from hpp_framework.evaluation.skill_figures import plot_competence
from hpp_framework.evaluation.skill_score import SkillRow
from hpp_framework.evaluation.table import read_rows, write_rows
from hpp_framework.evaluation.trial import Draw, Trial
from hpp_framework.plugins.builtin import UNDISTURBED
from hpp_framework.plugins.registry import hub
from hpp_framework.sim import make_simulator
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.progress import Progress
from hpp_framework.utils.run_folder import write_json

COMPETENCE, PICTURE = "competence.csv", "competence.png"
ALL = "all worlds"


@dataclass(frozen=True, kw_only=True)
class SkillStudy:
    """What is judged; written into the run folder.

    Attributes:
        skills: registered skills.
        robot: registered robot.
        worlds: registered worlds or YAML files.
        episodes: a skill and world.
        goal_distance, clearance, draw, steps, disturbances, estimator, seed, backend: see :class:`Trial`.
        judged: tells the folder from one that compares planners.
    """

    skills: tuple[str, ...]
    robot: str
    worlds: tuple[str, ...]
    episodes: int = 600
    goal_distance: tuple[float, float] = (1.0, 15.0)
    clearance: float = 0.05
    draw: Draw = "even"
    steps: int = 200
    disturbances: str = UNDISTURBED
    estimator: str = "none"
    seed: int = 0
    backend: str = "batch"
    judged: str = "skills"

    def __post_init__(self) -> None:
        if not self.skills or not self.worlds:
            raise ConfigError("name at least one skill and one world.")
        parse_disturbances(self.disturbances)

    def trial(self, world: str, *, episodes: int | None = None) -> Trial:
        """Return what every skill is put to in a world."""
        return Trial(
            world=world, episodes=self.episodes if episodes is None else episodes,
            goal_distance=self.goal_distance, clearance=self.clearance, draw=self.draw, steps=self.steps,
            disturbances=self.disturbances, estimator=self.estimator, seed=self.seed, backend=self.backend,
        )  # fmt: skip


def check_study(study: SkillStudy) -> RobotSpec:
    """Try everything that a study names, before anything is written, and return its robot.

    Raises:
        HppError: whatever is wrong: an unknown name, missing weights, a world without such goals.
    """
    robot = hub().robots.create(study.robot)
    make_estimators(study.estimator, [robot], [parse_disturbances(study.disturbances)])
    for world in study.worlds:
        study.trial(world)
    for skill in study.skills:
        hub().skills.create(skill, robot)
    make_simulator(study.backend, [robot]).close()
    for world in study.worlds:
        draw_navigation_tasks(robot, study.trial(world, episodes=1))
    return robot


def run_study(study: SkillStudy, out: Path, *, progress: Progress = lambda *_: None) -> list[dict[str, Any]]:
    """Run the skills and worlds that are not yet in ``out`` and write tables and picture.

    Args:
        study: what is judged.
        out: run folder; created, or resumed if it holds the same study.
        progress: called with (what is under way, episodes done, episodes in all).

    Returns:
        What ``summary.json`` holds: skill, world and :func:`competence_card` of each cell and, with several
        worlds, of all of them together.

    Raises:
        HppError: if the study names something wrong (nothing is written then), or ``out`` holds something
            else, is damaged or cannot be written.
    """
    robot = check_study(study)
    config = folder.record(folder.EVALUATE, asdict(study), {})
    folder.open_evaluation(out, config)
    rows = read_rows(out / folder.EPISODES, SkillRow)
    for world in study.worlds:
        rows = _run_world(study, robot, world, rows, out / folder.EPISODES, progress)
    cells = {
        (skill, world): [row for row in rows if row.skill == skill and world in (row.world, ALL)]
        for skill in study.skills
        for world in (*study.worlds, *((ALL,) if len(study.worlds) > 1 else ()))
    }
    maps = {cell: competence_map(part) for cell, part in cells.items()}
    write_competence(out / COMPETENCE, maps)
    common = {
        name: getattr(study, name)
        for name in ("robot", "backend", "seed", "draw", "goal_distance", "clearance")
    }
    plot_competence(out / PICTURE, maps, title=describe(common))
    summary = [
        {"skill": skill, "world": world, **common, **competence_card(part)}
        for (skill, world), part in cells.items()
    ]
    write_json(out / folder.SUMMARY, summary, remedy="Finished cells are kept; resume later.")
    return summary


def describe(summary: Mapping[str, Any]) -> str:
    """Return in a line what episodes the numbers of a summary come from."""
    near, far = summary["goal_distance"]
    return (
        f"{summary['robot']}, {summary['backend']}, seed {summary['seed']}: goals {near:g} to {far:g} m "
        f"away, {summary['draw']} draw, clearance of {summary['clearance']:g} m or more at both ends"
    )


def _run_world(
    study: SkillStudy,
    robot: RobotSpec,
    world: str,
    rows: list[SkillRow],
    file: Path,
    progress: Progress,
) -> list[SkillRow]:
    """Run the skills that a world misses, write after each, and return all rows."""
    tasks: NavigationTasks | None = None
    trial = study.trial(world)
    for skill in study.skills:
        cell = f"{skill} / {world}"
        have = sum((row.skill, row.world) == (skill, world) for row in rows)
        if have != study.episodes:
            if tasks is None:
                named = f"tasks in {world}"
                tasks = draw_navigation_tasks(
                    robot, trial, progress=lambda done, named=named: progress(named, done, study.episodes)
                )
            fresh = skill_episodes(
                hub().skills.create(skill, robot), robot, trial, name=skill, tasks=tasks,
                progress=lambda done, cell=cell: progress(cell, done, study.episodes),
            )  # fmt: skip
            rows = [row for row in rows if (row.skill, row.world) != (skill, world)] + fresh
            write_rows(file, rows, SkillRow)
        progress(cell, study.episodes, study.episodes)
    return rows
