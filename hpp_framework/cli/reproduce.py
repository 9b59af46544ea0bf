"""``hpp reproduce``: the whole paper, by one command."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from hpp_framework.cli.options import check_positive, names
from hpp_framework.utils.run_folder import RunFolder

if TYPE_CHECKING:
    from hpp_framework.reproduction.run import Step


@dataclass(frozen=True, kw_only=True)
class Reproduce:
    """Run every comparison and ablation of the paper, judge its claims, and write report/index.html.

    Writes plan.json, a folder of experiments, claims.json and the report into --out. Interrupted runs resume:
    repeat the same command. See docs/reproduction.md.
    """

    scale: Literal["smoke", "standard", "full"] = "standard"
    """smoke: a few episodes, minutes; standard: 100 per cell, an hour or two on two cores; full: 500."""
    seed: int = 0
    """Seed of worlds, starts and agents."""
    only: str = ""
    """Names of experiments, separated by commas, e.g. main,frequency; all if left out."""
    workers: int | None = None
    """Processes, one thread each (default: as many as there are cores); the results do not depend on it."""
    films: bool = True
    """Whether the report shows films of chosen episodes; their cells are run once more for that."""
    out: Path = Path("out/reproduce")
    """Folder to write to."""

    def run(self) -> None:
        """Run with progress bars, and print the verdicts."""
        from hpp_framework.reproduction.judge import verdict_lines, write_claims
        from hpp_framework.reproduction.report import write_report
        from hpp_framework.reproduction.run import reproduce
        from hpp_framework.utils.executor import available_cores

        workers = available_cores() if self.workers is None else self.workers
        check_positive(workers=workers)
        only = names(self.only, "--only") if self.only else ()
        with RunFolder(self.out).locked():
            show_steps(reproduce(self.out, scale=self.scale, seed=self.seed, only=only, workers=workers))
            print(*verdict_lines(write_claims(self.out)), sep="\n")
            print(f"claims: {self.out / 'claims.json'}")
            print(f"report: {write_report(self.out, films=self.films, say=print)}")


def show_steps(steps: Iterable[Step]) -> None:
    """Show one bar per experiment while it runs, and a line when it is finished."""
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    started: dict[str, float] = {}
    with Progress(*columns, transient=True) as progress:
        bars: dict[str, _Bar] = {}
        for step in steps:
            name = step.experiment
            began = started.setdefault(name, time.perf_counter())
            bar = bars.setdefault(name, _Bar(progress, name))
            if step.parts:
                bar.update(step)
                continue
            bar.close()
            seconds = time.perf_counter() - began
            progress.console.print(f"{escape(name)}: finished after {seconds:.0f} s", highlight=False)


class _Bar:
    """The bar of one experiment."""

    def __init__(self, progress: Progress, name: str) -> None:
        self.progress = progress
        self.task = progress.add_task(escape(name), total=None)
        self.shares: dict[str, float] = {}

    def update(self, step: Step) -> None:
        """Show how far all its parts have come."""
        self.shares[step.part] = step.done / step.total
        self.progress.update(
            self.task, completed=sum(self.shares.values()), total=step.parts,
            description=escape(f"{step.experiment}: {step.part}"),
        )  # fmt: skip

    def close(self) -> None:
        """Take the bar away."""
        self.progress.remove_task(self.task)
