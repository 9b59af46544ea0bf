"""Progress bars of commands that work through cells of episodes."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Any

from rich.markup import escape
from rich.progress import Progress


@contextmanager
def cell_bars(unit: str | None = "episodes") -> Generator[Callable[[str, int, int], None]]:
    """Show one bar per cell while the context lasts; gives what is to be called with (cell, done, total).

    Args:
        unit: of the total, in words; None says nothing where no bar can be shown.
    """
    with Progress(transient=True) as progress:
        bars: dict[str, Any] = {}

        def report(cell: str, done: int, total: int) -> None:
            finished = cell in bars and progress.tasks[bars[cell]].finished
            if cell not in bars:
                bars[cell] = progress.add_task(escape(cell), total=total)
            progress.update(bars[cell], completed=done)
            # a log file shows no bar
            if unit is not None and not progress.console.is_terminal and done == total and not finished:
                progress.console.print(f"{escape(cell)}: {total} {unit}", highlight=False)

        yield report
