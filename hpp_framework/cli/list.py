"""``hpp list``: what is registered, and where it comes from."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Annotated, Any

import tyro
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from hpp_framework.plugins.registry import Hub, hub
from hpp_framework.utils.errors import unknown_name


@dataclass(frozen=True)
class List:
    """Show what is registered and from which distribution; plugins that could not be loaded, and why."""

    kind: Annotated[str, tyro.conf.Positional] = "all"
    """What to show: robots, skills, tasks, worlds, planners, policies, layers, predictors, ... or all."""
    # a counter, because flags of this command line take a value otherwise
    json: tyro.conf.UseCounterAction[int] = 0
    """Print JSON, with distribution and version apart."""

    def run(self) -> None:
        """Print one table per kind, then what is wrong with plugins."""
        known = tuple(hub().registries())
        if self.kind not in ("all", *known):
            raise unknown_name("kind of thing to list", self.kind, ("all", *known))
        kinds = known if self.kind == "all" else (self.kind,)
        if self.json:
            print(json.dumps(listing(hub(), kinds), indent=2))
            return
        console = Console()
        for table in tables(hub(), kinds):
            console.print(table, end="\n\n")


def listing(hub: Hub, kinds: tuple[str, ...]) -> dict[str, Any]:
    """Return registered things, clashing names and broken plugins as JSON-compatible data.

    Args:
        hub: what is registered.
        kinds: attribute names of its registries.
    """
    found: dict[str, Any] = {}
    for kind in kinds:
        found[kind] = [
            {
                "name": entry.name,
                "summary": entry.summary,
                "distribution": entry.distribution or None,
                "version": entry.origin.rpartition(" ")[2] if entry.distribution else None,
            }
            for entry in hub.registries()[kind]
        ]
    found["clashes"] = [
        {"kind": kind, "name": name, "origins": [entry.origin for entry in entries]}
        for kind in kinds
        for name, entries in hub.registries()[kind].clashes().items()
    ]
    found["broken"] = [
        {"plugin": plugin.name, "origin": plugin.origin, "reason": plugin.reason} for plugin in hub.broken
    ]
    return found


def tables(hub: Hub, kinds: tuple[str, ...]) -> list[Table]:
    """Return one table per kind, and tables of clashing names and of broken plugins where there are any.

    Args:
        hub: what is registered.
        kinds: attribute names of its registries.
    """
    found: list[Table] = []
    for kind in kinds:
        table = _table(kind.replace("_", " "), "name", "what it is", "from")
        for entry in hub.registries()[kind]:
            table.add_row(escape(entry.name), escape(entry.summary), escape(entry.origin))
        found.append(table)
    clashes = _table("names that several distributions use", "kind", "name", "write instead")
    for kind in kinds:
        for name, entries in hub.registries()[kind].clashes().items():
            instead = " or ".join(f"{entry.distribution}/{entry.name}" for entry in entries)
            clashes.add_row(kind, escape(name), escape(instead))
    broken = _table("plugins that could not be loaded", "plugin", "why and what to do", "from")
    for plugin in hub.broken:
        broken.add_row(escape(plugin.name), escape(plugin.reason), escape(plugin.origin))
    return found + [table for table in (clashes, broken) if table.row_count]


def _table(title: str, *columns: str) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False)
    for column in columns:
        table.add_column(column, overflow="fold")
    return table
