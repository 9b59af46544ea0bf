"""Threads that share out the launches of kernels."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

from hpp_framework.utils.executor import available_cores

Job = Callable[[], object]

SHARES = 4
"""Slices per thread: a thread that the machine holds up leaves some of its own to the others."""
FEWEST = 32
"""Episodes a slice, at least: handing one over takes about as long as ten episodes."""


class ThreadPool:
    """Runs lists of jobs on several threads; the jobs must release Python's lock, as Warp's launches do.

    Args:
        threads: how many, or None for one per core that this process may use.
    """

    def __init__(self, threads: int | None = None) -> None:
        self.threads = threads or available_cores()
        self._others: ThreadPoolExecutor | None = None

    def slices(self, size: int) -> list[tuple[int, int]]:
        """Cut ``range(size)`` into slices (start, stop) worth handing over."""
        count = 1 if self.threads == 1 else max(1, min(self.threads * SHARES, size // FEWEST))
        edges = [size * index // count for index in range(count + 1)]
        return list(pairwise(edges))

    def run(self, jobs: Sequence[Job]) -> None:
        """Run every job once, in any order, and return when all are done."""
        helpers = min(self.threads, len(jobs)) - 1
        left = iter(jobs)
        if helpers < 1:
            _work(left)
            return
        if self._others is None:
            self._others = ThreadPoolExecutor(self.threads - 1, thread_name_prefix="crew")
        futures = [self._others.submit(_work, left) for _ in range(helpers)]
        _work(left)
        for future in futures:
            future.result()

    def close(self) -> None:
        """End the threads; the next run starts them again."""
        if self._others is not None:
            self._others.shutdown()
            self._others = None


def _work(left: Iterator[Job]) -> None:
    # several threads draw from one iterator: a list's is safe to share
    for job in left:
        job()
