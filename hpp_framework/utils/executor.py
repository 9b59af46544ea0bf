"""Worker processes that report as they go, and never outlive the process that started them."""

from __future__ import annotations

import os
import signal
import threading
import traceback
from collections.abc import Callable, Generator, Iterable, Iterator
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait
from typing import Any, TypeVar

from hpp_framework.utils.errors import HppError
from hpp_framework.utils.memory import keep_freed_memory

Task = TypeVar("Task")
Report = Callable[[Any], None]


def available_cores() -> int:
    """Return how many cores this process may use."""
    # not every system can tell
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_tasks(
    function: Callable[[Task, Report], None],
    tasks: Iterable[Task],
    *,
    workers: int,
    every: float | None = None,
) -> Generator[Any, None, None]:
    """Call ``function(task, report)`` for every task, and yield whatever it reports, as it does.

    Workers end at once when the iteration is left, also by an interruption or an error, and when this process
    is killed: what a function writes must be whole or absent at any time. They use one torch thread each, and
    start as new interpreters: a script that asks for them needs the condition ``if __name__ == "__main__":``.

    Args:
        function: found by name in its module, as is everything that it is given.
        tasks: handed out in this order.
        workers: processes.
        every: seconds without a report after which None is yielded, and again, or None for never.

    Raises:
        HppError: if a worker was killed.
        Exception: what a function raised.
    """
    waiting = iter(tasks)
    busy: dict[Any, Any] = {}
    context = get_context("spawn")
    try:
        for _, task in zip(range(workers), waiting, strict=False):
            here, there = context.Pipe()
            process = context.Process(target=_work, args=(there,), daemon=True)
            process.start()
            there.close()
            here.send(function)
            here.send(task)
            busy[here] = process
        while busy:
            ready = wait(list(busy), every)
            if not ready:
                yield None
            for here in ready:
                yield from _receive(here, busy, waiting)
    finally:
        for here, process in busy.items():
            process.terminate()
            process.join()
            here.close()


def _receive(here: Any, busy: dict[Any, Any], waiting: Iterator[Any]) -> Iterator[Any]:
    """Yield a report, hand out the next task after the last one, or raise what went wrong."""
    try:
        kind, content = here.recv()
    except EOFError:
        busy[here].join()
        raise HppError(
            f"a worker process ended with code {busy[here].exitcode}, perhaps for want of memory. "
            "Use fewer --workers; the same command resumes."
        ) from None
    if kind == "report":
        yield content
    elif kind == "error":
        raise content
    else:
        for task in waiting:
            here.send(task)
            return
        busy.pop(here)
        here.close()  # the worker leaves when nothing can come any more


def _work(there: Any) -> None:
    # the starting process hears of an interruption too, and ends the workers; what takes time to import,
    # the function first of all, comes after this line
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    keep_freed_memory()
    import torch

    torch.set_num_threads(1)
    try:
        function: Callable[[Any, Report], None] = there.recv()
        while True:
            function(there.recv(), lambda content: there.send(("report", content)))
            there.send(("done", None))
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return
    except Exception as error:
        if not isinstance(error, HppError):
            error.add_note("In a worker process:\n" + traceback.format_exc())
        there.send(("error", error))


def _end_with_parent() -> None:
    """End this process as soon as the one that started it has ended, however that came."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
