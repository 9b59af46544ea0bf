"""``hpp inspect``: a saved episode, decision by decision."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.console import Console
from rich.markup import escape
from rich.progress import track
from rich.table import Table

from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.run_folder import RunFolder

if TYPE_CHECKING:
    from hpp_framework.viz.decisions import Decision
    from hpp_framework.viz.record import EpisodeRecord

TABLE_WIDTH = 140


@dataclass(frozen=True, kw_only=True)
class Inspect:
    """Show what each robot saw, weighed, chose and imagined at each of its plans, and what came of it.

    Prints a table and writes one picture per decision and inspect.html, which any browser opens from the
    disk.
    """

    episode: Annotated[Path, tyro.conf.Positional]
    """File episode.npz that 'hpp run' wrote, or the folder that holds it."""
    step: int | None = None
    """Show only this decision: its number in the table."""
    out: Path | None = None
    """Folder to write to (default: inspect, beside the file)."""

    def run(self) -> None:
        """Print and draw."""
        from hpp_framework.viz.decisions import decisions
        from hpp_framework.viz.inspection import Inspection, write_page, write_pictures
        from hpp_framework.viz.record_file import load_record

        record = load_record(self.episode)
        found = decisions(record)
        numbers = _numbers(self.step, len(found))
        folder = self.episode if self.episode.is_dir() else self.episode.parent
        out = self.out or folder / "inspect"
        RunFolder(out).check()
        console = Console(width=TABLE_WIDTH, highlight=False)
        console.print(_headline(record))
        console.print(decision_table(record, found, numbers))
        inspection = Inspection(record, found)
        if self.step is not None:
            _print_decision(console, found[self.step])
            (file,) = write_pictures(inspection, numbers, out)
            print(f"picture: {file}")
            return
        drawing = write_pictures(inspection, numbers, out)
        for _ in track(drawing, "drawing", total=len(numbers), transient=True):
            pass
        print(f"pictures: {out}\npage:     {write_page(inspection, out)}")


def _numbers(step: int | None, count: int) -> Sequence[int]:
    """Return the decisions to show.

    Raises:
        ConfigError: if there is no such decision.
    """
    if step is None:
        return range(count)
    if not 0 <= step < count:
        known = f"it has 0 to {count - 1}" if count else "it has none: its agents never planned"
        raise ConfigError(f"--step {step}: the episode has no such decision, {known}.")
    return [step]


def _headline(record: EpisodeRecord) -> str:
    about = record.about
    ended = f"met after {about['time_s']} s" if about["success"] else "did not meet"
    where = f"{about['world']}, {about['backend']}, seed {about['seed']}, episode {about['episode']}"
    return escape(f"{about['planner']} ({about['preset']}), {about['team']} in {where}: {ended}")


def decision_table(record: EpisodeRecord, found: Sequence[Decision], numbers: Sequence[int]) -> Table:
    """Return decisions as a table, a row each.

    Args:
        record: the episode.
        found: its decisions.
        numbers: which of them.
    """
    from hpp_framework.viz.decisions import HORIZONS
    from hpp_framework.viz.inspection import errors_text

    table = Table(box=None)
    errors = [f"error {seconds:g} s" for seconds in HORIZONS]
    for column in ("#", "time s", "robot", "goal", "", "score", *errors, "goals apart m"):
        table.add_column(column, justify="left" if column in ("robot", "") else "right")
    for number in numbers:
        decision = found[number]
        plan, chosen = decision.plan, decision.plan.chosen()
        moved = f" by {decision.moved:.1f} m" if decision.kind == "changed" else ""
        table.add_row(
            str(number), f"{decision.time:.1f}", escape(record.agents[decision.agent].id),
            f"({plan.goal[0]:.1f}, {plan.goal[1]:.1f})", f"{decision.kind}{moved}",
            "-" if chosen is None else f"{plan.scores[chosen]:.2f}",
            *(errors_text(record, decision, h) for h in range(len(HORIZONS))),
            f"{decision.disagreement:.2f}",
        )  # fmt: skip
    return table


def _print_decision(console: Console, decision: Decision) -> None:
    from hpp_framework.viz.inspection import top_text

    console.print(f"why: {escape(decision.why)}")
    for rank, text in enumerate(top_text(decision), start=1):
        console.print(f"  {rank}: {text}")
    (x, y), (across, along) = decision.plan.mean, decision.plan.std
    console.print(f"belief: mean ({x:.2f}, {y:.2f}), standard deviation ({across:.2f}, {along:.2f}) m")
