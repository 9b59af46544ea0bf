"""Worker processes: everything is done once, errors arrive, and no worker outlives the iteration."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time

import pytest

from hpp_framework.utils.errors import ConfigError, HppError
from hpp_framework.utils.executor import available_cores, run_tasks


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


def test_silence_is_told_when_asked_for():
    tasks = run_tasks(linger, [0], workers=1, every=0.05)
    assert next(tasks) is None  # while the worker begins
    assert isinstance(next(report for report in tasks if report is not None), int)
    assert next(tasks) is None
    tasks.close()


def test_a_killed_worker_is_an_error():
    with pytest.raises(HppError, match="ended with code 3.*resumes"):
        list(run_tasks(vanish, range(2), workers=1))


def test_leaving_the_iteration_ends_the_workers():
    tasks = run_tasks(linger, range(2), workers=2)
    processes = [next(tasks), next(tasks)]
    assert all(is_alive(process) for process in processes)
    tasks.close()
    assert not any(is_alive(process) for process in processes)


PARENT = """
import time
from hpp_framework.utils.executor import run_tasks

def wait(task, report):
    report(task)
    until = time.monotonic() + 300
    while time.monotonic() < until:
        pass

if __name__ == "__main__":
    for task in run_tasks(wait, range(2), workers=2):
        print(task, flush=True)
"""


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
def test_workers_end_with_a_killed_parent(tmp_path, how):
    """Also in the midst of a task; all of them hold the parent's output open for as long as they live."""
    script = tmp_path / "parent.py"
    script.write_text(PARENT)
    parent = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    assert {parent.stdout.readline(), parent.stdout.readline()} == {"0\n", "1\n"}
    parent.send_signal(how)
    parent.communicate(timeout=60)
    assert parent.returncode == -how


def test_there_is_a_core():
    assert available_cores() >= 1
