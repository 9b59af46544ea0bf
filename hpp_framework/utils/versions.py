"""Versions of what is installed."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version

PACKAGES = ("hpp-framework", "torch", "numpy", "warp-lang", "sapien", "scipy")
"""Packages that numbers may depend on."""


def installed_versions() -> dict[str, str | None]:
    """Return the versions that numbers may depend on."""
    return {"python": platform.python_version(), **installed(PACKAGES)}


def installed(packages: Sequence[str]) -> dict[str, str | None]:
    """Return the version of each package, None for one that is missing."""
    found: dict[str, str | None] = {}
    for name in packages:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = None
    return found
