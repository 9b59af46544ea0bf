"""Registers what this package brings."""

from __future__ import annotations

from hpp_framework.plugins.registry import Hub


def register(hub: Hub) -> None:
    """Add everything of this package."""
    hub.tasks.add(
        "meet-at-door",
        "my_pkg.meet_at_door:meet_at_door",
        summary="all robots at rest at one place that all know",
    )
