"""Reads files that an earlier command wrote, and writes them completely or not at all."""

from __future__ import annotations

import json
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from hpp_framework.utils.errors import ConfigError


def read_json(file: Path) -> dict[str, Any]:
    """Return the JSON object in a file.

    Args:
        file: written by an earlier command.

    Raises:
        ConfigError: if the file is missing, unreadable, damaged, or holds no JSON object.
    """
    remedy = "Write it again, or choose another folder."
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"cannot read '{file}': {error.strerror}. {remedy}") from error
    except ValueError as error:
        raise ConfigError(f"'{file}' is damaged, it is no JSON: {error}. {remedy}") from error
    if not isinstance(content, dict):
        raise ConfigError(f"'{file}' is damaged, it holds no JSON object. {remedy}")
    return content


@contextmanager
def replacing(file: Path) -> Generator[Path]:
    """Give a file to write beside ``file``, whose place it takes in the end.

    If anything goes wrong it is removed, and an earlier ``file`` is kept. Missing folders are made.

    Args:
        file: what is to be written.

    Raises:
        OSError: if it cannot be written.
    """
    temporary = file.with_name(f"{file.name}.tmp")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        temporary.replace(file)
    except BaseException:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise
