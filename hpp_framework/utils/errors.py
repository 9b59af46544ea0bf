"""Errors that say what was wrong, where, and what would be right."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class HppError(Exception):
    """Base of every error a user can cause; the command line prints it without a traceback."""


class ConfigError(HppError):
    """A value, a file or a combination of options is wrong."""


class UnknownNameError(HppError):
    """A name is not in a registry."""


class PluginError(HppError):
    """A plugin could not be loaded or registered."""


class SimulatorError(HppError):
    """A simulator got unusable input or a backend is missing."""


class CheckpointError(HppError):
    """A weights file is missing, damaged, or was made for something else."""


class HppWarning(UserWarning):
    """Base of the warnings of this package."""


def reason(error: OSError) -> str:
    """Return why the system refused, in words."""
    return error.strerror or str(error) or type(error).__name__


def suggest(name: str, known: Iterable[str]) -> str:
    """Return `` Did you mean 'x'?`` for the nearest known name, or an empty string."""
    names = list(known)
    begun = [other for other in names if name and other.startswith(name)]
    close = begun or difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    return f" Did you mean '{close[0]}'?" if close else ""


def unknown_name(kind: str, name: str, known: Iterable[str]) -> UnknownNameError:
    """Build the error for a name that no registry entry has.

    Args:
        kind: what was looked up, singular, e.g. ``"planner"``.
        name: the name that was given.
        known: the names that exist.
    """
    names = sorted(known)
    listing = ", ".join(names) if names else "none"
    return UnknownNameError(f"There is no {kind} called '{name}'.{suggest(name, names)} Known: {listing}.")
