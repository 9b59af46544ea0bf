"""The picture of a search: scores in order, and against each parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import accumulate
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from hpp_framework.training.search.space import SCORE, Choice, Phase, Range, Value
from hpp_framework.utils.run_folder import replacing

if TYPE_CHECKING:
    from hpp_framework.training.search.study import TrialRow

COLUMNS = 4
PANEL = (2.9, 2.2)
"""Inches a panel."""
COLORS = ("tab:blue", "tab:orange", "tab:green", "tab:purple")


def draw_search(
    file: Path, phases: Sequence[tuple[Phase, Sequence[TrialRow]]], start: Mapping[str, Value]
) -> None:
    """Draw each phase: the score of its trials in order above, and against its parameters below.

    Args:
        file: the picture.
        phases: with their trials by number.
        start: the value of each parameter that the search began with, a dotted line.
    """
    heights = [1.3, *(ceil(len(phase.parameters) / COLUMNS) for phase, _ in phases)]
    figure = Figure(figsize=(PANEL[0] * COLUMNS, PANEL[1] * sum(heights)), dpi=110, layout="constrained")
    parts: Any = figure.subfigures(len(heights), 1, height_ratios=heights)
    _draw_order(parts[0].subplots(), phases)
    for part, (phase, rows), color in zip(parts[1:], phases, _colors(phases), strict=True):
        part.suptitle(f"phase {phase.name}: score against each parameter; dotted: where it began", fontsize=9)
        panels: Any = part.subplots(
            ceil(len(phase.parameters) / COLUMNS), COLUMNS, squeeze=False, sharey=True
        )
        for axes in panels.flat[len(phase.parameters) :]:
            axes.axis("off")
        for axes, (name, parameter) in zip(panels.flat, phase.parameters.items(), strict=False):
            _draw_parameter(axes, name, parameter, rows, start[name], color)
    with replacing(file) as temporary:
        figure.savefig(temporary, format="png")


def _colors(phases: Sequence[object]) -> list[str]:
    return [COLORS[index % len(COLORS)] for index in range(len(phases))]


def _draw_order(axes: Any, phases: Sequence[tuple[Phase, Sequence[TrialRow]]]) -> None:
    """Draw scores by the order of trials, all phases one after another, with the best so far."""
    rows = [row for _, of_phase in phases for row in of_phase]
    finished = [(place, row.metrics[SCORE]) for place, row in enumerate(rows) if row.score is not None]
    places = [place for place, _ in finished]
    axes.step(
        places,
        list(accumulate((s for _, s in finished), max)),
        where="post",
        color="0.5",
        label="best so far",
    )
    axes.axhline(finished[0][1], color="0.5", linestyle=":", label="baseline")
    first = 0
    for (phase, of_phase), color in zip(phases, _colors(phases), strict=True):
        own = [point for point in finished if first <= point[0] < first + len(of_phase)]
        axes.plot([p for p, _ in own], [s for _, s in own], "o", color=color, label=f"phase {phase.name}")
        first += len(of_phase)
        if first < len(rows):
            axes.axvline(first - 0.5, color="0.85")
    _draw_scoreless(axes, [place for place, row in enumerate(rows) if row.score is None])
    axes.set(xlabel="trial, in order", ylabel=SCORE)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1, 1))


def _draw_parameter(
    axes: Any, name: str, parameter: Range | Choice, rows: Sequence[TrialRow], began: Value, color: str
) -> None:
    known = [row for row in rows if name in row.settings]
    points = [(parameter.place(row.settings[name]), row.score) for row in known]
    axes.axvline(parameter.place(began), color="0.5", linestyle=":")
    scored = [point for point in points if point[1] is not None]
    axes.plot([x for x, _ in scored], [y for _, y in scored], "o", color=color, markersize=4)
    if isinstance(parameter, Choice):
        axes.set_xticks(range(len(parameter.values)), [str(value) for value in parameter.values])
        axes.set_xlim(-0.5, len(parameter.values) - 0.5)
    else:
        _span(axes, parameter)
    _draw_scoreless(axes, [x for x, y in points if y is None])
    axes.set_xlabel(name, fontsize=8)
    axes.tick_params(labelsize=7)
    axes.grid(alpha=0.3)


def _span(axes: Any, parameter: Range) -> None:
    """Show the whole range, whatever part of it was tried."""
    low, high = float(parameter.low), float(parameter.high)
    if parameter.log:
        axes.set_xscale("log")
        margin = (high / low) ** 0.05
        axes.set_xlim(low / margin, high * margin)
        ticks = [low, (low * high) ** 0.5, high]
        axes.set_xticks(ticks, [f"{tick:.2g}" for tick in ticks])
        axes.minorticks_off()
    else:
        margin = 0.05 * (high - low)
        axes.set_xlim(low - margin, high + margin)
        axes.xaxis.set_major_locator(MaxNLocator(4, integer=parameter.whole))


def _draw_scoreless(axes: Any, places: Sequence[float]) -> None:
    """Mark trials that were stopped or failed along the lower edge."""
    if places:
        axes.plot(places, [0.02] * len(places), "x", color="tab:red", transform=axes.get_xaxis_transform(),
                  label="stopped, failed or unfinished")  # fmt: skip
