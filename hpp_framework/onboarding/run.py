"""Runs an onboarding: says what comes, does what is missing, and writes down what came out."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from hpp_framework.onboarding.card import write_card
from hpp_framework.onboarding.config import Onboarding
from hpp_framework.onboarding.stages import WEIGHTS, Stage, make_stages
from hpp_framework.plugins.weights import WEIGHTS_VARIABLE, require_same_run
from hpp_framework.testing import check_robot, check_skill
from hpp_framework.utils.progress import Progress
from hpp_framework.utils.run_folder import read_json, write_json

RECORD = "onboarding.json"
"""Says which onboarding a folder holds, and what was there already when it began."""
Bars = Callable[[str], AbstractContextManager[Progress]]
"""Shows progress that is counted in a unit."""


def onboard(
    onboarding: Onboarding, out: Path, *, workers: int, bars: Bars, say: Callable[[str], None]
) -> Path:
    """Do everything that teams need to know a newcomer; what is done already is kept.

    Args:
        onboarding: who, with whom, and how much.
        out: folder of everything.
        workers: processes that collect and train side by side.
        bars: shows progress while its context lasts.
        say: is called with lines for the user.

    Returns:
        The card, in Markdown.

    Raises:
        HppError: if something named is wrong or does not pass its check, or ``out`` holds another onboarding.
    """
    check(onboarding)
    say(f"'{onboarding.newcomer}' passes its check")
    stages = make_stages(onboarding, out, workers=workers)
    _open(onboarding, out)
    for line in describe_plan(stages):
        say(line)
    with _own_weights(out / WEIGHTS):
        for number, stage in enumerate(stages, 1):
            if not stage.done():
                say(f"[{number}/{len(stages)}] {stage.title}")
                _run(stage, bars)
    return write_card(onboarding, out)


def check(onboarding: Onboarding) -> None:
    """Check the newcomer as ``hpp check`` does.

    Raises:
        CheckError: if anything is wrong with it.
    """
    if onboarding.is_robot:
        check_robot(onboarding.newcomer)
    else:
        check_skill(onboarding.newcomer, robot=onboarding.robots[0])


def describe_plan(stages: Sequence[Stage]) -> list[str]:
    """Return the plan in lines: every stage, about how long it takes, and whether it is done."""
    left = sum(stage.seconds for stage in stages if not stage.done())
    rows = [
        f"  {number:2}. {stage.title} ({'done' if stage.done() else _duration(stage.seconds)})"
        for number, stage in enumerate(stages, 1)
    ]
    return ["plan, with times on two free cores, give or take a half:", *rows, f"  in all: {_duration(left)}"]


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.0f} min"


def _run(stage: Stage, bars: Bars) -> None:
    if stage.draws:
        stage.run(lambda *_: None)
        return
    with bars(stage.unit) as report:
        stage.run(report)


def _open(onboarding: Onboarding, out: Path) -> None:
    """Create the folder, or check that it holds the same onboarding."""
    record, file = onboarding.record(), out / RECORD
    if file.exists():
        require_same_run(file, read_json(file), record)
        return
    write_json(file, record)


@contextmanager
def _own_weights(folder: Path) -> Generator[None]:
    """Let everything in this context, and the workers it starts, find the weights of a folder first."""
    folder.mkdir(parents=True, exist_ok=True)
    before = os.environ.get(WEIGHTS_VARIABLE)
    os.environ[WEIGHTS_VARIABLE] = os.pathsep.join(filter(None, (str(folder.absolute()), before)))
    try:
        yield
    finally:
        if before is None:
            del os.environ[WEIGHTS_VARIABLE]
        else:
            os.environ[WEIGHTS_VARIABLE] = before
