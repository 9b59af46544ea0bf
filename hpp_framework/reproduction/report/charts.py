"""Geometry of the report's charts; the template draws them as SVG, and its style sheet colours them.

A chart is a panel of curves, each with its name at its end::

    chart = Chart("wall", "time [s]", "distance [m]", [Line("HPP", Band(seconds, metres), color=1)])
    chart.path(chart.lines[0])  # "M36.0,12.1 40.2,14.0 ..."
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from matplotlib.ticker import LogLocator, MaxNLocator

from hpp_framework.reproduction.report.results import Band, Curve

WIDTH, HEIGHT, LEFT, TOP, BOTTOM = 360, 230, 38, 10, 194
"""Of a chart and its plot, in units; on a telephone a chart is about as many pixels wide."""
LETTER, LEADING, LABEL = 6.3, 11.5, 20
"""Width of a letter and height of a line, in units; letters per line of a label."""
BANDS_SHOWN, CURVES_LED = 6, 8
"""Curves at most that have their band drawn, and that have a line from their end to their label."""


class Line(NamedTuple):
    """A curve: its label (empty for none), colour of the style sheet (0: grey), and a marked point."""

    label: str
    band: Band
    color: int = 0
    dot: tuple[float, float] | None = None


class Label(NamedTuple):
    """What is written beside a curve, the height of its middle, and that of the curve's end."""

    line: Line
    text: list[str]
    y: float
    end: float


@dataclass(frozen=True)
class Chart:
    """A panel of curves.

    Attributes:
        title: above it.
        x: of the horizontal axis, with its unit.
        y: of the vertical axis, with its unit.
        lines: the curves, the most important first.
        low: of the vertical axis, None for what fits.
        logarithmic: whether the vertical axis is.
    """

    title: str
    x: str
    y: str
    lines: Sequence[Line]
    low: float | None = 0.0
    logarithmic: bool = False

    width, height, left, bottom = WIDTH, HEIGHT, LEFT, BOTTOM

    @cached_property
    def right(self) -> float:
        """Where the plot ends and labels begin."""
        longest = max((len(text) for line in self.lines for text in _wrapped(line.label)), default=0)
        return round(WIDTH - (longest * LETTER + 20 if longest else 8), 1)

    @property
    def alt(self) -> str:
        """Return what the chart shows, in words."""
        ends = ", ".join(f"{each.label} ends at {each.band.y[-1]:.3g}" for each in self.lines if each.label)
        return f"{self.title}: {self.y} over {self.x}. {ends}."

    def path(self, line: Line) -> str:
        """Return the outline of a curve for SVG."""
        return self._path(line.band.x, line.band.y)

    def area(self, line: Line) -> str:
        """Return the outline of a curve's band for SVG; empty if it is not drawn."""
        x, _, low, high = line.band
        if low is None or high is None or sum(each.band.low is not None for each in self.lines) > BANDS_SHOWN:
            return ""
        return f"{self._path(np.concatenate([x, x[::-1]]), np.concatenate([low, high[::-1]]))} Z"

    def at(self, x: float, y: float) -> list[float]:
        """Return where a point lies, in units of the chart."""
        return [
            round(each, 1)
            for each in self._points(np.array([float(x)]), np.array([float(y)])).ravel().tolist()
        ]

    def ticks(self) -> tuple[list[tuple[float, str]], list[tuple[float, str]]]:
        """Return the ticks of both axes: where they are, and what they say."""
        linear = MaxNLocator(4, steps=[1, 2, 2.5, 5, 10])
        (left, right), (low, high) = self._spans
        xs = [x for x in np.round(linear.tick_values(left, right), 9) if left <= x <= right]
        locator = LogLocator(subs=(1, 2, 5)) if self.logarithmic else linear
        ys = [y for y in np.round(locator.tick_values(low, high), 9) if low <= y <= high]
        return [(self.at(x, low)[0], f"{x:g}") for x in xs], [(self.at(left, y)[1], f"{y:g}") for y in ys]

    def labels(self) -> list[Label]:
        """Return the labels of all curves in their order, moved apart where they would overlap.

        Too many curves for lines between both have their labels sorted by the curves' means.
        """
        wrapped = [_wrapped(line.label) for line in self.lines]
        half = [0.5 * LEADING * len(text) for text in wrapped]
        height = (lambda y: y[-1]) if self.led else np.mean
        finite = [line.band.y[np.isfinite(line.band.y)] for line in self.lines]
        ends = [self.at(0, float(height(y)))[1] for y in finite]
        order = sorted(range(len(ends)), key=ends.__getitem__)
        places, free = list(ends), 0.0
        for i in order:
            places[i] = max(ends[i], free + half[i])
            free = places[i] + half[i]
        free = float(HEIGHT)
        for i in reversed(order):
            places[i] = round(min(places[i], free - half[i]), 1)
            free = places[i] - half[i]
        return [Label(*each) for each in zip(self.lines, wrapped, places, ends, strict=True)]

    @property
    def led(self) -> bool:
        """Whether lines lead from curves to their labels."""
        return sum(bool(line.label) for line in self.lines) <= CURVES_LED

    @cached_property
    def _spans(self) -> list[tuple[float, float]]:
        """The ranges of both axes, which are never empty."""
        y = np.concatenate([curve for line in self.lines for curve in line.band[1:] if curve is not None])
        y = y[(y > 0) & np.isfinite(y)] if self.logarithmic else y[np.isfinite(y)]
        x = np.concatenate([line.band.x for line in self.lines])
        lows = x.min(), y.min() if self.low is None or self.logarithmic else self.low
        return [
            (float(a), float(b if b > a else a + 1)) for a, b in zip(lows, (x.max(), y.max()), strict=True)
        ]

    def _points(self, x: Curve, y: Curve) -> Curve:
        (left, right), span = self._spans
        if self.logarithmic:
            y, span = np.log(np.maximum(y, span[0])), np.log(span)
        return np.stack(
            [np.interp(x, (left, right), (LEFT, self.right)), np.interp(y, span, (BOTTOM, TOP))], -1
        )

    def _path(self, x: Curve, y: Curve) -> str:
        points = self._points(x, y)
        return "M" + " ".join(f"{a:.1f},{b:.1f}" for a, b in points[np.isfinite(points).all(-1)].tolist())


def _wrapped(label: str) -> list[str]:
    return textwrap.wrap(label.replace("=", "= "), LABEL) if len(label) > LABEL else [label] * bool(label)
