"""Training curves, from the cards of the weights."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hpp_framework.core.predictor import PredictorRequest
from hpp_framework.evaluation.folder import SUMMARY
from hpp_framework.planning.baselines.maddpg import KIND, file_name
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.weights import find_weights, weight_folders
from hpp_framework.prediction.library import find_cards
from hpp_framework.reproduction.plan import Curves
from hpp_framework.utils.run_folder import read_json, write_json


def collect_curves(work: Curves, folder: Path) -> None:
    """Write the cards that hold the curves to ``summary.json``.

    It holds MADDPG's card (``curves``: by seed, ``judged``: what was kept), or ``losses`` by kind and model,
    each a list of (gradient steps, loss).

    Args:
        work: which curves.
        folder: where they go.

    Raises:
        CheckpointError: if MADDPG was not trained for the team.
    """
    content = _maddpg(work) if work.source == "maddpg" else {"losses": _losses(work)}
    write_json(folder / SUMMARY, content)


def _maddpg(work: Curves) -> dict[str, Any]:
    name = file_name(parse_team(work.team).robots)
    folders = weight_folders(tuple(map(Path, work.weights)))
    remedy = f"Train it: hpp train maddpg --team {work.team}"
    return read_json(find_weights(folders, "planner", KIND, name, remedy).with_suffix(".json"))


def _losses(work: Curves) -> dict[str, Any]:
    team = parse_team(work.team)
    found: dict[str, dict[str, Any]] = {}
    for kind in work.predictors:
        cards: dict[str, dict[str, Any]] = {}
        for agent in range(len(team)):
            request = PredictorRequest(team=team, agent=agent, folders=tuple(map(Path, work.weights)))
            cards |= find_cards(kind, request)
        found[kind] = {model: card["curve"] for model, card in sorted(cards.items()) if card.get("curve")}
    return found
