"""``hpp check``: whether plugins keep their promises, and what to write where they do not."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.console import Console
from rich.markup import escape

if TYPE_CHECKING:
    from hpp_framework.testing.inventory import Choice, Target
    from hpp_framework.testing.report import CheckError

FOUND = 1
"""Exit status if anything is wrong."""


@dataclass(frozen=True, kw_only=True)
class Check:
    """Check robots, skills, tasks, predictors, planners and worlds; exits with 1 if anything is wrong."""

    name: Annotated[str, tyro.conf.Positional]
    """A distribution, e.g. my-pkg; a registered name, e.g. p2p; or all."""
    robot: str | None = None
    """Check skills with this robot (default: the first that each can be built for)."""
    team: str | None = None
    """Check all else with this team, e.g. rover,rover (default: the first that each can be built for)."""

    def run(self) -> None:
        """Check one thing after another, and print what to mend."""
        import torch

        from hpp_framework.testing.inventory import Choice, check_broken, find_targets

        choice = Choice(self.robot, self.team)
        choice.validate()
        targets, broken = find_targets(self.name)
        # answers must not depend on how sums are shared out, and small ones are quicker on one thread
        torch.set_num_threads(1)
        console = Console(highlight=False)
        errors = [check_broken(plugin) for plugin in broken]
        for error in errors:
            _print(console, error)
        for number, target in enumerate(targets, 1):
            error = _checked(console, target, choice, f"{number} of {len(targets)}")
            if error is not None:
                errors.append(error)
        count = sum(len(error.findings) for error in errors)
        things = len(targets) + len(broken)
        if count:
            console.print(f"{things} checked, {len(errors)} of them with {_count(count)} in all.")
            sys.exit(FOUND)
        console.print(f"{things} checked, all fine.")


def _checked(console: Console, target: Target, choice: Choice, place: str) -> CheckError | None:
    """Check one thing and print how it went; return what was found."""
    from hpp_framework.testing.inventory import check_target, stopped
    from hpp_framework.testing.report import CheckError

    started = time.perf_counter()
    with console.status(f"{place}: {escape(target.subject)}"):
        try:
            check_target(target, choice)
        except CheckError as error:
            found = error
        except Exception as error:
            found = stopped(target, error)
        else:
            found = None
    if found is None:
        console.print(
            f"[green]ok[/]  {escape(target.subject)}  [dim]{time.perf_counter() - started:.1f} s[/]"
        )
    else:
        _print(console, found)
    return found


def _print(console: Console, error: CheckError) -> None:
    # what to write is there to be copied, so no line is broken
    console.print(f"[yellow]--[/]  {escape(error.subject)}: {_count(len(error.findings))}", soft_wrap=True)
    for finding in error.findings:
        rule = escape(f"[{finding.rule.name}]")
        console.print(
            f"    [bold]{escape(finding.of)}[/] {escape(finding.what)} [dim]{rule}[/]", soft_wrap=True
        )
        console.print(f"      why: {escape(finding.rule.why)}", soft_wrap=True)
        console.print(f"      write: {escape(finding.rule.fix)}", soft_wrap=True)


def _count(findings: int) -> str:
    return "1 finding" if findings == 1 else f"{findings} findings"
