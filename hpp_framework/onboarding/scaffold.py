"""Writes plugin packages to start from, out of the templates that ship with the framework.

A template is a package that works as it is: ``common`` and one of the kinds laid over each other, under names
such as ``my-pkg/meet-at-door``, which are replaced by those that were asked for.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path

from hpp_framework.onboarding.names import Name
from hpp_framework.utils.errors import ConfigError, reason

TEMPLATES = Path(__file__).parents[1] / "templates"
COMMON = "common"
PACKAGE = "my-pkg"
SAMPLES = {"task": "meet-at-door", "skill": "sample-skill", "robot": "sample-rover", "layer": "sample-layer"}
"""What the template of each kind brings: two words or more, so that all spellings differ."""
THINGS = {"task": "meet-at-door", "skill": "cautious", "robot": "rover", "layer": "cautious"}
"""What the thing is called if it is not named."""


def write_package(
    kind: str, name: Name, folder: Path, *, replaced: Mapping[str, str] | None = None
) -> list[Path]:
    """Write a package that registers, documents and tests one thing.

    Args:
        kind: ``"task"``, ``"skill"``, ``"robot"`` or ``"layer"``.
        name: of package and thing.
        folder: the package's own; made here.
        replaced: files with other content than the template's, by their path in the package.

    Returns:
        The files, in the order of their names.

    Raises:
        ConfigError: if the folder is there already or cannot be written.
    """
    if folder.exists():
        raise ConfigError(f"'{folder}' is there already; nothing was written. Choose another name or --out.")
    spelt = _spelling(Name(PACKAGE, SAMPLES[kind]), name)
    contents = {
        spelt(file.relative_to(root).as_posix()): spelt(file.read_text(encoding="utf-8"))
        for root in (TEMPLATES / COMMON, TEMPLATES / kind)
        for file in sorted(root.rglob("*"))
        if file.is_file() and file.suffix != ".pyc"
    }
    contents |= replaced or {}
    try:
        for path, content in contents.items():
            target = folder / path
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(content, encoding="utf-8")
    except OSError as error:
        raise ConfigError(
            f"cannot write '{error.filename}': {reason(error)}. Choose another --out."
        ) from error
    return [folder / path for path in sorted(contents)]


def _spelling(old: Name, new: Name) -> Callable[[str], str]:
    """Return what replaces one name by another in all its spellings, at once."""
    words = {
        getattr(old, spelling): getattr(new, spelling)
        for spelling in ("package", "package_module", "thing", "thing_module", "class_name")
    }
    pattern = re.compile("|".join(map(re.escape, words)))
    return lambda text: pattern.sub(lambda found: words[found[0]], text)
