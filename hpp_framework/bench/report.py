"""Shows results as tables, and writes them as JSON and CSV."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table

from hpp_framework.bench.measurement import Measurement, Settings
from hpp_framework.bench.suite import Result
from hpp_framework.utils.run_folder import write_csv, write_json

QUANTILES = {"median": 0.5, "lowest": 0.0, "q25": 0.25, "q75": 0.75, "p99": 0.99, "highest": 1.0}
COLUMNS = ("benchmark", "name", "parameters", "unit", *QUANTILES, "repeats", "load")
RESULTS_JSON, RESULTS_CSV = "results.json", "results.csv"


def headline(machine: dict[str, Any]) -> str:
    """Return the machine in one line."""
    versions = ", ".join(f"{name} {number}" for name, number in machine["versions"].items())
    return (
        f"{machine['processor']}, {machine['cores']} cores, load {machine['load'][0]}, device "
        f"{machine['device']}; Python {machine['python']}, {versions}"
    )


def table(result: Result) -> Table:
    """Return the measurements of one benchmark as a table; its title says if it was skipped."""
    title = f"{result.benchmark}: skipped. {result.skipped}" if result.skipped else result.benchmark
    shown = Table(title=escape(title), title_justify="left", title_style="bold", box=None, pad_edge=False)
    shown.add_column("what", overflow="fold")
    shown.add_column("case", overflow="fold", ratio=1)
    for column in ("median", "lowest", "highest", "p99"):
        shown.add_column(column, justify="right", no_wrap=True)
    for column in ("unit", "repeats", "load"):
        shown.add_column(column, justify="right", no_wrap=True)
    for each in result.measurements:
        p99 = number(each.quantile(0.99)) if each.unit == "ms" else ""
        shown.add_row(
            escape(each.name), escape(_case(each)), number(each.quantile(0.5)), number(each.quantile(0.0)),
            number(each.quantile(1.0)), p99, each.unit, str(len(each.values)), f"{each.load:.1f}",
        )  # fmt: skip
    return shown


def number(value: float) -> str:
    """Write a number with about three significant digits and no exponent."""
    if abs(value) >= 1000:
        return f"{value:,.0f}"
    return f"{value:.3g}" if abs(value) < 100 else f"{value:.0f}"


def write(out: Path, machine: dict[str, Any], settings: Settings, results: Sequence[Result]) -> None:
    """Write ``results.json`` and ``results.csv`` into a folder, each completely or not at all."""
    document = {
        "machine": machine,
        "settings": asdict(settings),
        "skipped": {result.benchmark: result.skipped for result in results if result.skipped},
        "measurements": [
            {**_row(result.benchmark, each), "parameters": dict(each.parameters), "values": each.values}
            for result in results
            for each in result.measurements
        ],
    }
    write_json(out / RESULTS_JSON, document, indent=1)
    rows = [_row(result.benchmark, each) for result in results for each in result.measurements]
    write_csv(out / RESULTS_CSV, COLUMNS, rows)


def _row(benchmark: str, each: Measurement) -> dict[str, Any]:
    numbers = {name: each.quantile(share) for name, share in QUANTILES.items()}
    return {
        "benchmark": benchmark, "name": each.name, "parameters": _case(each), "unit": each.unit, **numbers,
        "repeats": len(each.values), "load": each.load,
    }  # fmt: skip


def _case(each: Measurement) -> str:
    return ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in each.parameters.items())
