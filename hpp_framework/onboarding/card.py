"""What came out of an onboarding, for people and for programs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hpp_framework.evaluation.folder import SUMMARY
from hpp_framework.onboarding.config import Onboarding
from hpp_framework.utils.run_folder import load_json, write_json, write_text
from hpp_framework.utils.versions import installed_versions

CARD = "card"
SERIOUS = 1000
"""Gradient steps below which a model has learnt next to nothing."""
SECONDS = (1.0, 5.0)
"""Horizons whose errors the card shows."""


def write_card(onboarding: Onboarding, out: Path) -> Path:
    """Write ``card.json`` and ``card.md`` from what the stages left; returns the latter."""
    card = {
        "onboarding": onboarding.record(),
        "skill": _summaries(out / "skill"),
        "predictors": _summaries(out / "predictors"),
        "rendezvous": _summaries(out / "rendezvous"),
        "versions": installed_versions(),
    }
    write_json(out / f"{CARD}.json", card)
    return write_text(out / f"{CARD}.md", "\n".join(_lines(onboarding, card)) + "\n")


def _summaries(folder: Path) -> dict[str, Any]:
    """Return what stages of one kind came to, by the robots they are about."""
    files = sorted(folder.glob(f"*/{SUMMARY}"))
    return {file.parent.name: load_json(file) for file in files}


def _lines(onboarding: Onboarding, card: dict[str, Any]) -> Iterator[str]:
    kind = "Robot" if onboarding.is_robot else "Skill"
    yield f"# {kind} `{onboarding.newcomer}`"
    yield f"\nSkill `{onboarding.skill}`, motion models `{onboarding.predictor}`, seed {onboarding.seed}."
    scale = onboarding.scale
    yield (
        f"\nTrained by {scale.skill_steps:,} control steps per skill ({scale.further_steps:,} where "
        f"another's weights are a start) and {scale.predictor_steps:,} gradient steps per model, on "
        f"{scale.trajectories:,} trajectories per pair."
    )
    if scale.predictor_steps < SERIOUS:
        yield "\nA trial of the stages: the models have learnt next to nothing, and numbers say little."
    yield "\n| skill of | world | success (95 %) | clean | collided | froze |\n|---|---|---|---|---|---|"
    for robot, rows in card["skill"].items():
        for row in rows:
            found = row["summary"]
            yield (
                f"| `{robot}` | `{row['world']}` | {_share(found)} | {found['clean']:.2f} | "
                f"{found['collision']:.2f} | {found['freeze']:.2f} |"
            )
    yield "\nMean error of predicted positions in metres.\n"
    yield "| team | of | predictor | " + " | ".join(f"{seconds:g} s" for seconds in SECONDS) + " |"
    yield "|---|---|---|" + "---|" * len(SECONDS)
    for team, rows in card["predictors"].items():
        for row in rows:
            yield f"| `{team}` | {row['role']} | `{row['predictor']}` | {_errors(row)} |"
    yield "\n| team | world | planner | meet (95 %) | median time | touched |\n|---|---|---|---|---|---|"
    for team, summary in card["rendezvous"].items():
        for cell in summary["cells"]:
            time = "-" if cell["time_median_s"] is None else f"{cell['time_median_s']:.1f} s"
            touched = f"{cell['collision_episodes']}/{cell['episodes']}"
            where = f"`{team}` | `{cell['world']}` | `{cell['planner']}`"
            yield f"| {where} | {_share(cell)} | {time} | {touched} |"


def _share(found: dict[str, Any]) -> str:
    return f"{found['success']:.2f} ({found['success_low']:.2f} to {found['success_high']:.2f})"


def _errors(row: dict[str, Any]) -> str:
    by_seconds = {each["seconds"]: each for each in row["errors"]}
    cells = (by_seconds.get(seconds) for seconds in SECONDS)
    return " | ".join("-" if cell is None else f"{cell['mean_m']:.2f}" for cell in cells)
