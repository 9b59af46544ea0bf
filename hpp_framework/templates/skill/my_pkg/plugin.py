"""Registers what this package brings."""

from __future__ import annotations

from pathlib import Path

from hpp_framework.plugins.registry import Hub


def register(hub: Hub) -> None:
    """Add everything of this package."""
    hub.skills.add(
        "sample-skill",
        "my_pkg.sample_skill:sample_skill",
        summary="to the free direction nearest to the goal's, slowly where it is narrow",
    )
    hub.checkpoints.add("my_pkg", weights, summary="what teams have learnt of this package's skill")


def weights() -> Path:
    """Return the folder of the weights that come with this package."""
    return Path(__file__).parent / "weights"
