"""Writes the verdicts on the paper's statements."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

from hpp_framework.reproduction.statements import claims
from hpp_framework.utils.run_folder import write_json

CLAIMS = "claims.json"


def write_claims(out: Path) -> list[dict[str, Any]]:
    """Judge the paper's statements by all that was measured so far.

    Args:
        out: folder of the reproduction; ``claims.json`` is written there.

    Returns:
        What it holds: a row a claim.

    Raises:
        ConfigError: if results are damaged.
    """
    rows = [claim.as_row() for claim in claims(out)]
    # numbers that are not finite are no JSON
    write_json(out / CLAIMS, _finite(rows))
    return rows


def verdict_lines(rows: list[dict[str, Any]]) -> list[str]:
    """Return the verdicts as lines of text, and how often each was given."""
    width = max(len(row["verdict"]) for row in rows)
    counts = Counter(row["verdict"] for row in rows)
    total = ", ".join(f"{count} {verdict}" for verdict, count in counts.most_common())
    lines = [f"{row['verdict']:{width}}  {row['claim']}{_presets(row)}" for row in rows]
    return [*lines, f"claims of the paper: {total}"]


def _presets(row: dict[str, Any]) -> str:
    told = ", ".join(f"{preset}: {verdict}" for preset, verdict in row["presets"].items())
    return f" [{told}]" if told else ""


def _finite(value: Any) -> Any:
    """Return plain data with None for what is infinite or no number."""
    if isinstance(value, dict):
        return {key: _finite(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_finite(each) for each in value]
    return None if isinstance(value, float) and not abs(value) < float("inf") else value
