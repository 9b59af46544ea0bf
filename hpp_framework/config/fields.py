"""Values of a YAML file: what each may be, and errors that name file, key and remedy."""

from __future__ import annotations

import math
from collections.abc import Collection, Hashable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import yaml

from hpp_framework.utils.errors import ConfigError, reason, suggest

LARGEST = 1e4
"""Largest number a file may hold; metres, degrees, seconds or a factor."""


@dataclass(frozen=True)
class Source:
    """The file that values come from; every check raises :class:`ConfigError` naming it.

    Attributes:
        file: the file.
    """

    file: Path

    def error(self, key: str, problem: str, remedy: str) -> ConfigError:
        """Build an error that says where, what, and what would be right."""
        where = f"'{key}' " if key else ""
        return ConfigError(f"{self.file}: {where}{problem}. {remedy}")

    def mapping(
        self, key: str, value: object, known: Collection[str], required: tuple[str, ...] = ()
    ) -> dict[str, Any]:
        """Return ``value`` as a mapping with known keys only and all required ones."""
        listing = ", ".join(known)
        if not isinstance(value, dict):
            raise self.error(key or "the file", f"must be a mapping, got {_show(value)}", f"Keys: {listing}.")
        found = cast("dict[Any, Any]", value)
        for name in found:
            if name not in known:
                path = join(key, str(name))
                hint = suggest(str(name), known).strip()
                raise self.error(path, "is not a known key", f"{hint} Known here: {listing}.".strip())
        for name in required:
            if name not in found:
                raise self.error(
                    join(key, name), "is missing", f"Add it; required here: {', '.join(required)}."
                )
        return found

    def items(self, key: str, value: object) -> list[Any]:
        """Return ``value`` as a list; a missing one is empty."""
        if value is None:
            return []
        if not isinstance(value, list):
            raise self.error(
                key, f"must be a list, got {_show(value)}", "Begin each entry on its own line with '- '."
            )
        return cast("list[Any]", value)

    def number(self, key: str, value: object, *, low: float | None = None, positive: bool = False) -> float:
        """Return a finite number, at least ``low`` or greater than 0 if asked."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.error(key, f"must be a number, got {_show(value)}", _number_hint(value))
        if not math.isfinite(value) or abs(value) > LARGEST:
            raise self.error(
                key,
                f"must be finite and at most {LARGEST:.0f} in size, got {value}",
                "Use metres, degrees or seconds.",
            )
        if positive and value <= 0:
            raise self.error(key, f"must be greater than 0, got {value}", "Use a positive number.")
        if low is not None and value < low:
            raise self.error(key, f"must be at least {low:g}, got {value}", f"Use {low:g} or more.")
        return float(value)

    def numbers(
        self, key: str, value: object, names: tuple[str, ...], *, positive: bool = False
    ) -> tuple[float, ...]:
        """Return as many finite numbers as there are names."""
        form = f"[{', '.join(names)}]"
        if not isinstance(value, list) or len(cast("list[Any]", value)) != len(names):
            raise self.error(
                key, f"must be a list of {len(names)} numbers, got {_show(value)}", f"Write {form}."
            )
        values = cast("list[Any]", value)
        return tuple(self.number(f"{key}[{i}]", entry, positive=positive) for i, entry in enumerate(values))

    def flag(self, key: str, value: object) -> bool:
        """Return a truth value."""
        if not isinstance(value, bool):
            raise self.error(
                key, f"must be true or false, got {_show(value)}", "Write true or false, unquoted."
            )
        return value

    def text(self, key: str, value: object) -> str:
        """Return a non-empty string."""
        if not isinstance(value, str) or not value.strip():
            raise self.error(key, f"must be text, got {_show(value)}", "Put it in quotes.")
        return value.strip()


def join(key: str, name: str) -> str:
    """Return the path of a key inside another, e.g. ``spawn.center``."""
    return f"{key}.{name}" if key else name


def read_yaml(
    file: Path, *, kind: str = "world", least: str = "bounds: [x_min, y_min, x_max, y_max]"
) -> object:
    """Return what a YAML file holds.

    Args:
        file: the file.
        kind: of file, for messages.
        least: that such a file must hold, for messages.

    Raises:
        ConfigError: if it is missing, unreadable, empty or malformed, or gives a key twice; names the line.
    """
    source = Source(file)
    if not file.exists():
        raise source.error("", "there is no such file", f"Check the path; {kind} files end in .yaml or .yml.")
    try:
        content = yaml.load(file.read_text(encoding="utf-8"), _Loader)
    except OSError as error:
        raise source.error("", f"cannot be read: {reason(error)}", "Give a readable file.") from error
    except UnicodeDecodeError as error:
        raise source.error("", "is not a text file", "Save it as UTF-8 text.") from error
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        place = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        problem = f"{place}{error.problem or error.context}"
        raise source.error(
            "", problem, "Mend the YAML there: look for a missing bracket, colon or space."
        ) from error
    except yaml.YAMLError as error:
        raise source.error(
            "", f"is not YAML: {str(error).splitlines()[0]}", "Save it as UTF-8 text."
        ) from error
    except (RecursionError, ValueError) as error:
        raise source.error(
            "", f"is not usable YAML: {error}", "Write plain keys, lists and numbers."
        ) from error
    if content is None:
        raise source.error("", "is empty", f"Write at least '{least}'.")
    return content


class _Loader(yaml.SafeLoader):
    """The safe loader, which would silently keep the last of two equal keys, made to refuse them."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen: set[object] = set()
        for key_node, _ in node.value:
            key = key_node.value
            if key in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"the key '{key}' is given twice", key_node.start_mark
                )
            seen.add(key)
        return super().construct_mapping(node, deep)


def _show(value: object) -> str:
    if value is None:
        return "nothing"
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _number_hint(value: object) -> str:
    if isinstance(value, str):
        return "Write it unquoted and without a unit, with a decimal point before an exponent: 1.0e-2."
    return "Write one number, e.g. 1.5."
