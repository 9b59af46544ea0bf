"""Settings given as ``name=value``: for copies of config dataclasses, and for calls of factories."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from inspect import Parameter, signature
from typing import Any, TypeVar, cast

from hpp_framework.config.yaml_files import parse_yaml
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.validation import show, unknown

Config = TypeVar("Config")
Built = TypeVar("Built")

KINDS: Mapping[str, Any] = {"float": 0.0, "int": 0, "str": "", "bool": False}
"""Values of the kinds that settings without a default can be."""
BY_NAME = (Parameter.POSITIONAL_OR_KEYWORD, Parameter.KEYWORD_ONLY)


def parse_settings(pairs: Sequence[str], option: str) -> dict[str, Any]:
    """Read ``name=value`` pairs; values are numbers, true, false or text, as YAML has them.

    Raises:
        ConfigError: if a pair has no name or no ``=``, a name comes twice, or a value is malformed.
    """
    settings: dict[str, Any] = {}
    for pair in pairs:
        name, equals, value = pair.partition("=")
        if not name or not equals:
            raise ConfigError(f"{option} takes NAME=VALUE, e.g. reward.touch=-0.4; got '{pair}'.")
        if name in settings:
            raise ConfigError(f"{option} gives '{name}' twice.")
        settings[name] = _value(value, f"{option}, setting '{name}'")
    return settings


def _value(text: str, where: str) -> Any:
    # YAML takes 1e-4 for text
    if re.fullmatch(r"[-+]?[0-9.]+e[-+]?[0-9]+", text, re.IGNORECASE):
        with suppress(ValueError):
            return float(text)
    return parse_yaml(text, where)


def altered(config: Config, settings: Mapping[str, Any], owner: str) -> Config:
    """Return a copy of a config dataclass with other settings.

    Args:
        config: the values to start from; dataclasses may lie in it.
            A class attribute ``RENAMED`` maps names that fields once had to those they have.
        settings: values by dotted name, e.g. ``{"hysteresis": 0.05, "cem.samples": 30}``.
        owner: whose settings these are, for messages, e.g. ``"the recipe"``.

    Raises:
        ConfigError: if a name is unknown, or a value is of another type than the one it replaces; whatever
            the dataclass itself refuses.
    """
    changes: dict[str, Any] = {}
    for name, value in settings.items():
        path = name.split(".")
        inner = changes.get(path[0], getattr(config, path[0], None))
        changes[path[0]] = _altered(config, inner, name, path, value, owner)
    # at once: one value may only be right beside another
    return replace(cast("Any", config), **changes)


def setting(config: Any, name: str) -> Any:
    """Return the value of a setting.

    Args:
        config: a dataclass.
        name: dotted, as :func:`altered` takes it.
    """
    for part in name.split("."):
        config = getattr(config, part)
    return config


def _altered(config: Any, old: Any, name: str, path: list[str], value: Any, owner: str) -> Any:
    """Return the new value of the field of a config that a dotted name begins with.

    Args:
        config: that has the field.
        old: value of the field.
        name: dotted, for messages.
        path: the name from the field on.
        value: that the name is to have.
        owner: whose settings these are.
    """
    known = {each.name: each for each in fields(config)}
    if path[0] not in known:
        now = getattr(type(config), "RENAMED", {}).get(path[0])
        remedy = f"It is now called '{now}'." if now else unknown(path[0], list(known))
        raise ConfigError(f"'{name}' is no setting of {owner}: {path[0]!r} is unknown. {remedy}")
    if is_dataclass(old) and len(path) > 1:
        inner = _altered(old, getattr(old, path[1], None), name, path[1:], value, owner)
        return replace(cast("Any", old), **{path[1]: inner})
    if is_dataclass(old) or len(path) > 1:
        example = f"e.g. '{name}.{fields(old)[0].name}'" if is_dataclass(old) else f"it ends at '{path[0]}'"
        raise ConfigError(f"'{name}' names no single setting of {owner}; {example}.")
    return _like(old, value, name, owner, may_be_none="None" in str(known[path[0]].type))


def _like(old: Any, value: Any, name: str, owner: str, *, may_be_none: bool) -> Any:
    """Return a value that may replace another one, an int as a float where that is one."""
    if isinstance(old, float) and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if type(value) is not type(old) and not (may_be_none and (value is None or old is None)):
        raise ConfigError(f"'{name}' of {owner} must be {_kind(old)}, got {show(value)}.")
    if not _finite(value):
        raise ConfigError(f"'{name}' of {owner} must be finite, got {show(value)}.")
    return value


def _finite(value: Any) -> bool:
    """Return whether all numbers in a value are finite."""
    if isinstance(value, list | tuple):
        return all(map(_finite, cast("Sequence[Any]", value)))
    return not isinstance(value, float) or math.isfinite(value)


def _kind(example: Any) -> str:
    """Return in words what a value like an example is."""
    if isinstance(example, bool):
        return "true or false"
    words = {int: "a whole number", float: "a number", str: "text"}
    return f"{words.get(type(example), 'of the kind')} (like {example!r})"


def _example(parameter: Parameter) -> Any:
    """Return a value like those that a parameter takes: its default, else one of its annotated kind."""
    if parameter.default is not Parameter.empty and parameter.default is not None:
        return parameter.default
    kind = getattr(parameter.annotation, "__name__", parameter.annotation)
    return KINDS.get(str(kind).removesuffix(" | None"))


def call_with(
    factory: Callable[..., Built], told: Mapping[str, Any], settings: Mapping[str, Any], owner: str
) -> Built:
    """Call a factory with settings for its keyword parameters, whose kinds are checked.

    Args:
        factory: its settings are what it can be given by name beyond what it is told.
        told: what every factory of the kind is given, by name: the first as the first argument, whatever it
            calls it, the others where it has a parameter of the name.
        settings: values by name.
        owner: whose settings these are, for messages, e.g. ``"task 'formation'"``.

    Raises:
        ConfigError: if a name is unknown, a value is of another kind than the default or the annotation, or
            one without a default is missing; whatever the factory itself refuses.
    """
    others = list(signature(factory).parameters.values())[1:]
    known = {each.name: each for each in others if each.name not in told and each.kind in BY_NAME}
    for name in settings:
        if name not in known:
            listing = unknown(name, list(known)) if known else "It has none."
            raise ConfigError(f"'{name}' is no setting of {owner}. {listing}")
    required = [name for name, each in known.items() if each.default is Parameter.empty]
    missing = [name for name in required if name not in settings]
    if missing:
        raise ConfigError(f"{owner} needs '{missing[0]}'. Its settings: {', '.join(known)}.")
    values: dict[str, Any] = {}
    for name, value in settings.items():
        values[name] = tuple(value) if isinstance(value, list) else value
        old, may_be_none = _example(known[name]), "None" in str(known[name].annotation)
        values[name] = _like(old, values[name], name, owner, may_be_none=may_be_none or old is None)
    passed = {each.name: told[each.name] for each in others if each.name in told}
    return factory(next(iter(told.values())), **passed, **values)
