"""Registers the bundled robots."""

from __future__ import annotations

from hpp_framework.plugins.registry import Hub


def register(hub: Hub) -> None:
    """Add every robot of this package."""
    hub.robots.add("fetch", "hpp_robots.fetch:fetch", summary="mobile manipulator, the paper's drive limits")
    hub.robots.add(
        "fetch-real", "hpp_robots.fetch:fetch_real", summary="mobile manipulator, its own published limits"
    )
    hub.robots.add(
        "freight", "hpp_robots.freight:freight", summary="low transport base, the paper's drive limits"
    )
    hub.robots.add(
        "freight-real",
        "hpp_robots.freight:freight_real",
        summary="low transport base, its own published limits",
    )
