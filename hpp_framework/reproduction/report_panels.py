"""Results as figures of the page: planners over time and by success, predictors, training curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hpp_framework.config.planner_choice import parse_planner
from hpp_framework.evaluation.predictor_score import ALL, ALL_WORLDS, ErrorRow
from hpp_framework.evaluation.predictor_study import ERRORS
from hpp_framework.evaluation.table import read_rows
from hpp_framework.reproduction.report_charts import Axes, Dot, bands, dots, lines, seeds
from hpp_framework.reproduction.report_data import Band, Ran
from hpp_framework.reproduction.report_html import Markup, join, note, number, tag
from hpp_framework.reproduction.report_names import planner_label, world_label
from hpp_framework.reproduction.report_svg import BEST, SPREAD, Style, key, plain_styles, planner_styles

NOT_RUN = "Not run."
ROLES = {"self": "of itself", "other": "of the other robot"}


@dataclass(frozen=True)
class Variant:
    """A line of a comparison: one planner of one experiment.

    Attributes:
        label: what it is called.
        ran: the experiment.
        planner: its planner.
    """

    label: str
    ran: Ran
    planner: str


def variants(ran: Ran, names: Sequence[str] = ()) -> list[Variant]:
    """Return the planners of an experiment.

    Args:
        ran: the experiment.
        names: registered names of those wanted, all if empty; those that know the true map are left out then.
    """
    wanted = [planner for planner in ran.planners if not names or _plain(planner) in names]
    return [Variant(planner_label(planner), ran, planner) for planner in wanted]


def legend(shown: Sequence[Variant]) -> Markup:
    """Return the legend of all figures of the same variants."""
    return key(_styles(shown))


def over_time(shown: Sequence[Variant], worlds: Sequence[str]) -> Markup:
    """Return the distance between robots over time, a panel a world, with one legend."""
    styles = _styles(shown)
    found = {id(each.ran): each.ran.distances() for each in shown}
    panels: list[Markup] = []
    for world in worlds:
        curves = {
            each.label: band
            for each in shown
            if (band := found[id(each.ran)].get((world, each.planner))) is not None
        }
        if curves:
            ends = ", ".join(f"{label} {number(float(band.middle[-1]))} m" for label, band in curves.items())
            axes = Axes(title=world_label(world), x="time [s]", y="distance between robots [m]")
            alt = f"Mean distance between robots over time in {world_label(world)}. After 20 s: {ends}."
            panels.append(_panel(bands(curves, styles, axes, alt)))
    if not panels:
        return note(NOT_RUN)
    return join(legend(shown), tag("div", join(*panels), class_="panels"))


def successes(shown: Sequence[Variant], worlds: Sequence[str]) -> Markup:
    """Return success with its interval, a panel a world."""
    styles = _styles(shown)
    panels: list[Markup] = []
    for world in worlds:
        cells = {each.label: each.ran.cell(world, each.planner) for each in shown}
        rows = [
            Dot(label, cell["success"], cell["success_low"], cell["success_high"], styles[label]["color"])
            for label, cell in cells.items()
            if cell is not None
        ]
        if rows:
            told = ", ".join(f"{row.label} {row.value:.2f}" for row in rows)
            alt = f"Success in {world_label(world)} with 95 % intervals: {told}."
            panels.append(_panel(dots(rows, title=world_label(world), x="success, 95 % interval", alt=alt)))
    return tag("div", join(*panels), class_="panels") if panels else note(NOT_RUN)


def profiles(ran: Ran, world: str) -> Markup | None:
    """Return performance profiles: which share of episodes has an RPL above each threshold."""
    shown = variants(ran)
    curves: dict[str, Band] = {}
    for each in shown:
        rows = [r for r in ran.rows("aggregates") if (r["world"], r["planner"]) == (world, each.planner)]
        if rows and rows[0]["profile"]:
            found = {name: np.array(values) for name, values in rows[0]["profile"].items()}
            curves[each.label] = Band(found["thresholds"], found["share"], found["low"], found["high"])
    if not curves:
        return None
    axes = Axes(title=world_label(world), x="RPL threshold", y="share of episodes above", top=1.02)
    shares = ", ".join(f"{label} {number(float(band.middle[0]))}" for label, band in curves.items())
    alt = f"Performance profiles in {world_label(world)}. Share of episodes above 0: {shares}."
    return _panel(bands(curves, _styles(shown), axes, alt))


def predictor_errors(ran: Ran) -> Markup:
    """Return mean errors over the horizon, a panel a role."""
    rows = [row for row in read_rows(ran.folder / ERRORS, ErrorRow) if row.agent == ALL]
    world = ALL_WORLDS if any(row.world == ALL_WORLDS for row in rows) else rows[0].world if rows else ""
    rows = [row for row in rows if row.world == world]
    names = list(dict.fromkeys(row.predictor for row in rows))
    styles = plain_styles(names)
    panels: list[Markup] = []
    for role, words in ROLES.items():
        curves: dict[str, Band] = {}
        for name in names:
            own = [row for row in rows if (row.predictor, row.role) == (name, role)]
            if own:
                columns = [[getattr(row, c) for row in own]
                           for c in ("seconds", "mean_m", "mean_low_m", "mean_high_m")]  # fmt: skip
                curves[name] = Band(*(np.array(column, np.float64) for column in columns))
        if curves:
            ends = ", ".join(f"{name} {number(float(band.middle[-1]))} m" for name, band in curves.items())
            axes = Axes(
                title=f"prediction {words}", x="seconds ahead", y="mean error [m]", logarithmic=True, bands=9
            )
            alt = f"Mean position error of predictions {words}; at the longest horizon: {ends}."
            panels.append(_panel(bands(curves, styles, axes, alt)))
    if not panels:
        return note(NOT_RUN)
    return join(key(styles), tag("div", join(*panels), class_="panels"))


def training_curves(ran: Ran) -> Markup:
    """Return MADDPG's curves over seeds, or the losses of predictors, whichever a summary holds."""
    summary: Mapping[str, Any] = ran.summary or {}
    if summary.get("losses"):
        return _losses(summary["losses"])
    if not summary.get("curves"):
        return note(NOT_RUN)
    curves: Mapping[str, Any] = summary["curves"]
    best = str(summary["run"]["seed"])
    panels = [
        _panel(seeds(curves, best, "judged_return", "return of an episode")),
        _panel(seeds(curves, best, "success", "success")),
    ]
    count = len(curves)
    styles: dict[str, Style] = {f"seed {best}, the best, which is used": BEST}
    if count > 1:
        styles[f"{count} seeds: each thin, their mean with one deviation"] = SPREAD
    return join(key(styles), tag("div", join(*panels), class_="panels"))


def _losses(losses: Mapping[str, Mapping[str, Sequence[Sequence[float]]]]) -> Markup:
    models = list(dict.fromkeys(model for found in losses.values() for model in found))
    styles = plain_styles(models)
    panels: list[Markup] = []
    for kind, found in losses.items():
        curves = {model: (np.array(points, np.float64)[:, 0] / 1e3, np.array(points, np.float64)[:, 1])
                  for model, points in found.items() if points}  # fmt: skip
        if curves:
            axes = Axes(title=kind, x="thousand gradient steps", y="loss, in the kind's own units")
            panels.append(_panel(lines(curves, styles, axes)))
    return join(key(styles), tag("div", join(*panels), class_="panels")) if panels else note(NOT_RUN)


def _panel(figure: Markup) -> Markup:
    return tag("figure", figure, class_="panel")


def _styles(shown: Sequence[Variant]) -> dict[str, Style]:
    planners = [each.planner for each in shown]
    if len(set(planners)) == len(planners):
        styles = planner_styles(planners)
        return {each.label: styles[each.planner] for each in shown}
    return plain_styles([each.label for each in shown])


def _plain(planner: str) -> str:
    """Return the name of a planner that runs without the true map, else nothing."""
    choice = parse_planner(planner)
    return "" if "known_map" in choice.settings else choice.name
