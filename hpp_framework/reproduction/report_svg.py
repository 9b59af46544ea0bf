"""Figures as SVG within the page: its fonts, and colours that follow light and dark."""

from __future__ import annotations

import io
import itertools
import re
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any

import matplotlib
from matplotlib.figure import Figure

from hpp_framework.config.planner_choice import parse_planner
from hpp_framework.reproduction.report_html import Markup, tag

SERIES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7a5195", "#8c8c00")
"""Colours that most colour-blind people tell apart (Okabe and Ito 2008), and two more; the page lightens
them where it is dark."""
INK, GRID, FAINT = "#1b2027", "#dfe3e8", "#7b8390"
DASHES = ("-", (0, (5, 2)), (0, (1.5, 1.5)), (0, (6, 2, 1.5, 2)))

_VARIABLES = {
    **{color: f"var(--s{i})" for i, color in enumerate(SERIES, 1)},
    INK: "var(--ink)", GRID: "var(--grid)", FAINT: "var(--faint)",
}  # fmt: skip

PANEL = (3.5, 2.5)
"""Inches of a panel: on a telephone it is about as wide as the screen."""

Style = dict[str, Any]
"""Colour and line of a series, as matplotlib names them."""

BEST: Style = {"color": SERIES[0], "linestyle": "-"}
SPREAD: Style = {"color": SERIES[3], "linestyle": "-"}
"""Of the best of several seeds, and of them all."""

_OWN: dict[tuple[str, str | None], tuple[int, int]] = {
    ("hpp", None): (0, 0), ("hpp", "paper"): (5, 0),
    ("centralized-mp", None): (1, 0), ("centralized-oa", None): (4, 0), ("centralized-rp", None): (6, 0),
    ("rrt-mp", None): (1, 1), ("rrt-oa", None): (4, 1), ("rrt-cem", None): (2, 1),
    ("maddpg", None): (3, 0), ("full-communication", None): (2, 2), ("perfect-model", None): (7, 2),
}  # fmt: skip


def planner_styles(planners: list[str]) -> dict[str, Style]:
    """Return a style a planner: everywhere the same for the plain ones, then whatever is left over."""
    styles: dict[str, Style] = {}
    used: set[tuple[int, int]] = set()
    for planner in planners:
        choice = parse_planner(planner)
        own = None if choice.settings else _OWN.get((choice.name, choice.preset))
        if own is not None and own not in used:
            used.add(own)
            styles[planner] = _style(*own)
    spare = ((color, dash) for dash in range(len(DASHES)) for color in range(len(SERIES)))
    for planner in planners:
        if planner not in styles:
            styles[planner] = _style(*next((each for each in spare if each not in used), (0, 0)))
    return {planner: styles[planner] for planner in planners}


def plain_styles(labels: list[str]) -> dict[str, Style]:
    """Return a style a label, in order."""
    return {label: _style(i % len(SERIES), i // len(SERIES) % len(DASHES)) for i, label in enumerate(labels)}


@contextmanager
def panel(width: float = PANEL[0], height: float = PANEL[1]) -> Generator[tuple[Figure, Any]]:
    """Give an empty figure and its axes, in the page's style; :func:`svg` within the context."""
    # text as text: small, and set in the page's own fonts
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "hpp", "font.size": 9}):
        figure = Figure(figsize=(width, height), layout="constrained")
        axes: Any = figure.add_subplot()
        axes.tick_params(colors=INK, labelcolor=INK, length=0, labelsize=9)
        axes.spines[["top", "right"]].set_visible(False)
        axes.spines[["left", "bottom"]].set_color(FAINT)
        axes.grid(color=GRID, linewidth=0.8)
        axes.set_axisbelow(True)
        yield figure, axes


def svg(figure: Figure, alt: str) -> Markup:
    """Return a figure as an element of the page.

    Args:
        figure: drawn in the colours of this module.
        alt: what it shows, in words.
    """
    stream = io.StringIO()
    figure.savefig(stream, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    text = stream.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
    text = _without_loose_ids(text)
    for color, variable in _VARIABLES.items():
        text = text.replace(color, variable)
    text = re.sub(r"font: ([\d.]+)px [^;\"]*", r"font-size: \1px", text)
    text = re.sub(r' (width|height)="[\d.]+pt"', "", text, count=2)
    text = text.replace("<svg ", '<svg role="img" ', 1)
    text = re.sub(r"(<svg[^>]*>)", lambda found: found.group(1) + tag("title", alt), text, count=1)
    return Markup(text.strip())


def with_own_names(body: Markup) -> Markup:
    """Return a page's body in which names within each figure have a beginning of their own."""
    count = itertools.count(1)

    def renamed(found: re.Match[str]) -> str:
        number = next(count)
        return re.sub(r'( id="|url\(#|href="#)', rf"\g<1>f{number}-", found.group(0))

    return Markup(re.sub(r'<svg role="img".*?</svg>', renamed, body, flags=re.DOTALL))


def key(styles: dict[str, Style]) -> Markup:
    """Return the legend of figures with the same series, as a list."""
    entries = [tag("li", _sample(style), " ", label) for label, style in styles.items()]
    return tag("ul", *entries, class_="key")


def _style(color: int, dash: int) -> Style:
    return {"color": SERIES[color], "linestyle": DASHES[dash]}


def _sample(style: Style) -> Markup:
    line = style["linestyle"]
    dashes = None if line == "-" else " ".join(str(2 * each) for each in line[1])
    color = _VARIABLES[style["color"]]
    stroke = tag("path", d="M0 5h30", stroke=color, stroke_width="3", fill="none", stroke_dasharray=dashes)
    return tag("svg", stroke, viewBox="0 0 30 10", width="30", height="10", aria_hidden="true")


def _without_loose_ids(text: str) -> str:
    """Leave out names that nothing in the figure refers to."""
    used = set(re.findall(r"url\(#([^)]+)\)", text)) | set(re.findall(r'href="#([^"]+)"', text))
    return re.sub(r' id="([^"]*)"', lambda found: found.group(0) if found.group(1) in used else "", text)
