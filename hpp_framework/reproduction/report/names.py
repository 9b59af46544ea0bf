"""What the report calls planners and worlds, and the colours of planners."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

COLORS = 8
"""Series that the page's style sheet has a colour for."""

_LABELS = {
    "hpp": "HPP", "centralized-mp": "Centralized MP", "centralized-oa": "Centralized OA",
    "centralized-rp": "Centralized RP", "rrt-mp": "RRT+MP", "rrt-oa": "RRT+OA", "rrt-cem": "RRT+CEM",
    "maddpg": "MADDPG", "full-communication": "HPP with full communication",
    "perfect-model": "HPP with perfect model", "preset=paper": "paper", "preset=best": "best",
    "known_map=true": "true map",
}  # fmt: skip
_PRIVILEGED = {"full-communication", "perfect-model", "known_map=true"}
"""Planners and settings that give a robot what it cannot know."""
_COLORS = {"hpp": 1, "hpp:preset=paper": 8, "centralized-mp": 2, "centralized-oa": 5, "centralized-rp": 7,
           "rrt-oa": 3, "maddpg": 4, "full-communication": 6}  # fmt: skip


def name_of(planner: str) -> str:
    """Return the registered name of a planner with settings."""
    return planner.split(":")[0]


def planner_label(planner: str) -> str:
    """Return a planner as text shows it, e.g. ``"HPP, paper"`` for ``"hpp:preset=paper"``."""
    return ", ".join(_LABELS.get(part, part) for part in planner.split(":"))


def privileged(planner: str) -> bool:
    """Return whether a planner is given what no robot knows: an oracle, or a baseline with the true map."""
    return not _PRIVILEGED.isdisjoint(planner.split(":"))


def world_label(world: str) -> str:
    """Return a world as text shows it: its name, or that of its file."""
    return "all worlds" if world == "all" else Path(world).stem


def anchor(text: str) -> str:
    """Return a name that links can lead to."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-") or "part"


def colors(planners: Sequence[str]) -> dict[str, int]:
    """Return a colour from 1 to :data:`COLORS` per planner; of too many, grey (0) for all but the first.

    Well-known planners have the same colour in every chart; no two in a chart share one.
    """
    if len(set(planners)) > COLORS:
        return {planner: int(planner == planners[0]) for planner in planners}
    own = {planner: _COLORS[planner] for planner in planners if planner in _COLORS}
    spare = (color for color in range(1, COLORS + 1) if color not in own.values())
    return {planner: own[planner] if planner in own else next(spare) for planner in dict.fromkeys(planners)}
