"""``hpp list``: what is registered, and where it comes from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import tyro
from rich.console import Console
from rich.table import Table

from hpp_framework.registry import hub

KINDS = ("robots", "skills", "tasks", "worlds", "planners", "predictors")


@dataclass(frozen=True)
class List:
    """Show registered robots, skills, tasks, worlds, planners and predictors."""

    kind: Annotated[
        Literal["all", "robots", "skills", "tasks", "worlds", "planners", "predictors"], tyro.conf.Positional
    ] = "all"
    """What to show."""

    def run(self) -> None:
        """Print one table a kind."""
        console = Console()
        for kind in KINDS if self.kind == "all" else (self.kind,):
            table = Table(title=kind, title_justify="left", title_style="bold", box=None, pad_edge=False)
            for column in ("name", "what it is", "from"):
                table.add_column(column, overflow="fold")
            for entry in hub().registries()[kind]:
                table.add_row(entry.name, entry.summary, entry.origin)
            console.print(table, end="\n\n")
