"""``hpp search``: search for the reward and the network of a skill."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeVar

import tyro

from hpp_framework.cli.options import check_positive
from hpp_framework.config.settings import parse_settings
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.run_folder import RunFolder

if TYPE_CHECKING:
    from hpp_framework.training.search.phase import TrialRow, Watch

Number = TypeVar("Number", int, float)


@dataclass(frozen=True, kw_only=True)
class Search:
    """Search for better settings of a skill's training, phase by phase: its reward, then its network.

    Every trial trains a policy and is judged by the task itself. An interrupted search resumes: repeat the
    same command. Needs Optuna: pip install hpp-framework[search].
    """

    what: Annotated[Literal["skill"], tyro.conf.Positional] = "skill"
    """What to search."""
    name: Annotated[str, tyro.conf.Positional] = "p2p"
    """Registered skill."""
    robot: str = "fetch"
    """Registered robot."""
    steps: int = 1_000_000
    """Control steps of experience a trial."""
    trials: str = "12,8"
    """Trials of each phase, separated by commas; the first of a phase is the baseline."""
    workers: int | None = None
    """Trials side by side, one thread each (default: as many as there are cores)."""
    init: Path | None = None
    """Weights that every trial starts from; with it, trials are short and tell how training should go on."""
    rungs: str = ""
    """Shares of the steps at which poor trials are stopped, e.g. 0.33,0.66 (default: none is)."""
    seed: int = 1
    """Seed of what is tried, of the trainings and of the judging."""
    set: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=VALUE ...")] = ()
    """Settings of the trainer's recipe: where the search starts, or what it holds, e.g. rooms.count=400."""
    out: Path | None = None
    """Folder to write to (default: runs/search-SKILL-ROBOT)."""

    def run(self) -> None:
        """Search, with a progress bar per trial, and print how to train the winner."""
        from hpp_framework.plugins.registry import hub
        from hpp_framework.training.search.report import REPORT, train_command
        from hpp_framework.training.search.run import search_skill
        from hpp_framework.training.search.space import SearchConfig
        from hpp_framework.utils.executor import available_cores

        hub().robots.entry(self.robot)
        hub().skill_searches.entry(self.name)
        workers = available_cores() if self.workers is None else self.workers
        check_positive(steps=self.steps, workers=workers)
        if not 0 <= self.seed < 2**32:
            raise ConfigError(f"--seed must lie between 0 and 4294967295 (2**32 - 1), got {self.seed}.")
        out = self.out or Path("runs") / f"search-{self.name}-{self.robot}"
        config = SearchConfig(
            skill=self.name, robot=self.robot, out=out, steps=self.steps, workers=workers, seed=self.seed,
            trials=_numbers(self.trials, "--trials", int),
            rungs=_numbers(self.rungs, "--rungs", float) if self.rungs else (),
            init=self.init, settings=parse_settings(self.set, "--set"),
        )  # fmt: skip
        with RunFolder(out).locked(), _bars(self.steps) as watch:
            best = search_skill(config, watch)
        print(f"best: trial {best.number} of {best.phase}, score {best.score:.4f}")
        print(f"report: {out / REPORT}\ntrain it at full length:")
        print(train_command(config, best.settings))


def _numbers(text: str, option: str, kind: type[Number]) -> tuple[Number, ...]:
    """Read numbers separated by commas.

    Raises:
        ConfigError: if something is no number of that kind.
    """
    try:
        return tuple(kind(part) for part in text.split(","))
    except ValueError:
        whole = "whole numbers" if kind is int else "numbers"
        raise ConfigError(f"{option} takes {whole} separated by commas, got '{text}'.") from None


@contextmanager
def _bars(steps: int) -> Generator[Watch]:
    """Show a bar for each trial under way, and a line for each that has ended."""
    from rich.progress import Progress, TaskID

    bars: dict[str, TaskID] = {}
    with Progress(transient=True) as progress:

        def watch(row: TrialRow, curve: Mapping[int, float]) -> None:
            name = f"{row.phase} {row.number}"
            if row.state != "unfinished":
                if name in bars:
                    progress.remove_task(bars.pop(name))
                score = "" if row.score is None else f", score {row.score:.4f}"
                progress.console.print(f"{name}: {row.state}{score}", highlight=False)
                return
            if name not in bars:
                bars[name] = progress.add_task(name, total=steps)
            last = max(curve, default=0)
            success = f", success {curve[last]:.3f}" if last else ""
            progress.update(bars[name], completed=last, description=f"{name}{success}")

        yield watch
