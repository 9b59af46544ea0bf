"""``hpp list``: what is registered, and where it comes from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import tyro
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from hpp_framework.errors import unknown_name
from hpp_framework.registry import hub

KINDS = ("robots", "skills", "tasks", "worlds", "planners", "predictors")


@dataclass(frozen=True)
class List:
    """Show registered robots, skills, tasks, worlds, planners and predictors."""

    kind: Annotated[str, tyro.conf.Positional] = "all"
    """What to show: robots, skills, tasks, worlds, planners, predictors, or all."""

    def run(self) -> None:
        """Print one table a kind."""
        if self.kind not in ("all", *KINDS):
            raise unknown_name("kind of thing to list", self.kind, ("all", *KINDS))
        console = Console()
        for kind in KINDS if self.kind == "all" else (self.kind,):
            table = Table(title=kind, title_justify="left", title_style="bold", box=None, pad_edge=False)
            for column in ("name", "what it is", "from"):
                table.add_column(column, overflow="fold")
            for entry in hub().registries()[kind]:
                table.add_row(escape(entry.name), escape(entry.summary), escape(entry.origin))
            console.print(table, end="\n\n")
