"""Settings given as ``name=value``: copies of config dataclasses with other values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar

import yaml

from hpp_framework.errors import ConfigError, suggest

Config = TypeVar("Config")


def parse_settings(pairs: Sequence[str], option: str) -> dict[str, Any]:
    """Read ``name=value`` pairs; values are numbers, true, false or text, as YAML has them.

    Raises:
        ConfigError: if a pair has no name or no ``=``, or a name comes twice.
    """
    settings: dict[str, Any] = {}
    for pair in pairs:
        name, equals, value = pair.partition("=")
        if not name or not equals:
            raise ConfigError(f"{option} takes NAME=VALUE, e.g. reward.touch=-0.4; got '{pair}'.")
        if name in settings:
            raise ConfigError(f"{option} gives '{name}' twice.")
        settings[name] = _value(value)
    return settings


def _value(text: str) -> Any:
    # YAML takes 1e-4 for text
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    return yaml.safe_load(text)


def altered(config: Config, settings: Mapping[str, Any], owner: str) -> Config:
    """Return a copy of a config dataclass with other settings.

    Args:
        config: the values to start from; dataclasses may lie in it.
        settings: values by dotted name, e.g. ``{"keep": 0.05, "cem.samples": 30}``.
        owner: whose settings these are, for messages, e.g. ``"the recipe"``.

    Raises:
        ConfigError: if a name is unknown, or a value is of another type than the one it replaces; whatever
            the dataclass itself refuses.
    """
    for name, value in settings.items():
        config = _altered(config, name, name.split("."), value, owner)
    return config


def setting(config: Any, name: str) -> Any:
    """Return the value of a setting.

    Args:
        config: a dataclass.
        name: dotted, as :func:`altered` takes it.
    """
    for part in name.split("."):
        config = getattr(config, part)
    return config


def _altered(config: Any, name: str, path: list[str], value: Any, owner: str) -> Any:
    known = {each.name: each for each in fields(config)}
    if path[0] not in known:
        hint = suggest(path[0], known).strip()
        raise ConfigError(
            f"'{name}' is no setting of {owner}: {path[0]!r} is unknown. {hint} "
            f"Known here: {', '.join(known)}."
        )
    old = getattr(config, path[0])
    if is_dataclass(old) and len(path) > 1:
        return replace(config, **{path[0]: _altered(old, name, path[1:], value, owner)})
    if is_dataclass(old) or len(path) > 1:
        example = f"e.g. '{name}.{fields(old)[0].name}'" if is_dataclass(old) else f"it ends at '{path[0]}'"
        raise ConfigError(f"'{name}' names no single setting of {owner}; {example}.")
    may_be_none = "None" in str(known[path[0]].type)
    if isinstance(old, float) and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if type(value) is not type(old) and not (may_be_none and None in (value, old)):
        raise ConfigError(f"'{name}' of {owner} must be of the kind of {old!r}, got {value!r}.")
    return replace(config, **{path[0]: value})
