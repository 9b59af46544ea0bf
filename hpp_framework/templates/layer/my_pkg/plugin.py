"""Registers what this package brings."""

from __future__ import annotations

from hpp_framework.plugins.registry import Hub


def register(hub: Hub) -> None:
    """Add everything of this package."""
    hub.layers.add("sample-layer", "my_pkg.sample_layer:sample_layer", summary="drives slowly near teammates")
