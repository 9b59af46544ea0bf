"""Writes the page: data of the reproduction, put into the template ``page.html``.

The same folder gives the same page: it holds no times but those that were measured.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from hpp_framework.evaluation.statistics import wilson_interval
from hpp_framework.reproduction.report import blocks, names
from hpp_framework.reproduction.report.films import REPORT, shown_cells
from hpp_framework.reproduction.report.paper import CITATION
from hpp_framework.reproduction.report.results import Ran, Row, read_reproduction
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.run_folder import replacing

PAGE = "index.html"
DASH, MINUS = "\u2013", "\u2212"


def write_report(out: Path, *, films: bool = True, say: Callable[[str], None] = lambda _: None) -> Path:
    """Write the report of what a reproduction has left so far; what is missing is shown as not run.

    Args:
        out: folder of the reproduction, with its ``plan.json``.
        films: whether chosen episodes are filmed; that runs their cells once more, the first time.
        say: called with lines for the user.

    Returns:
        The page, ``OUT/report/index.html``.

    Raises:
        ConfigError: if the folder holds no plan, a file in it is damaged, or the page cannot be written.
    """
    found = read_reproduction(out)
    main = found.main
    # undefined names in a template are mistakes of ours
    templates = Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    templates.filters.update(FILTERS)
    page = templates.get_template("page.html").render(
        found=found, main=main, answer=answer(main) if main else None, citation=CITATION, blocks=blocks,
        cells=shown_cells(main, out, say) if films and main else [],
    )  # fmt: skip
    file = out / REPORT / PAGE
    try:
        with replacing(file) as temporary:
            temporary.write_text(page, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"'{file}' could not be written: {error.strerror or error}.") from error
    return file


def answer(main: Ran) -> dict[str, Any]:
    """Return what the main comparison says in a few numbers.

    The method is the planner that is compared with the others. Its rivals are neither variants of it nor
    privileged; the ``baseline`` is the one with the most successes, ``versus`` the comparison with it over
    all worlds. ``lost`` holds a rival's row and the method's for each world in which the rival did better.
    """
    method, *others = main.planners
    fair = [planner for planner in others if not names.privileged(planner)]
    variants = [planner for planner in fair if names.name_of(planner) == names.name_of(method)]
    rivals = [planner for planner in fair if planner not in variants]
    baseline = max(rivals, key=lambda planner: main.counts(planner)[0], default=None)
    lost: list[tuple[Row, Row]] = []
    for own in main.rows("cells", planner=method):
        rows = [main.row("cells", world=own["world"], planner=planner) for planner in fair]
        lost += [(row, own) for row in rows if row and row["success"] > own["success"]][:1]
    counts = {planner: main.counts(planner) for planner in (method, *variants, baseline) if planner}
    tiles = {planner: (met / of, *wilson_interval(met, of), of) for planner, (met, of) in counts.items()}
    return {
        "method": method, "baseline": baseline, "lost": lost, "cells": main.rows("cells", planner=method),
        "tiles": tiles,
        "versus": main.row("comparisons", world=main.strata[-1], against=baseline or ""),
    }  # fmt: skip


def number(value: float | None, digits: int = 2, sign: bool = False) -> str:
    """Return a number as tables show it; a dash for none."""
    return DASH if value is None else f"{value:{'+' if sign else ''}.{digits}f}".replace("-", MINUS)


def p_value(value: float | None) -> str:
    """Return a p value with as many digits as mean anything."""
    return "< 0.001" if value is not None and value < 0.001 else number(value, 3)


FILTERS: dict[str, Any] = {
    "number": number,
    "p": p_value,
    "percent": lambda share: f"{100 * share:.0f} %",
    "seconds": lambda seconds: f"{seconds:g} s",
    "pretty": lambda data: json.dumps(data, indent=2),
    "anchor": names.anchor,
    "planner": names.planner_label,
    "privileged": names.privileged,
    "world": names.world_label,
}
"""What the template may do to a value."""
