"""The report about predictors as Markdown: tables and pictures of a run folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hpp_framework.evaluation.predictor_score import ALL_WORLDS

WORLD_SECONDS = 5.0
"""Horizon of the table by world."""
LEVELS = (50, 80, 90, 95)


def report(summary: Sequence[dict[str, Any]], pictures: Sequence[str]) -> str:
    """Return the report.

    Args:
        summary: of :func:`hpp_framework.evaluation.predictor_study.run_study`.
        pictures: files beside the report.
    """
    first = summary[0]
    everywhere = ALL_WORLDS if any(row["world"] == ALL_WORLDS for row in summary) else first["world"]
    pooled = [row for row in summary if row["world"] == everywhere]
    worlds = list(dict.fromkeys(row["world"] for row in summary if row["world"] != ALL_WORLDS))
    parts = [
        f"# Predictors of {first['team']}\n",
        f"{first['trajectories']} trajectories per world ({', '.join(Path(w).stem for w in worlds)}), seed "
        f"{first['seed']}.\n",
        f"Mean position error in metres, {everywhere}; 90 % of the predictions are better than the number in "
        "brackets.\n",
        *horizon_table(pooled),
        f"\nMean position error {WORLD_SECONDS:g} s ahead in metres, with 95 % intervals in which a "
        "trajectory counts once.\n",
        *world_table(summary, worlds),
        *calibration_table(pooled),
        "",
        *(f"![{Path(picture).stem}]({picture})\n" for picture in pictures),
    ]
    return "\n".join(parts)


def horizon_table(pooled: Sequence[dict[str, Any]]) -> list[str]:
    """Return errors by role, predictor and horizon."""
    seconds = list(dict.fromkeys(each["seconds"] for row in pooled for each in row["errors"]))
    lines = _head("of", "predictor", *(f"{s:g} s" for s in sorted(seconds)))
    for row in _by_role(pooled):
        found = {each["seconds"]: f"{each['mean_m']:.2f} ({each['p90_m']:.2f})" for each in row["errors"]}
        lines.append(
            _line(row["role"], f"`{row['predictor']}`", *(found.get(s, "") for s in sorted(seconds)))
        )
    return lines


def world_table(summary: Sequence[dict[str, Any]], worlds: Sequence[str]) -> list[str]:
    """Return errors at :data:`WORLD_SECONDS` by role, predictor and world."""
    cells: dict[tuple[str, str, str], str] = {}
    for row in summary:
        for each in row["errors"]:
            if each["seconds"] == WORLD_SECONDS:
                cells[row["predictor"], row["role"], row["world"]] = (
                    f"{each['mean_m']:.2f} ({each['mean_low_m']:.2f} to {each['mean_high_m']:.2f})"
                )
    lines = _head("of", "predictor", *(f"`{Path(world).stem}`" for world in worlds))
    for row in _by_role([row for row in summary if row["world"] == worlds[0]]):
        name, role = row["predictor"], row["role"]
        lines.append(_line(role, f"`{name}`", *(cells.get((name, role, world), "") for world in worlds)))
    return lines


def calibration_table(pooled: Sequence[dict[str, Any]]) -> list[str]:
    """Return coverages, over all horizons, of the predictors that say how sure they are."""
    sure = [row for row in _by_role(pooled) if "calibration" in row]
    if not sure:
        return []
    lines = [
        "\nShare of true positions in the regions that should hold 50, 80, 90 and 95 % of them, and mean "
        "negative log-likelihood (nats; in brackets that of the best deviation by horizon alone).\n",
        *_head("of", "predictor", *(f"{level} %" for level in LEVELS), "NLL"),
    ]
    for row in sure:
        found = row["calibration"]
        shares = (f"{found[f'coverage_{level}']:.3f}" for level in LEVELS)
        nll = f"{found['nll']:.2f} ({found['nll_constant']:.2f})"
        lines.append(_line(row["role"], f"`{row['predictor']}`", *shares, nll))
    return lines


def _by_role(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    return sorted(rows, key=lambda row: row["role"] != "self")


def _head(*titles: str) -> list[str]:
    return [_line(*titles), "|" + "---|" * len(titles)]


def _line(*cells: str) -> str:
    return "| " + " | ".join(cells) + " |"
