"""Agents in processes of their own, as on robots."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from hpp_framework.core.team import Team
from hpp_framework.evaluation.experiment import Experiment
from hpp_framework.utils.errors import SimulatorError

MAIN = "from hpp_framework.cli.main import main; main()"
ENDS = 10.0
"""Seconds that a process gets to brake and end."""

Bounds = tuple[float, float, float, float]


def agent_command(
    experiment: Experiment, planner: str, bounds: Bounds, robot: str, backend: str
) -> list[str]:
    """Return the command that runs the agent of one robot of a rehearsal.

    Args:
        experiment: names everything.
        planner: of robots that name none.
        bounds: of the world, metres.
        robot: its id.
        backend: that connects it.
    """
    options = {
        "team": experiment.team, "task": experiment.task, "skill": experiment.skill,
        "control": experiment.control, "preset": experiment.preset,
        "disturbances": experiment.disturbances, "estimator": experiment.estimator,
        "planner": planner, "me": robot, "backend": backend,
    }  # fmt: skip
    command = [sys.executable, "-c", MAIN, "robot", "run", "--rehearsed", "True"]
    command += [text for name, value in options.items() for text in (f"--{name}", value)]
    command += ["--bounds", *map(str, bounds)]
    if experiment.weights:
        command += ["--weights", ",".join(experiment.weights)]
    for name, value in experiment.settings.items():
        command += ["--set", f"{name}={value}"]
    return command


@contextmanager
def agent_processes(
    experiment: Experiment, planner: str, bounds: Bounds, team: Team, backend: str, logs: Path
) -> Generator[Callable[[], None]]:
    """Run an agent for each robot while the context lasts; gives what raises if one has ended.

    Args:
        experiment: names everything.
        planner: of robots that name none.
        bounds: of the world, metres.
        team: all robots.
        backend: that connects them.
        logs: folder for what they print.

    Raises:
        SimulatorError: if one ends too early.
    """
    started: dict[str, subprocess.Popen[bytes]] = {}
    with ExitStack() as files:

        def check() -> None:
            for robot, process in started.items():
                if process.poll() is not None:
                    log = logs / f"{robot}.log"
                    lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
                    last = lines[-1] if lines else ""
                    raise SimulatorError(f"the process of '{robot}' has ended, see '{log}': {last}")

        try:
            for robot in team.ids:
                log = files.enter_context((logs / f"{robot}.log").open("wb"))
                command = agent_command(experiment, planner, bounds, robot, backend)
                started[robot] = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT)
            yield check
        finally:
            for process in started.values():
                process.send_signal(signal.SIGINT)
            for process in started.values():
                try:
                    process.wait(ENDS)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()
