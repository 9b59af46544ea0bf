"""Reads files that an earlier command wrote, with errors that name the file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from hpp_framework.errors import ConfigError


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
