"""Registers what this package brings."""

from __future__ import annotations

from pathlib import Path

from hpp_framework.registry import Hub


def register(hub: Hub) -> None:
    """Add everything of this package."""
    hub.robots.add("rover", "my_pkg.rover:rover", summary="a small base with two wheels and a lidar on top")
    hub.checkpoints.add("my_pkg", weights, summary="what teams have learnt of this package's robot")


def weights() -> Path:
    """Return the folder of the weights that come with this package."""
    return Path(__file__).parent / "weights"
