"""Runs the same work in VMAS, IR-SIM, SAPIEN and the batch simulator, in turns, and prints ratios."""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from rich.console import Console
from rich.table import Table

SERVER = Path(__file__).with_name("contenders.py")
CORES = len(os.sched_getaffinity(0))
PEERS = {
    "vmas 32": ("ours", 1), "vmas 128": ("ours", 1), "vmas 512": ("ours", 1), "vmas 2048": ("ours", 1),
    "irsim": ("ours", CORES), "sapien": ("ours", CORES), "sapien rays": ("our rays", CORES),
}  # fmt: skip
"""Each peer, what of ours it is held against, and how many processes it runs in."""

PACKAGES = ("hpp-framework", "torch", "warp-lang", "vmas", "ir-sim", "sapien")


class MissingError(Exception):
    """A contender cannot run here."""


class Contender:
    """Processes that do the same work at the same time whenever they are told to.

    Args:
        name: of a contender.
        copies: number of processes.
    """

    def __init__(self, name: str, copies: int) -> None:
        self.children = [
            subprocess.Popen(
                [sys.executable, str(SERVER), name],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            )
            for _ in range(copies)
        ]  # fmt: skip
        for child in self.children:
            line = self._answer(child)
            while line.strip() != "ready":
                line = self._answer(child)

    def rate(self) -> float:
        """Return work a second, of all processes together."""
        for child in self.children:
            assert child.stdin is not None
            child.stdin.write("go\n")
            child.stdin.flush()
        answers = [json.loads(self._answer(child)) for child in self.children]
        return sum(answer["amount"] / answer["seconds"] for answer in answers)

    def close(self) -> None:
        """End the processes."""
        for child in self.children:
            child.kill()
            child.wait()

    def _answer(self, child: subprocess.Popen[str]) -> str:
        assert child.stdout is not None
        assert child.stderr is not None
        line = child.stdout.readline()
        if line:
            return line
        reasons = child.stderr.read().strip().splitlines() or [f"exit code {child.wait()}"]
        self.close()
        raise MissingError(reasons[-1])


@dataclass
class Row:
    """What one peer and ours did, round by round, in work a second."""

    peer: str
    ours: str
    processes: int
    theirs: list[float] = field(default_factory=list)
    our: list[float] = field(default_factory=list)
    missing: str = ""

    @property
    def ratios(self) -> list[float]:
        """Ours over theirs, within each round."""
        return [a / b for a, b in zip(self.our, self.theirs, strict=True)]


def compare(peer: str, against: str, processes: int, rounds: int) -> Row:
    """Run a peer and ours in turns."""
    row = Row(peer, against, processes)
    started: list[Contender] = []
    try:
        for name, copies in ((against, 1), (peer, processes)):
            started.append(Contender(name, copies))
        for _ in range(rounds):
            row.our.append(started[0].rate())
            row.theirs.append(started[1].rate())
    except MissingError as error:
        row.missing = str(error)
    finally:
        for contender in started:
            contender.close()
    return row


def machine() -> dict[str, object]:
    """Return what this ran on."""
    versions: dict[str, str] = {}
    for name in PACKAGES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "not installed"
    load = [round(value, 2) for value in os.getloadavg()]
    return {"cores": CORES, "load": load, "python": platform.python_version(), "versions": versions}


def table(rows: list[Row]) -> Table:
    """Return medians and spreads."""
    shown = Table(box=None)
    for column in ("peer", "processes", "theirs, 1/s", "ours, 1/s", "ours : theirs", "lowest", "highest"):
        shown.add_column(column, justify="left" if column == "peer" else "right", no_wrap=True)
    for row in rows:
        if row.missing:
            shown.add_row(row.peer, "", "", "", f"did not run: {row.missing}")
            continue
        theirs, ours, ratio = map(statistics.median, (row.theirs, row.our, row.ratios))
        shown.add_row(
            row.peer, str(row.processes), f"{theirs:,.0f}", f"{ours:,.0f}", f"{ratio:,.0f}",
            f"{min(row.ratios):,.0f}", f"{max(row.ratios):,.0f}",
        )  # fmt: skip
    return shown


def main() -> None:
    """Compare with all peers, or those that are named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("peers", nargs="*", help=f"which (default: all): {', '.join(PEERS)}")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--out", type=Path, help="JSON file to write")
    options = parser.parse_args()
    unknown = sorted(set(options.peers) - set(PEERS))
    if unknown or options.rounds < 1:
        parser.error(
            f"no peer called {unknown}; known: {', '.join(PEERS)}" if unknown else "rounds must be >= 1"
        )
    about = machine()
    console = Console(width=120)
    console.print(about, "agent-steps per second; of 'sapien rays', rays per second", sep="\n")
    rows: list[Row] = []
    for peer in options.peers or PEERS:
        with console.status(f"{peer} against ours"):
            rows.append(compare(peer, *PEERS[peer], options.rounds))
    console.print(table(rows))
    if options.out:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        rounds = [{**vars(row), "ratios": row.ratios} for row in rows]
        options.out.write_text(json.dumps({"machine": about, "rows": rounds}, indent=1) + "\n")


if __name__ == "__main__":
    main()
