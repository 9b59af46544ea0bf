"""One robot's process: says what it waits for, drives, and brakes before it ends."""

from __future__ import annotations

import signal
from collections.abc import Callable
from types import FrameType

from hpp_framework.deploy.loop import RobotLoop, Step, drive
from hpp_framework.deploy.port import RobotPort, Traffic
from hpp_framework.deploy.safety import REASONS

Say = Callable[[str], None]


def run_node(loop: RobotLoop, *, seconds: float, seed: int, say: Say) -> int:
    """Warm up and drive in real time; SIGTERM and SIGINT brake first.

    Args:
        loop: of the robot.
        seconds: for which it runs.
        seed: of its agent.
        say: called with each line of its log.

    Returns:
        How many control steps began late.
    """
    signal.signal(signal.SIGTERM, _interrupt)
    say("warming up")
    loop.warm_up()
    loop.begin(seed)
    last = [""]

    def report(step: Step) -> None:
        line = status(step)
        if last[0] != line:
            last[0] = line
            say(line)

    return drive(loop, seconds=seconds, report=report)


def status(step: Step) -> str:
    """Return what a control step says of the robot, in words."""
    words = " ".join(f"{each}: {REASONS[each]}" if each in REASONS else f"{each}." for each in step.reasons)
    if step.command is None:
        return f"not armed. {words}"
    return f"braking. {words}" if step.reasons else "driving"


def problems(port: RobotPort, loop: RobotLoop, seconds: float) -> tuple[list[Traffic], list[str]]:
    """Listen for some time; return what came, and what keeps the robot from being armed.

    Args:
        port: of the robot.
        loop: of the robot; sends nothing.
        seconds: to listen.

    Raises:
        ConfigError: if the lidar does not see what the robot's description says.
    """
    begun = port.latest().now
    port.wait(begun + seconds)
    inbox = port.latest()
    found = [f"{each}." for each in loop.assembly.missing(inbox)]
    if not found:
        loop.assembly.reading(inbox)
        found = [f"{each}: {REASONS[each]}" for each in loop.gate.judge(inbox)]
    return port.traffic(), found


def _interrupt(number: int, frame: FrameType | None) -> None:
    del number, frame
    raise KeyboardInterrupt
