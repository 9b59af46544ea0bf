"""What the page shows of an experiment: curves over time, intervals of success, predictors, training."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from hpp_framework.evaluation.predictor_score import ALL, ALL_WORLDS, ErrorRow
from hpp_framework.evaluation.predictor_study import ERRORS
from hpp_framework.evaluation.table import read_rows
from hpp_framework.reproduction.plan import CURVE, PLANNERS, PREDICTOR
from hpp_framework.reproduction.report.charts import Chart, Line
from hpp_framework.reproduction.report.names import colors, name_of, planner_label, privileged, world_label
from hpp_framework.reproduction.report.paper import FIGURES, PaperFigure
from hpp_framework.reproduction.report.results import Band, Ran, Reproduction, Row

ROLES = {"self": "of itself", "other": "of the other robot"}


class Arm(NamedTuple):
    """A planner of an experiment, and what it is called beside others."""

    label: str
    ran: Ran
    planner: str


class Rate(NamedTuple):
    """A row of a forest plot: a share with its interval; kind ``first``, ``privileged`` or none."""

    label: str
    value: float
    low: float
    high: float
    kind: str


class Block(NamedTuple):
    """What the page shows of an experiment, or of several that ask the same; empty if they have not run."""

    ran: Ran
    title: str
    note: str = ""
    charts: Sequence[Chart] = ()
    forests: Mapping[str, Sequence[Rate]] = {}


def figure_blocks(found: Reproduction) -> list[tuple[PaperFigure, list[Block]]]:
    """Return the paper's figures with results, each with our experiments that belong to it."""
    return [
        (figure, [_beside(figure, ran) for ran in found.experiments if figure.number in ran.figures])
        for figure in FIGURES
    ]


def ablation_blocks(found: Reproduction) -> list[Block]:
    """Return the experiments that belong to no figure of the paper; those with like titles together."""
    numbers = {figure.number for figure in FIGURES}
    groups: dict[str, list[Ran]] = {}
    for ran in found.experiments:
        if ran.kind == PLANNERS and not ran.figures & numbers and ran is not found.main:
            groups.setdefault(ran.title.split(":")[0], []).append(ran)
    return [_ablation(title, group, found.main) for title, group in groups.items()]


def predictor_blocks(found: Reproduction) -> list[Block]:
    """Return the studies of motion models."""
    return [_study(ran) for ran in found.experiments if ran.kind == PREDICTOR]


def arms_of(ran: Ran, names: Sequence[str] = ()) -> list[Arm]:
    """Return the planners of an experiment; of those named if any are, without the ones with a true map."""
    wanted = [p for p in ran.planners if not names or (name_of(p) in names and "known_map" not in p)]
    return [Arm(planner_label(planner), ran, planner) for planner in wanted]


def forests(arms: Sequence[Arm], worlds: Sequence[str]) -> dict[str, list[Rate]]:
    """Return success with its interval by world, for worlds in which any of the arms has run."""
    found = {world: [_rate(arm, world, first=arm is arms[0]) for arm in arms] for world in worlds}
    return {world_label(world): [r for r in rates if r] for world, rates in found.items() if any(rates)}


def over_time(arms: Sequence[Arm], worlds: Sequence[str]) -> list[Chart]:
    """Return the distance between robots over time, one chart per world."""
    color = colors([arm.planner for arm in arms])
    found = [(arm, arm.ran.distances()) for arm in arms]
    charts: list[Chart] = []
    for world in worlds:
        shown = [(arm, bands.get((world, arm.planner))) for arm, bands in found]
        lines = [Line(arm.label, band, color[arm.planner]) for arm, band in shown if band is not None]
        charts += (
            [Chart(world_label(world), "time [s]", "distance between robots [m]", lines)] if lines else []
        )
    return charts


def profiles(ran: Ran) -> list[Chart]:
    """Return performance profiles: which share of episodes has an RPL above each threshold."""
    color = colors(ran.planners)
    charts: list[Chart] = []
    for world in ran.strata:
        lines: list[Line] = []
        for row in ran.rows("aggregates", world=world):
            if row["profile"]:
                band = Band(
                    *(np.array(row["profile"][key]) for key in ("thresholds", "share", "low", "high"))
                )
                lines.append(Line(planner_label(row["planner"]), band, color.get(row["planner"], 0)))
        charts += (
            [Chart(world_label(world), "RPL threshold", "share of episodes above", lines)] if lines else []
        )
    return charts


def predictor_errors(ran: Ran) -> list[Chart]:
    """Return mean errors over the horizon, one chart per role; over all worlds if there are several."""
    rows = [row for row in read_rows(ran.folder / ERRORS, ErrorRow) if row.agent == ALL]
    rows = [row for row in rows if row.world == ALL_WORLDS] or rows
    names = list(dict.fromkeys(row.predictor for row in rows))
    charts: list[Chart] = []
    for role, words in ROLES.items():
        lines: list[Line] = []
        for color, name in enumerate(names, 1):
            own = [(r.seconds, r.mean_m, r.mean_low_m, r.mean_high_m)
                   for r in rows if (r.predictor, r.role) == (name, role)]  # fmt: skip
            lines += [Line(name, Band(*np.array(own).T), color)] if own else []
        title = f"prediction {words}"
        charts += [Chart(title, "seconds ahead", "mean error [m]", lines, logarithmic=True)] if lines else []
    return charts


def training_curves(ran: Ran) -> list[Chart]:
    """Return MADDPG's curves over seeds, or the losses of predictors, whichever a summary holds."""
    summary: Mapping[str, Any] = ran.summary or {}
    if summary.get("curves"):
        return [
            _seeds(summary, "judged_return", "return of an episode"),
            _seeds(summary, "success", "success"),
        ]
    charts: list[Chart] = []
    for kind, losses in summary.get("losses", {}).items():
        points = {model: np.array(curve, np.float64).T for model, curve in losses.items() if curve}
        lines = [Line(model, Band(xy[0] / 1e3, xy[1]), i) for i, (model, xy) in enumerate(points.items(), 1)]
        charts += [Chart(kind, "thousand gradient steps", "loss, in its own units", lines)] if lines else []
    return charts


def pooled_errors(ran: Ran) -> list[Row]:
    """Return errors by role and predictor over all worlds of a study, those of oneself first."""
    summary: list[Any] = list(ran.summary or [])
    pooled = [row for row in summary if row["world"] == ALL_WORLDS] or summary
    by_horizon = [{**row, "errors": {each["seconds"]: each for each in row["errors"]}} for row in pooled]
    return sorted(by_horizon, key=lambda row: row["role"] != "self")


def _rate(arm: Arm, world: str, *, first: bool) -> Rate | None:
    cell = arm.ran.row("cells", world=world, planner=arm.planner)
    kind = "privileged" if privileged(arm.planner) else "first" * first
    if not cell:
        return None
    return Rate(arm.label, cell["success"], cell["success_low"], cell["success_high"], kind)


def _seeds(summary: Mapping[str, Any], column: str, words: str) -> Chart:
    """Return a chart of one number of MADDPG's training: every seed, their mean, and what was kept."""
    best, kept = str(summary["run"]["seed"]), summary["judged"]
    seeds: Mapping[str, Sequence[Row]] = summary["curves"]
    length = min(map(len, seeds.values()))
    steps = np.array([row["steps"] for row in next(iter(seeds.values()))[:length]]) / 1e6
    curves = {
        seed: np.array([row[column] for row in rows[:length]], np.float64) for seed, rows in seeds.items()
    }
    rows = np.array(list(curves.values()))
    mean, deviation = rows.mean(0), rows.std(0)
    lines = [Line(f"mean of {len(rows)} seeds", Band(steps, mean, mean - deviation, mean + deviation), 4)]
    lines += [Line("", Band(steps, curve)) for seed, curve in curves.items() if seed != best]
    if best in curves:
        dot = kept["steps"] / 1e6, kept[column]
        lines.insert(0, Line(f"seed {best}, the best", Band(steps, curves[best]), 1, dot))
    return Chart(words, "million control steps", words, lines, low=None)


def _study(ran: Ran) -> Block:
    return Block(ran, ran.title, charts=predictor_errors(ran) if ran.summary else ())


def _beside(figure: PaperFigure, ran: Ran) -> Block:
    if ran.kind != PLANNERS:
        return Block(ran, ran.title, charts=training_curves(ran)) if ran.kind == CURVE else _study(ran)
    worlds = [world for world in ran.worlds if not figure.worlds or world in figure.worlds]
    arms = arms_of(ran, figure.planners)
    return Block(ran, ran.title, _preset(ran), over_time(arms, worlds), forests(arms, worlds))


def _ablation(title: str, group: Sequence[Ran], main: Ran | None) -> Block:
    """Return experiments that ask the same; several stand beside the main comparison, undisturbed."""
    first = group[0]
    note = (f"The paper: {first.figure}. " if first.figure else "") + _preset(first)
    if len(group) == 1:
        arms = arms_of(first)
        return Block(first, title, note, over_time(arms, first.worlds), forests(arms, first.worlds))
    ran = [each for each in group if each.rows("cells")]
    found: dict[str, list[Rate]] = {}
    for planner in ran[0].planners if ran else ():
        arms = [Arm(each.title.split(":", 1)[-1].strip(), each, planner) for each in ran]
        if main is not None and planner in main.planners:
            arms.insert(0, Arm("undisturbed", main, planner))
        for world, rates in forests(arms, ran[0].worlds).items():
            found[f"{planner_label(planner)} in {world}"] = rates
    return Block(first, title, note, forests=found)


def _preset(ran: Ran) -> str:
    return f"Preset {ran.preset}." if ran.preset != "best" else ""
