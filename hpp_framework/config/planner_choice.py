"""Planners and policies as experiments name them, with settings: ``hpp:hysteresis=0.05``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, is_dataclass, replace
from typing import Any

from hpp_framework.config.settings import parse_settings, setting
from hpp_framework.core.planner import MetaPlanner, PlannerContext
from hpp_framework.core.policy import Policy
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import ConfigError

PRESET = "preset"
"""A setting that is not the planner's own: its preset."""
MOVED = ("guard", "guide")
"""Settings of earlier versions that are control layers now."""


@dataclass(frozen=True, kw_only=True)
class PlannerChoice:
    """A registered planner or policy and how it differs from its preset.

    Attributes:
        name: registered.
        is_policy: whether it drives by itself.
        preset: instead of the experiment's, or None.
        settings: by dotted name.
    """

    name: str
    is_policy: bool
    preset: str | None
    settings: Mapping[str, Any]


def parse_planner(text: str) -> PlannerChoice:
    """Read a planner from ``"hpp"``, ``"hpp:hysteresis=0.05"`` or ``"hpp:preset=paper:horizon=4"``.

    Args:
        text: a registered name, then settings, all separated by colons.

    Raises:
        ConfigError: if a setting is no ``name=value`` or comes twice, or is a control layer.
        UnknownNameError: if there is no such planner or policy.
    """
    name, *pairs = text.split(":")
    settings = parse_settings(pairs, f"planner '{text}'")
    is_policy = name in hub().policies
    if not is_policy:
        hub().planners.entry(name)
    for moved in MOVED:
        if moved in settings:
            raise ConfigError(
                f"planner '{text}': '{moved}' is no setting of a planner any more; all planners have the "
                "control stack of the experiment: see --control and `hpp list layers`."
            )
    preset = settings.pop(PRESET, None)
    return PlannerChoice(
        name=name, is_policy=is_policy, preset=None if preset is None else str(preset), settings=settings
    )


def make_planner(text: str, context: PlannerContext) -> MetaPlanner:
    """Build a planner with the settings of the context and its own.

    Settings of the context reach every planner that has parameters of these names; its own must be known.

    Args:
        text: as :func:`parse_planner` reads it.
        context: what its factory is told, apart from the planner's own preset and settings.

    Raises:
        ConfigError: if the planner has no such settings, or they are wrong.
    """
    return _make(text, context, policy=False)


def make_policy(text: str, context: PlannerContext) -> Policy:
    """Build a policy; see :func:`make_planner`."""
    return _make(text, context, policy=True)


def _make(text: str, context: PlannerContext, *, policy: bool) -> Any:
    choice = parse_planner(text)
    registry = hub().policies if policy else hub().planners
    settings = {**context.settings, **choice.settings}
    told = replace(context, preset=choice.preset or context.preset, settings=settings)
    try:
        made = registry.create(choice.name, told)
    except ConfigError:
        # settings of all may be unknown to this planner; those that it knows must be right
        made = registry.create(choice.name, replace(told, settings=choice.settings))
        shared = {name: value for name, value in context.settings.items() if has_setting(made, name)}
        told = replace(told, settings={**shared, **choice.settings})
        made = registry.create(choice.name, told)
    config = getattr(made, "config", None)
    if not is_dataclass(config):
        if choice.settings:
            raise ConfigError(f"planner '{choice.name}' has no settings, but '{text}' gives it some.")
    elif any(setting(config, name) != value for name, value in told.settings.items()):
        raise ConfigError(f"planner '{choice.name}' does not heed its settings: it has {config}.")
    return made


def has_setting(planner: object, name: str) -> bool:
    """Return whether a planner has a parameter of a dotted name."""
    part: Any = getattr(planner, "config", None)
    for key in name.split("."):
        if not is_dataclass(part) or not hasattr(part, key):
            return False
        part = getattr(part, key)
    return not is_dataclass(part)


def parameters(owner: object) -> dict[str, Any] | None:
    """Return the effective parameters of an agent, planner or layer, None without a dataclass ``config``."""
    config = getattr(owner, "config", None)
    return asdict(config) if is_dataclass(config) and not isinstance(config, type) else None
