"""``hpp bench``: how fast everything is on this machine."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from rich.console import Console
from rich.progress import Progress

from hpp_framework.utils.run_folder import RunFolder

TABLE_WIDTH = 140


@dataclass(frozen=True, kw_only=True)
class Bench:
    """Measure speed: median and spread of each case, with the machine's load beside it.

    Benchmarks: machine, simulation, scans, sapien, collecting, predictors, planning, skill, episodes. Writes
    results.json and results.csv into --out after every measurement, so that an interruption keeps them.
    """

    names: Annotated[tuple[str, ...], tyro.conf.Positional] = ()
    """Which benchmarks (default: all)."""
    scale: Literal["quick", "full"] = "quick"
    """How many cases and repeats: quick takes minutes, full much longer."""
    device: str = "cpu"
    """Of the batch simulator: cpu or cuda."""
    team: str = "fetch,freight"
    """Robots, separated by commas; larger teams repeat them."""
    seed: int = 0
    """Seed of rooms, starts and commands."""
    out: Path = Path("out/bench")
    """Folder to write to."""

    def run(self) -> None:
        """Run, and print a table a benchmark."""
        from hpp_framework.bench.machine import describe_machine
        from hpp_framework.bench.measurement import Settings
        from hpp_framework.bench.report import headline, table, write
        from hpp_framework.bench.suite import BENCHMARKS, Result, check, run_benchmark

        settings = Settings(scale=self.scale, device=self.device, team=self.team, seed=self.seed)
        names = self.names or tuple(BENCHMARKS)
        check(names, settings)
        machine = describe_machine(self.device)
        results: dict[str, Result] = {}
        bars = Progress(console=Console(width=TABLE_WIDTH), transient=True)
        with RunFolder(self.out).locked(), bars as progress:
            progress.console.print(headline(machine), highlight=False)
            bar = progress.add_task(names[0], total=len(names))
            for name in names:
                progress.update(bar, description=name)
                for result in run_benchmark(name, settings):
                    results[name] = result
                    write(self.out, machine, settings, tuple(results.values()))
                    progress.update(bar, description=f"{name}, measurement {len(result.measurements) + 1}")
                progress.console.print(table(results[name]), "")
                progress.advance(bar)
        print(f"results: {self.out / 'results.json'}\n         {self.out / 'results.csv'}")
