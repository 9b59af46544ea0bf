"""Names of what newcomers make: ``my-pkg/meet-at-door``, and how it is spelt in files and in code."""

from __future__ import annotations

import keyword
import re
import sys
from dataclasses import dataclass
from importlib.metadata import entry_points
from importlib.util import find_spec

from packaging.utils import canonicalize_name

from hpp_framework.plugins.discovery import FRAMEWORK, PLUGIN_GROUP
from hpp_framework.utils.errors import ConfigError

RESERVED = ("plugin", "tests")
"""Modules that every package of a newcomer has."""


@dataclass(frozen=True)
class Name:
    """What a newcomer's package and the thing in it are called.

    Attributes:
        package: of the distribution, e.g. ``"my-pkg"``.
        thing: the task, skill or robot, e.g. ``"meet-at-door"``.
    """

    package: str
    thing: str

    @property
    def registered(self) -> str:
        """Return the name that commands know it by, whatever other packages bring."""
        return f"{self.package}/{self.thing}"

    @property
    def package_module(self) -> str:
        """Return the name that Python imports the package by."""
        return self.package.replace("-", "_")

    @property
    def thing_module(self) -> str:
        """Return the name of the thing's module and factory."""
        return self.thing.replace("-", "_")

    @property
    def class_name(self) -> str:
        """Return the name of the thing's class."""
        return "".join(word.capitalize() for word in self.thing.split("-"))


def parse_name(text: str, default: str) -> Name:
    """Read ``"my-pkg/meet-at-door"``, or ``"my-pkg"`` alone.

    Letters become small, and dots and underscores hyphens, as package indexes have it.

    Args:
        text: as it was given.
        default: what the thing is called when only the package has a name.

    Raises:
        ConfigError: if a name is no name of a distribution, no Python name, or taken by another module.
    """
    package, slash, thing = text.partition("/")
    name = Name(_normal(package, text), _normal(thing, text) if slash else default)
    module = name.package_module
    if module in sys.stdlib_module_names or find_spec(module) is not None:
        raise ConfigError(
            f"the package '{name.package}' would be imported as '{module}', and a module of that name is "
            f"installed already. {_remedy(name)}"
        )
    if name.thing_module in RESERVED:
        raise ConfigError(f"'{name.thing}' is the name of a module that every package has. Choose another.")
    return name


def _remedy(name: Name) -> str:
    """Return what to do about a taken package name; a plugin of one's own can be added to, or removed."""
    plugins = {canonicalize_name(each.dist.name) for each in entry_points(group=PLUGIN_GROUP) if each.dist}
    if name.package == FRAMEWORK or name.package not in plugins:
        return "Choose another name."
    return (
        f"Choose another name, or uninstall it: pip uninstall {name.package}. To add '{name.thing}' to that "
        f"package, write a module beside its others and one line into its plugin.py: "
        f'hub.KIND.add("{name.thing}", "{name.package_module}.{name.thing_module}:{name.thing_module}")'
    )


def _normal(part: str, text: str) -> str:
    normal = re.sub(r"[-_.]+", "-", part).lower()
    module = normal.replace("-", "_")
    if (
        not normal.isascii()
        or not module.isidentifier()
        or keyword.iskeyword(module)
        or "_" in (module[0], module[-1])
    ):
        raise ConfigError(
            f"'{text}' is no usable name. Write PACKAGE/NAME, e.g. 'my-pkg/rover': letters, digits "
            "and hyphens, each beginning with a letter and no word of Python's own."
        )
    return normal
