"""Trials side by side, each in a process of its own that can be stopped alone."""

from __future__ import annotations

from contextlib import closing
from queue import Queue
from threading import Event, Thread
from types import TracebackType

from hpp_framework.training.search import trial as search_trial
from hpp_framework.training.search.trial import TrialReport, TrialTask


class Slots:
    """Runs up to so many trials at once; leaving the context ends them all.

    The loop that uses it::

        with Slots(workers) as slots:
            slots.start(task)
            while slots.busy:
                task, report = slots.next()

    Args:
        workers: processes.
    """

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self._events: Queue[tuple[TrialTask, TrialReport | Exception | None]] = Queue()
        self._running: dict[int, tuple[Thread, Event]] = {}

    def __enter__(self) -> Slots:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for _, stop in self._running.values():
            stop.set()
        for thread, _ in self._running.values():
            thread.join()

    @property
    def busy(self) -> int:
        """How many trials are under way."""
        return len(self._running)

    def start(self, task: TrialTask) -> None:
        """Start a trial."""
        stop = Event()
        thread = Thread(target=self._drive, args=(task, stop), daemon=True)
        self._running[task.number] = thread, stop
        thread.start()

    def stop(self, task: TrialTask) -> None:
        """Stop a trial soon; it may still report."""
        self._running[task.number][1].set()

    def next(self) -> tuple[TrialTask, TrialReport | None]:
        """Wait for a report, or for None from a trial that has ended.

        Raises:
            HppError: what ended a trial.
        """
        task, event = self._events.get()
        if isinstance(event, Exception):
            raise event
        if event is None:
            self._running.pop(task.number)[0].join()
        return task, event

    def _drive(self, task: TrialTask, stop: Event) -> None:
        try:
            with closing(search_trial.launch(task)) as reports:
                for report in reports:
                    if stop.is_set():
                        break
                    self._events.put((task, report))
        except Exception as error:
            self._events.put((task, error))
        else:
            self._events.put((task, None))
