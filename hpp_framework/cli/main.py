"""Entry point of ``hpp``: parses the command, runs it, and turns errors into one clear line."""

from __future__ import annotations

import errno
import sys
from collections.abc import Sequence
from typing import Annotated

import tyro

from hpp_framework.cli.bench import Bench
from hpp_framework.cli.check import Check
from hpp_framework.cli.collect import Collect
from hpp_framework.cli.doctor import Doctor
from hpp_framework.cli.evaluate import Evaluate
from hpp_framework.cli.inspect import Inspect
from hpp_framework.cli.list import List
from hpp_framework.cli.new import New
from hpp_framework.cli.onboard import Onboard
from hpp_framework.cli.reproduce import Reproduce
from hpp_framework.cli.robot import Robot
from hpp_framework.cli.run import Run
from hpp_framework.cli.search import Search
from hpp_framework.cli.train import Train
from hpp_framework.utils.errors import HppError, reason
from hpp_framework.utils.memory import keep_freed_memory

Command = (
    Annotated[Run, tyro.conf.subcommand("run")]
    | Annotated[Inspect, tyro.conf.subcommand("inspect")]
    | Annotated[Evaluate, tyro.conf.subcommand("evaluate")]
    | Annotated[Reproduce, tyro.conf.subcommand("reproduce")]
    | Annotated[List, tyro.conf.subcommand("list")]
    | Annotated[New, tyro.conf.subcommand("new")]
    | Annotated[Onboard, tyro.conf.subcommand("onboard")]
    | Annotated[Check, tyro.conf.subcommand("check")]
    | Annotated[Collect, tyro.conf.subcommand("collect")]
    | Annotated[Train, tyro.conf.subcommand("train")]
    | Annotated[Search, tyro.conf.subcommand("search")]
    | Annotated[Robot, tyro.conf.subcommand("robot")]
    | Annotated[Bench, tyro.conf.subcommand("bench")]
    | Annotated[Doctor, tyro.conf.subcommand("doctor")]
)

BAD_INPUT = 2
INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> None:
    """Run ``hpp``; exits with 0, 2 for wrong input, 130 when interrupted, 1 for a full disk and the like."""
    command = tyro.cli(
        Command,  # type: ignore[arg-type]  # a union of types is what tyro wants
        prog="hpp",
        description="Teams of mobile robots that coordinate without talking.",
        args=arguments,
        config=(tyro.conf.FlagConversionOff,),
    )
    keep_freed_memory()
    try:
        command.run()
    except HppError as error:
        _fail(str(error), BAD_INPUT)
    except KeyboardInterrupt:
        _fail(f"interrupted. {_after_interruption(command)}", INTERRUPTED)
    except BrokenPipeError:
        sys.exit(0)
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EROFS, errno.EACCES, errno.EPERM, errno.EDQUOT):
            raise
        _fail(f"cannot write '{error.filename or 'the output'}': {reason(error)}. Choose another --out.", 1)


def _after_interruption(command: object) -> str:
    if isinstance(command, Evaluate | Collect | Onboard | Reproduce | Train | Search):
        return "What was finished is kept; the same command resumes."
    if isinstance(command, Robot):
        return "Robots brake; a rehearsal is resumed by the same command."
    if isinstance(command, Bench):
        return f"What was finished is in '{command.out}'; the same command starts over."
    return "Nothing is resumed: the same command starts over."


def _fail(message: str, code: int) -> None:
    print(f"hpp: {message}", file=sys.stderr)
    sys.exit(code)
