"""Tables of episodes as CSV files: one dataclass a row, its fields the columns."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, TypeVar

from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.files import replacing

Row = TypeVar("Row")

_READERS: dict[str, Callable[[str], Any]] = {"str": str, "int": int, "float": float}


def read_rows(file: Path, kind: type[Row]) -> list[Row]:
    """Return the rows of a table, none if there is no such file.

    Args:
        file: written by :func:`write_rows`.
        kind: dataclass of a row, its fields text, whole numbers or numbers.

    Raises:
        ConfigError: if the file cannot be read or is damaged.
    """
    if not file.exists():
        return []
    dataclass: Any = kind
    readers = {field.name: _READERS[str(field.type)] for field in fields(dataclass)}
    remedy = "Move it away to start over."
    try:
        with file.open(newline="", encoding="utf-8") as stream:
            table = csv.DictReader(stream)
            if table.fieldnames != list(readers):
                raise ConfigError(f"'{file}' is damaged, its columns are not {', '.join(readers)}. {remedy}")
            return [kind(**{name: readers[name](value) for name, value in row.items()}) for row in table]
    except OSError as error:
        raise ConfigError(f"cannot read '{file}': {error.strerror}. Choose another --out.") from error
    except (KeyError, TypeError, ValueError, csv.Error) as error:
        raise ConfigError(f"'{file}' is damaged ({error!r}). {remedy}") from error


def write_rows(file: Path, rows: Sequence[object], kind: type[Any]) -> None:
    """Write all rows, completely or not at all: an interruption loses at most what ran last.

    Args:
        file: the CSV file.
        rows: dataclasses.
        kind: their class.

    Raises:
        ConfigError: if the file cannot be written.
    """
    try:
        with replacing(file) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.DictWriter(stream, [field.name for field in fields(kind)])
            writer.writeheader()
            every: Sequence[Any] = rows
            writer.writerows(asdict(row) for row in every)
    except OSError as error:
        raise ConfigError(
            f"cannot write '{file}': {error.strerror}. Finished episodes are kept; resume later."
        ) from error
