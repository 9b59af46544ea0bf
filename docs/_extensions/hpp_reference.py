"""Sphinx directives that write the reference from the code: commands, configs and modules.

- ``hpp-commands`` shows ``hpp X --help`` of every command;
- ``hpp-config`` shows the settings of one dataclass with their types, defaults and meanings;
- ``hpp-other-configs`` shows those that no ``hpp-config`` of its page names;
- ``hpp-modules`` documents every public module of a package.
"""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import inspect
import io
import os
import pkgutil
import re
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar
from unittest import mock

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

WIDTH = 80
"""Columns of a command's help."""

PACKAGES = ("hpp_framework", "hpp_robots", "hpp_skills", "hpp_tasks")


def command_help(*words: str) -> str:
    """Return what ``hpp WORDS --help`` prints, at most :data:`WIDTH` columns wide."""
    from hpp_framework.cli.main import main

    printed, width = io.StringIO(), mock.patch.dict(os.environ, COLUMNS=str(WIDTH))
    with width, contextlib.redirect_stdout(printed), contextlib.suppress(SystemExit):
        main([*words, "--help"])
    lines = printed.getvalue().rstrip().splitlines()
    # descriptions are not wrapped by the parser
    wrapped = (textwrap.wrap(line, WIDTH, break_on_hyphens=False) or [""] for line in lines)
    return "\n".join(line for group in wrapped for line in group)


def commands() -> Iterator[tuple[tuple[str, ...], str]]:
    """Yield the words of every command and its help, ``hpp`` itself first."""
    waiting: list[tuple[str, ...]] = [()]
    while waiting:
        words = waiting.pop(0)
        text = command_help(*words)
        yield words, text
        found = [(*words, name) for name in re.findall(r"^ +• (\S+)", text, re.MULTILINE)]
        waiting = found + waiting


def meanings(config: type) -> dict[str, str]:
    """Return what the docstring of a dataclass, or of those it extends, says of its fields."""
    found: dict[str, str] = {}
    for each in reversed(config.__mro__):
        section = re.search(r"^Attributes:\n((?:    .*\n?|\n)*)", inspect.cleandoc(each.__doc__ or ""), re.M)
        for entry in re.split(r"\n(?=    \S)", section.group(1)) if section else ():
            names, _, text = entry.strip().partition(": ")
            found |= dict.fromkeys(names.split(", "), " ".join(text.split()))
    return found


def default_of(field: dataclasses.Field[Any]) -> str:
    """Return how the default of a field is written, empty if it has none."""
    if field.default is not dataclasses.MISSING:
        value = field.default
    elif field.default_factory is not dataclasses.MISSING:
        value = field.default_factory()
    else:
        return ""
    if dataclasses.is_dataclass(value):
        return f"``{type(value).__name__}(…)``"
    return f"``{value!r}``"


def config_table(config: type) -> str:
    """Return a reStructuredText table of the settings of a dataclass.

    Raises:
        ValueError: if its docstring leaves out a field.
    """
    says = meanings(config)
    lines = [".. list-table::", "   :class: settings", "   :header-rows: 1", "   :widths: 20 22 18 40", ""]
    rows = [("setting", "type", "default", "meaning")]
    for field in dataclasses.fields(config):
        if field.name not in says:
            raise ValueError(f"the docstring of {config.__name__} says nothing of '{field.name}'.")
        kind = field.type if isinstance(field.type, str) else getattr(field.type, "__name__", str(field.type))
        rows.append((f"``{field.name}``", f"``{kind}``", default_of(field), says[field.name]))
    for row in rows:
        lines += [f"   {'* -' if index == 0 else '  -'} {cell}" for index, cell in enumerate(row)]
    return "\n".join(lines)


def configs() -> list[str]:
    """Return module and name of every class that is a configuration by its name."""
    found: list[str] = []
    for package in PACKAGES:
        root = Path(importlib.import_module(package).__path__[0])
        for file in sorted(root.rglob("*.py")):
            module = ".".join((package, *file.relative_to(root).with_suffix("").parts))
            names = re.findall(
                r"^class ([A-Z]\w*Config|\w+Training|Recipe)\b", file.read_text(), re.MULTILINE
            )
            found += [f"{module}.{name}" for name in names if "templates" not in file.parts]
    return [path for path in found if "._" not in path]


def other_configs(page: str) -> list[str]:
    """Return the configurations that the text of a page does not name."""
    return [path for path in configs() if f":: {path}\n" not in page]


def config_section(path: str, title: str) -> str:
    """Return a section about a dataclass, given by module and name."""
    module, _, name = path.rpartition(".")
    config = getattr(importlib.import_module(module), name)
    summary = re.split(r"\n+Attributes:\n", inspect.cleandoc(config.__doc__ or ""))[0]
    label = "config-" + re.sub(r"\W|_", "-", path).lower()
    return (
        f".. _{label}:\n\n{title}\n{'-' * len(title)}\n\n.. code-block:: python\n\n"
        f"   from {module} import {name}\n\n{summary}\n\n{config_table(config)}\n"
    )


def public_modules(package: str) -> list[str]:
    """Return the names of the modules of a package that others may use: no kernels, nothing private."""
    path = importlib.import_module(package).__path__
    names = sorted(module.name for module in pkgutil.iter_modules(path) if not module.ispkg)
    return [
        f"{package}.{name}" for name in names if not name.startswith("_") and not name.endswith("kernels")
    ]


class Commands(SphinxDirective):
    """A section with the help of every command."""

    def run(self) -> list[nodes.Node]:
        """Return the sections."""
        sections: list[nodes.Node] = []
        for words, text in commands():
            name = " ".join(("hpp", *words))
            section = nodes.section(ids=["-".join(("hpp", *words))], names=[name])
            section += nodes.title("", "", nodes.literal("", name))
            section += nodes.literal_block(text, text, language="none")
            self.state.document.note_explicit_target(section)
            sections.append(section)
        return sections


class Config(SphinxDirective):
    """A section about one dataclass, named by module and class."""

    required_arguments = 1
    option_spec: ClassVar[dict[str, Any]] = {"title": directives.unchanged}

    def run(self) -> list[nodes.Node]:
        """Return the section."""
        path = self.arguments[0]
        title = self.options.get("title", path.rpartition(".")[2])
        return self.parse_text_to_nodes(config_section(path, title), allow_section_headings=True)


class OtherConfigs(SphinxDirective):
    """Sections about all configurations that the page does not name."""

    def run(self) -> list[nodes.Node]:
        """Return the sections."""
        page = Path(self.env.doc2path(self.env.docname)).read_text()
        parts = [config_section(path, path.rpartition(".")[2]) for path in other_configs(page)]
        return self.parse_text_to_nodes("\n".join(parts), allow_section_headings=True)


class Modules(SphinxDirective):
    """A section a public module of a package."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the sections."""
        parts = [
            f"{name}\n{'-' * len(name)}\n\n.. automodule:: {name}\n"
            for name in public_modules(self.arguments[0])
        ]
        return self.parse_text_to_nodes("\n".join(parts), allow_section_headings=True)


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directives."""
    app.add_directive("hpp-commands", Commands)
    app.add_directive("hpp-config", Config)
    app.add_directive("hpp-other-configs", OtherConfigs)
    app.add_directive("hpp-modules", Modules)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
