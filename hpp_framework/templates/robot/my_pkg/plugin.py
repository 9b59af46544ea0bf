"""Registers what this package brings."""

from __future__ import annotations

from pathlib import Path

from hpp_framework.plugins.registry import Hub


def register(hub: Hub) -> None:
    """Add everything of this package."""
    hub.robots.add(
        "sample-rover",
        "my_pkg.sample_rover:sample_rover",
        summary="a base with two driven wheels and a lidar",
    )
    hub.checkpoints.add("my_pkg", weights, summary="what teams have learnt of this package's robot")


def weights() -> Path:
    """Return the folder of the weights that come with this package."""
    return Path(__file__).parent / "weights"
