"""YAML files that users write: read safely, checked by a model; mistakes name file, place and remedy."""

from __future__ import annotations

import math
import re
from collections.abc import Generator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar, cast

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.validation import explained, joined

SUFFIXES = (".yaml", ".yml")
LARGEST = 1e4
"""Largest number a file may hold; metres, degrees, seconds or a factor."""
LARGEST_FILE = 10_000_000
"""Bytes."""
MOST_VALUES = 200_000
"""In a file, with all aliases written out."""
DEEPEST = 50
"""Levels of lists and mappings inside each other, with all aliases written out."""
LONGEST_NUMBER = 40
"""Characters."""

_DECIMAL = re.compile(r"[-+]?(0|[1-9][0-9]*|[0-9]*\.[0-9]*([eE][-+]?[0-9]+)?|\.(inf|Inf|INF|nan|NaN|NAN))")
_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_KINDS = yaml.resolver.Resolver()
_TAG = "tag:yaml.org,2002:"

Model = TypeVar("Model", bound="FileModel")


class FileModel(BaseModel):
    """Base of what files hold: no key but the fields."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    def said(self) -> dict[str, Any]:
        """Return the values, by name, of what is not left out."""
        return {name: getattr(self, name) for name in self.model_fields_set}


def is_yaml(text: str) -> bool:
    """Return whether something is named by its YAML file."""
    return text.strip().lower().endswith(SUFFIXES)


def checked(model: type[Model], content: object, file: Path) -> Model:
    """Return what a file holds as a model.

    Args:
        model: says what is allowed; its validators find the file's folder as ``info.context``.
        content: as YAML or JSON has it.
        file: for messages; folders in it are relative to its own.

    Raises:
        ConfigError: if anything is wrong; names the file, the key and the remedy.
    """
    for key, number in _numbers(content):
        if not math.isfinite(number) or abs(number) > LARGEST:
            raise ConfigError(
                f"{file}: '{key}' must be finite and at most {LARGEST:.0f} in size, got {number}. "
                "Use metres, degrees or seconds."
            )
    try:
        return model.model_validate(content, context=file.parent)
    except ValidationError as error:
        raise explained(error, model, file) from error


def _numbers(value: Any, *path: str | int) -> Generator[tuple[str, float]]:
    if isinstance(value, int | float):
        yield joined(*path), value
    elif isinstance(value, dict | list):
        inside = cast("dict[str, Any]", value).items() if isinstance(value, dict) else enumerate(value)
        for key, each in inside:
            yield from _numbers(each, *path, key)


def read_yaml(file: Path, *, kind: str, least: str) -> object:
    """Return what a YAML file holds.

    Args:
        file: the file.
        kind: of file, for messages.
        least: that such a file must hold, for messages.

    Raises:
        ConfigError: if it is missing, unreadable, too large, empty or malformed; names the line.
    """
    try:
        with file.open("rb") as opened:
            content = opened.read(LARGEST_FILE + 1)
        text = content.decode("utf-8")
    except FileNotFoundError as error:
        raise ConfigError(
            f"{file}: there is no such file. Check the path; {kind} files end in .yaml or .yml."
        ) from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{file}: is not a text file. Save it as UTF-8 text.") from error
    except (OSError, ValueError) as error:  # a path may hold a null character
        why = getattr(error, "strerror", None) or error
        raise ConfigError(f"{file}: cannot be read: {why}. Give a readable file.") from error
    if len(content) > LARGEST_FILE:
        raise ConfigError(f"{file}: is larger than {LARGEST_FILE // 10**6} MB. Give a {kind} file.")
    found = parse_yaml(text, str(file))
    if found is None:
        raise ConfigError(f"{file}: is empty. Write at least '{least}'.")
    return found


def parse_yaml(text: str, where: str) -> object:
    """Return what YAML says.

    Args:
        text: the YAML.
        where: it comes from, for messages.

    Raises:
        ConfigError: if it is malformed, or something in it is read otherwise than it looks; names the line.
    """
    try:
        _check(text)
        return yaml.load(text, _LOADER)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        place = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        raise ConfigError(
            f"{where}: {place}{', '.join(filter(None, [error.context, error.problem]))}. "
            "Mend the YAML there: look for a missing bracket, colon, space or quote."
        ) from error
    except yaml.YAMLError as error:
        raise ConfigError(
            f"{where}: is not YAML: {str(error).splitlines()[0]}. Save it as UTF-8 text."
        ) from error
    except ValueError as error:  # a date that does not exist
        raise ConfigError(
            f"{where}: is not usable YAML: {error}. Write plain keys, lists and numbers."
        ) from error


@dataclass
class _Part:
    """A list or mapping of which the end was not read yet.

    Attributes:
        anchor: by which aliases repeat it.
        keys: of a mapping so far; None for a list.
        size: values in it so far, its own included.
        height: levels in it so far, its own included.
        at_key: whether a key comes next.
    """

    anchor: str | None
    keys: set[str] | None
    size: int = 1
    height: int = 1
    at_key: bool = field(init=False)

    def __post_init__(self) -> None:
        self.at_key = self.keys is not None


def _check(text: str) -> None:
    """Refuse what would exhaust memory or stack, or be read otherwise than it looks.

    It reads events one by one: what it refuses is never built, and loaders in C crash on deep nesting.

    Raises:
        yaml.YAMLError: with the place.
    """
    anchors: dict[str | None, tuple[int, int]] = {}
    parts: list[_Part] = []
    for event in yaml.parse(text, _LOADER):
        anchor, at_key = getattr(event, "anchor", None), bool(parts) and parts[-1].at_key
        if getattr(event, "tag", None) is not None:
            raise _refusal(event, f"the tag '{event.tag}' is not allowed")
        if isinstance(event, yaml.CollectionStartEvent):
            if at_key:
                raise _refusal(event, "a key must be text")
            parts.append(_Part(anchor, set() if isinstance(event, yaml.MappingStartEvent) else None))
            size, height = 0, 0
        elif isinstance(event, yaml.CollectionEndEvent):
            part, at_key = parts.pop(), False
            anchor, size, height = part.anchor, part.size, part.height
        elif isinstance(event, yaml.ScalarEvent):
            _check_scalar(event, parts[-1].keys if at_key else None)
            size, height = 1, 0
        elif isinstance(event, yaml.AliasEvent):
            if at_key or anchor not in anchors:
                raise _refusal(event, f"the alias '*{anchor}' stands for nothing that it may repeat here")
            size, height = anchors[anchor]
        else:
            continue
        if len(parts) + height > DEEPEST:
            raise _refusal(event, f"lists and mappings lie more than {DEEPEST} levels inside each other")
        if not size:
            continue
        anchors[anchor] = size, height
        if parts:
            parts[-1].size += size
            parts[-1].height = max(parts[-1].height, height + 1)
            parts[-1].at_key = parts[-1].keys is not None and not at_key
            if parts[-1].size > MOST_VALUES:
                raise _refusal(event, f"there are more than {MOST_VALUES} values, aliases written out")


def _check_scalar(event: yaml.ScalarEvent, keys: set[str] | None) -> None:
    """Check a key of a mapping that has keys, or else a value.

    Raises:
        yaml.YAMLError: with the place.
    """
    kind = _TAG + "str" if event.style else _KINDS.resolve(yaml.ScalarNode, event.value, (True, False))
    if keys is not None:
        if kind not in (_TAG + "str", _TAG + "merge"):
            raise _refusal(event, f"the key '{event.value}' is not text; put it in quotes")
        if event.value in keys:
            raise _refusal(event, f"the key '{event.value}' is given twice")
        keys.add(event.value)
    elif kind in (_TAG + "int", _TAG + "float"):
        if len(event.value) > LONGEST_NUMBER:
            raise _refusal(event, f"a number of {len(event.value)} characters is too long")
        if not _DECIMAL.fullmatch(event.value):
            raise _refusal(
                event,
                f"'{event.value}' is no plain decimal number: YAML would read it to base 60, 8, 16 or 2, or "
                "without its underscores; put it in quotes if it is text",
            )


def _refusal(event: yaml.Event, problem: str) -> yaml.MarkedYAMLError:
    return yaml.constructor.ConstructorError(None, None, problem, event.start_mark)
