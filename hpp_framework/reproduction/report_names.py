"""What the report calls planners and worlds."""

from __future__ import annotations

from pathlib import Path

from hpp_framework.config.planner_choice import parse_planner

_PLANNERS = {
    "hpp": "HPP", "centralized-mp": "Centralized MP", "centralized-oa": "Centralized OA",
    "centralized-rp": "Centralized RP", "rrt-mp": "RRT+MP", "rrt-oa": "RRT+OA", "rrt-cem": "RRT+CEM",
    "maddpg": "MADDPG", "full-communication": "HPP that talks", "perfect-model": "perfect model",
}  # fmt: skip

_PRIVILEGED = ("full-communication", "perfect-model")
"""Ceilings: planners that are told what no robot knows."""


def planner_label(planner: str) -> str:
    """Return a planner as text shows it, e.g. ``"HPP, paper"`` for ``"hpp:preset=paper"``."""
    choice = parse_planner(planner)
    name = _PLANNERS.get(choice.name, choice.name)
    parts = [choice.preset] if choice.preset else []
    parts += [
        "true map" if (key, value) == ("known_map", True) else f"{key}={_plain(value)}"
        for key, value in choice.settings.items()
    ]
    return ", ".join([name, *parts])


def privileged(planner: str) -> bool:
    """Return whether a planner is told what no robot knows: a ceiling, or a baseline with the true map."""
    choice = parse_planner(planner)
    return choice.name in _PRIVILEGED or choice.settings.get("known_map") is True


def world_label(world: str) -> str:
    """Return a world as text shows it: its name, or that of its file."""
    return "all worlds" if world == "all" else Path(world).stem


def _plain(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
