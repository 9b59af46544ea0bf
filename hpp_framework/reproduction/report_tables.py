"""The report's tables: claims, the main comparison, aggregates, blame, predictor errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hpp_framework.evaluation.predictor_score import ALL_WORLDS
from hpp_framework.reproduction.report_data import Ran, Row
from hpp_framework.reproduction.report_html import (
    DASH,
    Column,
    Markup,
    anchor,
    interval,
    join,
    number,
    p_value,
    table,
    tag,
)
from hpp_framework.reproduction.report_names import planner_label, privileged, world_label

VERDICTS = {"holds": "good", "holds partly": "partly", "does not hold": "bad"}
"""What is said of a claim, and its class; anything else is open."""

_COMPARED = (
    Column("planner", number=False),
    Column("success", "share of episodes that end in a rendezvous, with its Wilson interval"),
    Column("time s", "median over successes"),
    Column("x bound", "median of time over the least time possible, over successes"),
    Column("RPL", "success times bound over time, mean over all episodes"),
    Column("RPL IQM", "mean of the middle half of all episodes, bootstrap interval"),
    Column("touched", "episodes in which a robot touched anything"),
    Column("HPP minus it", "paired difference of success, with its interval"),
    Column("McNemar p", "were both equally good, how often would they differ at least as much?"),
    Column("HPP better", "probability that the first planner does better on an episode"),
)


def claims_table(claims: Sequence[Row], known: Sequence[str]) -> Markup:
    """Return the claims, each with its verdict and evidence.

    Args:
        claims: as ``claims.json`` holds them.
        known: names of experiments, which are linked.
    """
    rows = [
        (
            join(str(claim.get("claim", "")), tag("small", str(claim.get("where", "")), class_="where")),
            join(verdict(str(claim.get("verdict", ""))), _by_preset(claim.get("presets"))),
            join(
                _paragraph(claim.get("evidence")),
                _numbers(claim.get("numbers")),
                _links(claim.get("experiments"), known),
            ),
        )
        for claim in claims
    ]
    heads = (
        Column("the paper says", number=False),
        Column("verdict", number=False),
        Column("evidence", number=False),
    )
    return tag("div", table(heads, rows, label="claims of the paper"), class_="claims")


def verdict(text: str) -> Markup:
    """Return a verdict as a coloured label."""
    return tag("span", text or "open", class_=f"verdict {VERDICTS.get(text, 'open')}")


def _by_preset(found: object) -> Markup | None:
    """Return the verdicts on each preset of HPP alone."""
    if not isinstance(found, dict) or not found:
        return None
    lines = [tag("li", f"{preset}: {text}") for preset, text in found.items()]
    return tag("ul", *lines, class_="presets")


def world_table(ran: Ran, world: str) -> Markup:
    """Return all planners of a comparison in one world."""
    aggregates = {row["planner"]: row for row in ran.rows("aggregates") if row["world"] == world}
    against = {row["against"]: row for row in ran.rows("comparisons") if row["world"] == world}
    rows = [
        _compared(cell, aggregates.get(cell["planner"], {}), against.get(cell["planner"], {}))
        for cell in ran.rows("cells")
        if cell["world"] == world
    ]
    return table(_COMPARED, rows, label=f"all planners in {world_label(world)}")


def overall_table(ran: Ran) -> Markup:
    """Return all planners of a comparison over all its worlds."""
    worlds = ran.worlds
    name = "all" if len(worlds) > 1 else worlds[0]
    against = {row["against"]: row for row in ran.rows("comparisons") if row["world"] == name}
    columns = (
        Column("planner", number=False),
        *(Column(world_label(world), f"success in {world_label(world)}") for world in worlds),
        Column("all", "success over all episodes"),
        Column("RPL IQM", "mean of the middle half of all episodes, bootstrap interval"),
        Column("gap", "1 minus mean RPL: how much is missing to the bound"),
        Column("HPP minus it", "paired difference of success, with its interval"),
        Column("McNemar p"),
        Column("HPP better", "probability that the first planner does better on an episode"),
    )
    rows: list[list[str]] = []
    for row in ran.rows("aggregates"):
        if row["world"] != name:
            continue
        planner = str(row["planner"])
        cells = [ran.cell(world, planner) for world in worlds]
        rows.append(
            [
                planner_head(planner),
                *(_share(cell) for cell in cells),
                number(overall_success(ran, planner)),
                interval(row["rpl_iqm"]),
                interval(row["optimality_gap"]),
                *_versus(against.get(planner, {})),
            ]
        )
    return table(columns, rows, label="all planners over all worlds")


def overall_success(ran: Ran, planner: str) -> float | None:
    """Return the share of successes over all episodes of a planner, None if it has not run."""
    cells = [cell for cell in ran.rows("cells") if cell["planner"] == planner]
    episodes = sum(cell["episodes"] for cell in cells)
    return sum(round(cell["success"] * cell["episodes"]) for cell in cells) / episodes if episodes else None


def blame_table(ran: Ran) -> Markup | None:
    """Return where HPP's success was lost; None unless both ceilings ran."""
    rows = [
        (world_label(row["world"]), number(row["success"]), interval(row["silence"], sign=True),
         interval(row["predictor"], sign=True), interval(row["skill"]))
        for row in ran.rows("blame")
    ]  # fmt: skip
    columns = (
        Column("world", number=False),
        Column("success"),
        Column("lost to silence", "success of the planner that talks minus success of HPP"),
        Column("lost to the predictor", "success with the perfect model minus success of the one that talks"),
        Column("lost to the skill", "what the perfect model misses"),
    )
    return table(columns, rows, label="where success was lost") if rows else None


def comparison_table(ran: Ran) -> Markup | None:
    """Return how the first planner compares with the others on the same episodes; None if it is alone."""
    rows = [
        (
            world_label(row["world"]),
            planner_label(row["against"]),
            interval(row["success_difference"], sign=True),
            p_value(row["success_p"]),
            interval(row["improvement"]),
            number(row["time_ratio_median"]),
            p_value(row["time_p"]),
        )
        for row in ran.rows("comparisons")
    ]
    if not rows:
        return None
    first = planner_label(ran.rows("comparisons")[0]["planner"])
    columns = (
        Column("world", number=False),
        Column(f"{first} against", number=False),
        Column("success", "paired difference"),
        Column("McNemar p"),
        Column("better", "probability of improvement"),
        Column("time ratio", "median where both succeed"),
        Column("Wilcoxon p", "of the times where both succeed"),
    )
    return table(columns, rows, label=f"{first} against the others")


def predictor_table(ran: Ran) -> Markup:
    """Return mean errors by role, predictor and horizon over all worlds of a study."""
    summary: list[Any] = list(ran.summary or [])
    pooled = [row for row in summary if row["world"] == ALL_WORLDS] or summary
    seconds = sorted({each["seconds"] for row in pooled for each in row["errors"]})
    columns = (
        Column("predictor", number=False), Column("of", number=False),
        *(Column(f"{s:g} s", "mean position error in metres; 90 % are better than the small number")
          for s in seconds),
    )  # fmt: skip
    rows = [
        (row["predictor"], "itself" if row["role"] == "self" else "the other",
         *(_error(row, second) for second in seconds))
        for row in sorted(pooled, key=lambda row: row["role"] != "self")
    ]  # fmt: skip
    return table(columns, rows, label="errors of predictors")


def planner_head(planner: str) -> Markup:
    """Return a planner's name; a mark says that it is told what no robot knows."""
    mark = tag("abbr", "told", title="is told what no robot knows") if privileged(planner) else None
    return tag("span", planner_label(planner), " " if mark else None, mark)


def _compared(cell: Row, aggregate: Row, against: Row) -> list[str]:
    success = (cell["success"], cell["success_low"], cell["success_high"])
    return [
        planner_head(cell["planner"]), interval(success), number(cell["time_median_s"], 1),
        number(cell["time_over_bound_median"]), number(cell["rpl"]), interval(aggregate.get("rpl_iqm")),
        f"{cell['collision_episodes']} / {cell['episodes']}", *_versus(against),
    ]  # fmt: skip


def _versus(against: Row) -> list[str]:
    return [
        interval(against.get("success_difference"), sign=True),
        p_value(against.get("success_p")),
        interval(against.get("improvement")),
    ]


def _share(cell: Row | None) -> str:
    return number(None if cell is None else cell["success"])


def _error(row: Row, seconds: float) -> str:
    found = next((each for each in row["errors"] if each["seconds"] == seconds), None)
    if found is None:
        return DASH
    return Markup(f"{number(found['mean_m'])} <small>{number(found['p90_m'])}</small>")


def _paragraph(text: object) -> Markup | None:
    return tag("p", str(text)) if text else None


def _numbers(found: object) -> Markup | None:
    """Return the numbers behind a verdict, folded away."""
    if not isinstance(found, dict | list) or not found:
        return None
    pairs = list(found.items()) if isinstance(found, dict) else list(enumerate(found, 1))
    lines = [tag("li", tag("b", str(name)), " ", _plain(value)) for name, value in pairs]
    return tag("details", tag("summary", "numbers"), tag("ul", *lines, class_="numbers"))


def _plain(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {_plain(each)}" for key, each in value.items())
    if isinstance(value, list):
        if len(value) == 3 and all(isinstance(each, float) for each in value):
            return interval(value)
        return ", ".join(map(_plain, value))
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _links(names: object, known: Sequence[str]) -> Markup | None:
    listed = [str(name) for name in names] if isinstance(names, list) else []
    links = [
        tag("a", name, href=f"#run-{anchor(name)}") if name in known else tag("span", name) for name in listed
    ]
    return tag("small", "from ", *_separated(links)) if links else None


def _separated(links: Sequence[Markup]) -> list[str]:
    return [part for link in links for part in (", ", link)][1:]
