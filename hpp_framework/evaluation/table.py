"""Tables of episodes as CSV files: one dataclass a row, its fields the columns."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import MISSING, asdict, fields
from pathlib import Path
from typing import Any, TypeVar

from hpp_framework.utils.errors import ConfigError, reason
from hpp_framework.utils.run_folder import RESUME, write_csv

Row = TypeVar("Row")

_READERS: dict[str, Callable[[str], Any]] = {"str": str, "int": int, "float": float}


def read_rows(file: Path, kind: type[Row]) -> list[Row]:
    """Return the rows of a table, none if there is no such file.

    Args:
        file: written by :func:`write_rows`.
        kind: dataclass of a row, its fields text, whole numbers or numbers; the last columns may be missing
            where their fields have defaults.

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
            found = list(table.fieldnames or ())
            left_out = fields(dataclass)[len(found) :]
            if found != list(readers)[: len(found)] or any(each.default is MISSING for each in left_out):
                raise ConfigError(f"'{file}' is damaged, its columns are not {', '.join(readers)}. {remedy}")
            return [kind(**{name: readers[name](value) for name, value in row.items()}) for row in table]
    except OSError as error:
        raise ConfigError(f"cannot read '{file}': {reason(error)}. Choose another --out.") from error
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
    every: Sequence[Any] = rows
    columns = [field.name for field in fields(kind)]
    write_csv(file, columns, map(asdict, every), remedy=RESUME)
