"""Worker processes: everything is done once, errors arrive, and nobody outlives the iteration."""

from __future__ import annotations

import multiprocessing
import os
import time

import pytest

from hpp_framework.errors import ConfigError, HppError
from hpp_framework.workers import available_cores, run_tasks


def twice(task, report):
    report((task, "begun"))
    report((task, "done"))


def fail(task, report):
    report(os.getpid())
    raise ConfigError(f"task {task} is wrong")


def vanish(task, report):
    os._exit(3)


def linger(task, report):
    report(os.getpid())
    time.sleep(600)


def is_alive(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


def test_every_task_is_done_once_in_any_number_of_workers():
    reports = list(run_tasks(twice, range(7), workers=2))
    assert sorted(reports) == sorted((task, part) for task in range(7) for part in ("begun", "done"))
    assert list(run_tasks(twice, [], workers=2)) == []


def test_what_a_task_raises_arrives_and_ends_the_others():
    before = set(multiprocessing.active_children())
    with pytest.raises(ConfigError, match="is wrong"):
        list(run_tasks(fail, range(5), workers=2))
    assert set(multiprocessing.active_children()) <= before


def test_a_killed_worker_is_an_error():
    with pytest.raises(HppError, match="ended with code 3.*resumes"):
        list(run_tasks(vanish, range(2), workers=1))


def test_leaving_the_iteration_ends_the_workers():
    tasks = run_tasks(linger, range(2), workers=2)
    processes = [next(tasks), next(tasks)]
    assert all(is_alive(process) for process in processes)
    tasks.close()
    assert not any(is_alive(process) for process in processes)


def test_there_is_a_core():
    assert available_cores() >= 1
