"""``hpp evaluate skill``: how well skills reach goals, and where they may be trusted."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from hpp_framework.cli.options import names
from hpp_framework.cli.progress import cell_bars
from hpp_framework.plugins.builtin import DEFAULT_DISTURBANCES, DEFAULT_ESTIMATOR
from hpp_framework.utils.run_folder import RunFolder

TABLE_WIDTH = 140


@dataclass(frozen=True, kw_only=True)
class EvaluateSkill:
    """Drive one robot to one goal an episode, each in a world of its own, and map where a skill is trusted.

    Writes episodes.csv (one row per episode), competence.csv and competence.png (success by goal distance and
    clearance), summary.json and config.json into --out. Interrupted runs resume: repeat the same command.
    """

    name: Annotated[str, tyro.conf.Positional] = "p2p"
    """Registered skill."""
    compare: str = ""
    """More registered skills that drive the same tasks, separated by commas."""
    robot: str = "fetch"
    """Registered robot."""
    worlds: str = "training"
    """Registered worlds or YAML files, separated by commas."""
    episodes: int = 600
    """Episodes per skill and world; 600 give most bins of the map the 20 that trust asks for."""
    goal_distance: tuple[float, float] = (1.0, 15.0)
    """Nearest and farthest goal, straight line, in metres."""
    clearance: float = 0.05
    """Gap between the footprint at start or goal and the nearest obstacle, at least; in metres."""
    draw: Literal["even", "uniform"] = "even"
    """Tasks that fill the bins of the map evenly, also through passages that just fit; or any task
    on which --clearance can be kept throughout."""
    steps: int = 200
    """Control steps of 0.2 s before an episode counts as failed."""
    backend: Literal["batch", "sapien"] = "batch"
    """Simulator."""
    seed: int = 0
    """Seed of worlds, starts, goals and disturbances."""
    out: Path = Path("out/skill")
    """Folder to write to."""
    disturbances: str = DEFAULT_DISTURBANCES
    """Of sensing and acting: ideal, paper, field or harsh, with settings or without."""
    estimator: str = DEFAULT_ESTIMATOR
    """Registered estimator, with settings or without."""

    def run(self) -> None:
        """Run the episodes and print their summary."""
        from hpp_framework.evaluation.skill_study import COMPETENCE, PICTURE, SkillStudy, run_study

        listed = f"{self.name},{self.compare}" if self.compare else self.name
        study = SkillStudy(
            skills=names(listed, "--compare" if self.compare else "skill"),
            robot=self.robot,
            worlds=names(self.worlds, "--worlds"),
            episodes=self.episodes,
            goal_distance=self.goal_distance,
            clearance=self.clearance,
            draw=self.draw,
            steps=self.steps,
            disturbances=self.disturbances,
            estimator=self.estimator,
            seed=self.seed,
            backend=self.backend,
        )
        with RunFolder(self.out).locked(), cell_bars() as report:
            summary = run_study(study, self.out, progress=report)
        Console(width=TABLE_WIDTH).print(skill_table(summary))
        for title, file in (("episodes", "episodes.csv"), ("map", COMPETENCE), ("picture", PICTURE)):
            print(f"{title + ':':9} {self.out / file}")


def skill_table(summary: list[dict[str, Any]]) -> Table:
    """Return a summary from :func:`hpp_framework.evaluation.skill_study.run_study` as a table."""
    from hpp_framework.evaluation.skill_study import describe

    table = Table(box=None, title=escape(describe(summary[0])), title_justify="left", title_style="")
    for column in (
        "skill", "world", "success", "95 %", "clean", "collided", "froze", "SPL", "95 %",
        "time s", "/ bound", "trusted bins",
    ):  # fmt: skip
        if column in ("skill", "world"):
            # a name that is too long goes on in a second line, so that it can be read
            table.add_column(column, overflow="fold")
        else:
            table.add_column(column, justify="right", no_wrap=True)
    for row in summary:
        score = row["summary"]
        trusted = sum(each["trusted"] for each in row["bins"])
        table.add_row(
            escape(row["skill"]), escape(row["world"]), f"{score['success']:.3f}",
            f"{score['success_low']:.3f}-{score['success_high']:.3f}", f"{score['clean']:.3f}",
            f"{score['collision']:.3f}", f"{score['freeze']:.3f}", f"{score['spl']:.3f}",
            f"{score['spl_low']:.3f}-{score['spl_high']:.3f}", _number(score["time_median_s"], ".1f"),
            _number(score["time_ratio_median"], ".2f"), f"{trusted}/{len(row['bins'])}",
        )  # fmt: skip
    return table


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)
