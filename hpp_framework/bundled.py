"""Registers what the framework itself brings: worlds, planners and predictors, by the door that plugins use."""

from __future__ import annotations

from hpp_framework.registry import Hub


def register(hub: Hub) -> None:
    """Add the framework's own worlds, planners and predictors."""
    worlds = "hpp_framework.worlds"
    hub.worlds.add("training", f"{worlds}.generators:training", summary="random furniture, another room each seed")
