"""The report's charts: curves over time, intervals of rates, profiles, training curves."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from hpp_framework.reproduction.report_data import Band, Curve
from hpp_framework.reproduction.report_html import Markup
from hpp_framework.reproduction.report_svg import BEST, FAINT, INK, SPREAD, Style, panel, svg

DOTS_WIDTH = 3.7
"""Inches of a chart of dots, which has names beside it."""
LABEL = 22
"""Characters of a line of such a name; the rest goes below."""


@dataclass(frozen=True, kw_only=True)
class Axes:
    """What a chart of bands says beside its curves.

    Attributes:
        title: above it.
        x: of the horizontal axis.
        y: of the vertical axis.
        line: height of a dashed line, None for none.
        top: of the vertical axis, None for whatever fits.
        logarithmic: whether the vertical axis is.
        bands: how many curves at most have their band drawn; more would only be mud.
    """

    title: str
    x: str
    y: str
    line: float | None = None
    top: float | None = None
    logarithmic: bool = False
    bands: int = 6


def bands(curves: Mapping[str, Band], styles: Mapping[str, Style], axes: Axes, alt: str) -> Markup:
    """Draw curves with bands."""
    with panel() as (figure, plot):
        for label, band in reversed(list(curves.items())):
            style = styles[label]
            plot.plot(band.x, band.middle, linewidth=2, **style)
            if len(curves) <= axes.bands:
                plot.fill_between(band.x, band.low, band.high, color=style["color"], alpha=0.16, linewidth=0)
        if axes.line is not None:
            plot.axhline(axes.line, color=INK, linewidth=1, linestyle=(0, (4, 3)))
        if axes.logarithmic:
            plot.set_yscale("log")
            plot.yaxis.set_major_formatter("{x:g}")
            plot.minorticks_off()
        else:
            plot.set_ylim(0, axes.top)
        plot.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10], min_n_ticks=4))
        plot.set_xlim(min(b.x[0] for b in curves.values()), max(b.x[-1] for b in curves.values()))
        _label(plot, axes)
        return svg(figure, alt)


@dataclass(frozen=True)
class Dot:
    """A number with its interval, on a line of its own.

    Attributes:
        label: of the line.
        value: the number.
        low: lower end of the interval.
        high: upper end.
        color: of the dot.
    """

    label: str
    value: float
    low: float
    high: float
    color: str


def dots(found: Sequence[Dot], *, title: str, x: str, alt: str) -> Markup:
    """Draw shares between 0 and 1 below one another with their intervals."""
    labels = [textwrap.fill(dot.label, LABEL) for dot in found]
    pitch = 0.08 + 0.16 * max(label.count("\n") + 1 for label in labels)
    with panel(DOTS_WIDTH, 0.75 + pitch * len(found)) as (figure, plot):
        for place, dot in enumerate(found):
            plot.plot([dot.low, dot.high], [place, place], color=dot.color, linewidth=2.4, alpha=0.55)
            plot.plot([dot.value], [place], "o", color=dot.color, markersize=6)
        plot.set_yticks(range(len(found)), labels)
        plot.set(ylim=(len(found) - 0.4, -0.6), xlim=(-0.02, 1.02))
        plot.set_xticks([0, 0.25, 0.5, 0.75, 1], ["0", "0.25", "0.5", "0.75", "1"])
        plot.grid(axis="y", visible=False)
        plot.spines["left"].set_visible(False)
        _label(plot, Axes(title=title, x=x, y=""))
        return svg(figure, alt)


def seeds(curves: Mapping[str, Sequence[Mapping[str, float]]], best: str, name: str, y: str) -> Markup:
    """Draw the training curves of several seeds: each, their mean with a deviation, and the best one.

    Args:
        curves: by seed; rows with ``steps`` and the number drawn.
        best: which seed was kept.
        name: of the number.
        y: what it is, with its unit.
    """
    length = min(map(len, curves.values()))
    steps = np.array([row["steps"] for row in next(iter(curves.values()))[:length]]) / 1e6
    rows = np.array([[row[name] for row in curve[:length]] for curve in curves.values()], np.float64)
    mean, deviation = rows.mean(0), rows.std(0)
    spread = SPREAD["color"]
    with panel() as (figure, plot):
        for row in rows:
            plot.plot(steps, row, color=spread, linewidth=0.8, alpha=0.5)
        if len(rows) > 1:
            plot.fill_between(
                steps, mean - deviation, mean + deviation, color=spread, alpha=0.25, linewidth=0
            )
            plot.plot(steps, mean, color=spread, linewidth=2)
        if best in curves:
            plot.plot(steps, [row[name] for row in curves[best][:length]], linewidth=2, **BEST)
        _label(plot, Axes(title=y, x="million control steps", y=""))
        alt = f"{y} of MADDPG over training steps, {len(rows)} seeds; the best ends at {rows.max(0)[-1]:.2f}."
        return svg(figure, alt)


def lines(curves: Mapping[str, tuple[Curve, Curve]], styles: Mapping[str, Style], axes: Axes) -> Markup:
    """Draw plain curves, each an x and a y."""
    without = {label: Band(x, y, y, y) for label, (x, y) in curves.items()}
    ends = ", ".join(f"{label} ends at {y[-1]:.3g}" for label, (_, y) in curves.items())
    return bands(without, styles, axes, f"{axes.title}: {axes.y} over {axes.x}. {ends}.")


def _label(plot: Any, axes: Axes) -> None:
    plot.set_title(axes.title, color=INK, fontsize=10, loc="left", fontweight="bold")
    plot.set_xlabel(axes.x, color=FAINT, fontsize=9)
    plot.set_ylabel(axes.y, color=FAINT, fontsize=9)
