"""Planners as experiments name them: with settings of their own, e.g. ``hpp:keep=0.05:memory=0``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, is_dataclass
from typing import Any

from hpp_framework.config.settings import parse_settings, setting
from hpp_framework.core.planner import MetaPlanner, PlannerContext
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import ConfigError

PRESET, GUARD, GUIDE = "preset", "guard", "guide"
"""Settings that are not the planner's own: its preset, and whether its agents have a guard and a guide."""


@dataclass(frozen=True, kw_only=True)
class PlannerChoice:
    """A registered planner and how it differs from its preset.

    Attributes:
        name: registered meta-planner.
        preset: instead of the experiment's, or None.
        guard: whether agents have a :class:`~hpp_framework.control.safety_filter.Guard`.
        guide: whether agents have a :class:`~hpp_framework.control.rotate_to_path.Guide`; None leaves it to
            the planner.
        settings: by dotted name.
    """

    name: str
    preset: str | None
    guard: bool
    guide: bool | None
    settings: Mapping[str, Any]


def parse_planner(text: str) -> PlannerChoice:
    """Read a planner from ``"hpp"``, ``"hpp:keep=0.05:memory=0"`` or ``"hpp:preset=paper:guard=false"``.

    Args:
        text: a registered name, then settings, all separated by colons.

    Raises:
        ConfigError: if a setting is no ``name=value`` or comes twice, or guard or guide is not true or false.
        UnknownNameError: if there is no such planner.
    """
    name, *pairs = text.split(":")
    settings = parse_settings(pairs, f"planner '{text}'")
    hub().planners.entry(name)
    preset, guard, guide = settings.pop(PRESET, None), settings.pop(GUARD, True), settings.pop(GUIDE, None)
    for switch, value in ((GUARD, guard), (GUIDE, guide)):
        if not isinstance(value, bool | None):
            raise ConfigError(f"planner '{text}': {switch} must be true or false, got {value!r}.")
    return PlannerChoice(
        name=name, preset=None if preset is None else str(preset), guard=guard is not False, guide=guide,
        settings=settings,
    )  # fmt: skip


def make_planner(text: str, context: PlannerContext) -> MetaPlanner:
    """Build a planner with the settings of the context and its own.

    Settings of the context reach every planner that has parameters; others are built as they are.

    Args:
        text: as :func:`parse_planner` reads it.
        context: what its factory is told, apart from the planner's own preset and settings.

    Raises:
        ConfigError: if the planner has no such settings, or they are wrong.
    """
    choice = parse_planner(text)
    settings = {**context.settings, **choice.settings}
    planner: MetaPlanner = hub().planners.create(
        choice.name,
        PlannerContext(
            team=context.team, agent=context.agent, task=context.task, preset=choice.preset or context.preset,
            bounds=context.bounds, weights=context.weights, settings=settings,
        ),
    )  # fmt: skip
    config = getattr(planner, "config", None)
    if not is_dataclass(config):
        if choice.settings:
            raise ConfigError(f"planner '{choice.name}' has no settings, but '{text}' gives it some.")
    elif any(setting(config, name) != value for name, value in settings.items()):
        raise ConfigError(f"planner '{choice.name}' does not heed its settings: it has {config}.")
    return planner


def parameters(planner: MetaPlanner) -> dict[str, Any] | None:
    """Return the effective parameters of a planner, None if it keeps none in a dataclass ``config``."""
    config = getattr(planner, "config", None)
    return asdict(config) if is_dataclass(config) and not isinstance(config, type) else None
