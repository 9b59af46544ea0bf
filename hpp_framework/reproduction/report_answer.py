"""The answer in a few sentences, made of the numbers of the main comparison."""

from __future__ import annotations

from collections import Counter

from hpp_framework.config.planner_choice import parse_planner
from hpp_framework.evaluation.statistics import wilson_interval
from hpp_framework.reproduction.report_data import Ran, Reproduction, Row
from hpp_framework.reproduction.report_html import Markup, join, note, number, p_value, section, tag
from hpp_framework.reproduction.report_names import planner_label, privileged, world_label
from hpp_framework.reproduction.report_panels import NOT_RUN

ALL = "all"


def answer_section(found: Reproduction) -> Markup:
    """Return what came out, in tiles and sentences."""
    main = found.main
    if main is None or not main.rows("cells"):
        return section("answer", "The answer", note(NOT_RUN), _verdicts(found))
    method = main.planners[0]
    baseline = best_baseline(main)
    tiles = [_tile(main, method)]
    tiles += [_tile(main, each) for each in main.planners[1:] if parse_planner(each).name == "hpp"]
    tiles += [_tile(main, baseline)] if baseline else []
    return section(
        "answer", "The answer", tag("div", join(*tiles), class_="tiles"), _setting(main, method),
        _versus(main, baseline) if baseline else None, _worlds(main, method), _verdicts(found),
    )  # fmt: skip


def best_baseline(main: Ran) -> str | None:
    """Return the planner with the most successes that is neither the method nor told anything."""
    method = parse_planner(main.planners[0]).name
    others = [p for p in main.planners if not privileged(p) and parse_planner(p).name != method]
    return max(others, key=lambda planner: counts(main, planner)[0], default=None)


def counts(main: Ran, planner: str) -> tuple[int, int]:
    """Return how many episodes succeeded, and how many there were, over all worlds."""
    cells = [cell for cell in main.rows("cells") if cell["planner"] == planner]
    met = sum(round(cell["success"] * cell["episodes"]) for cell in cells)
    return met, sum(cell["episodes"] for cell in cells)


def _tile(main: Ran, planner: str) -> Markup:
    met, episodes = counts(main, planner)
    low, high = wilson_interval(met, episodes)
    return tag(
        "div", tag("b", _percent(met / episodes)), tag("span", planner_label(planner)),
        tag("small", f"of {episodes} episodes, {100 * low:.0f} to {100 * high:.0f} %"), class_="tile",
    )  # fmt: skip


def _setting(main: Ran, method: str) -> Markup:
    met, episodes = counts(main, method)
    cells = [cell for cell in main.rows("cells") if cell["planner"] == method]
    team = str(cells[0].get("team", "")).replace(",", " and ")
    return tag(
        "p", f"In {len(cells)} worlds with {cells[0]['episodes']} episodes each, a team of {team} that does "
        f"not communicate meets in {_percent(met / episodes)} of all episodes with {planner_label(method)} "
        f"(preset {cells[0]['preset']}).",
    )  # fmt: skip


def _versus(main: Ran, baseline: str) -> Markup:
    met, episodes = counts(main, baseline)
    name = ALL if len(main.worlds) > 1 else main.worlds[0]
    rows = [r for r in main.rows("comparisons") if (r["world"], r["against"]) == (name, baseline)]
    return tag(
        "p", f"The best baseline that is told no more than a robot knows, {planner_label(baseline)}, meets "
        f"in {_percent(met / episodes)}.", f" {_difference(rows[0])}" if rows else None,
    )  # fmt: skip


def _difference(row: Row) -> str:
    value, low, high = (number(100 * each, 0, sign=True) for each in row["success_difference"])
    better = row["improvement"][0]
    p = p_value(row["success_p"])
    return (
        f"On the same episodes the difference is {value} points (95 % interval {low} to "
        f"{high}, McNemar p {p if p.startswith('<') else '= ' + p}), and HPP does better on "
        f"{_percent(better)} of the episodes, ties counted half."
    )


def _worlds(main: Ran, method: str) -> Markup:
    """Return where a baseline that is told nothing more succeeds more often."""
    lost: list[str] = []
    for world in main.worlds:
        own = main.cell(world, method)
        others = [main.cell(world, planner) for planner in main.planners if not privileged(planner)]
        better = [cell for cell in others if cell and own and cell["success"] > own["success"]]
        lost += [f"{world_label(world)} ({planner_label(cell['planner'])} {cell['success']:.2f}, HPP "
                 f"{own['success']:.2f})" for cell in better[:1] if own]  # fmt: skip
    if not lost:
        return tag("p", "In no world does a baseline that is told no more succeed more often than HPP.")
    return tag("p", f"Another planner that is told no more succeeds more often in {', '.join(lost)}.")


def _verdicts(found: Reproduction) -> Markup | None:
    if not found.claims:
        return None
    counted = Counter(str(claim.get("verdict", "")) for claim in found.claims)
    told = ", ".join(f"{counted[text]} {text}" for text in sorted(counted))
    return tag(
        "p", f"Of {len(found.claims)} sentences of the paper that can be checked: {told}. ",
        tag("a", "The claims one by one", href="#claims"),
    )  # fmt: skip


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"
