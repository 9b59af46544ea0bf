"""Faults of one robot that rehearsals bring about: what real robots do now and then."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from hpp_framework.deploy.port import Inbox
from hpp_framework.utils.errors import ConfigError, unknown_name

Kind = Literal[
    "kill", "pause", "stop", "nan-scan", "frozen-scan", "pose-jump", "clock-step", "network", "frozen-pose"
]
MEANS: Mapping[str, str] = {
    "kill": "the agent's process ends",
    "pause": "the agent's process is suspended (SIGSTOP)",
    "stop": "the emergency stop is pressed",
    "nan-scan": "the lidar sends no range",
    "frozen-scan": "the lidar repeats its last scan with fresh stamps",
    "pose-jump": "localisation is off by 1 m",
    "clock-step": "the robot's clock is 5 s ahead",
    "network": "nothing reaches the agent or leaves it",
    "frozen-pose": "teammates hear a pose that no longer changes, with fresh stamps",
}
JUMP = 1.0
STEP = 5.0


@dataclass(frozen=True)
class Fault:
    """Something that goes wrong with one robot.

    Attributes:
        kind: one of ``MEANS``.
        robot: its id.
        begin: seconds.
        seconds: that it lasts.
    """

    kind: Kind
    robot: str
    begin: float
    seconds: float = math.inf

    def acts(self, now: float) -> bool:
        """Return whether it is there at a time."""
        return self.begin - 1e-6 <= now < self.begin + self.seconds - 1e-6


def parse_fault(text: str, ids: Sequence[str]) -> Fault:
    """Read a fault.

    Args:
        text: ``KIND:ROBOT@BEGIN``, or ``KIND:ROBOT@BEGIN+SECONDS``, e.g. ``"network:fetch@2+5"``.
        ids: of the team.

    Raises:
        ConfigError: if it is malformed.
        UnknownNameError: if there is no such kind of fault.
    """
    kind, _, rest = text.strip().partition(":")
    robot, _, when = rest.partition("@")
    if kind not in get_args(Kind):
        raise unknown_name("fault", kind, get_args(Kind))
    if robot not in ids:
        raise ConfigError(f"fault '{text}': '{robot}' is no robot of the team; its robots: {', '.join(ids)}.")
    begin, plus, seconds = when.partition("+")
    try:
        fault = Fault(kind, robot, float(begin), float(seconds) if plus else math.inf)  # type: ignore[arg-type]  # checked above
    except ValueError as error:
        raise ConfigError(
            f"fault '{text}': write its times as @BEGIN or @BEGIN+SECONDS, e.g. @2+5."
        ) from error
    if not (fault.begin >= 0 and fault.seconds > 0):
        raise ConfigError(f"fault '{text}': it must begin at 0 s or later and last longer than 0 s.")
    return fault


def suspended(faults: Sequence[Fault], robot: str, now: float) -> bool:
    """Return whether a robot's agent does not run."""
    return any(each.kind in ("kill", "pause") and each.robot == robot and each.acts(now) for each in faults)


def cut_off(faults: Sequence[Fault], robot: str, now: float) -> bool:
    """Return whether a robot's agent has no network."""
    return any(each.kind == "network" and each.robot == robot and each.acts(now) for each in faults)


def faulty(inbox: Inbox, before: Inbox | None, me: str, faults: Sequence[Fault]) -> Inbox:
    """Return what reaches a robot's agent while faults last.

    Args:
        inbox: without them.
        before: what reached it before, faults included; None at the start.
        me: id of the robot.
        faults: of all robots.
    """
    for fault in faults:
        if not fault.acts(inbox.now):
            continue
        mine = fault.robot == me
        match fault.kind:
            case "stop" if mine:
                inbox = replace(inbox, stopped=True)
            case "nan-scan" if mine and inbox.scan:
                inbox = replace(
                    inbox, scan=replace(inbox.scan, ranges=np.full_like(inbox.scan.ranges, np.nan))
                )
            case "frozen-scan" if mine and inbox.scan and before and before.scan:
                inbox = replace(inbox, scan=replace(inbox.scan, ranges=before.scan.ranges))
            case "clock-step" if mine:
                inbox = replace(inbox, clock=inbox.clock + STEP)
            case "network" if mine and before:
                inbox = replace(before, now=inbox.now, clock=inbox.clock)
            case "pose-jump" if fault.robot in inbox.fixes:
                fix = inbox.fixes[fault.robot]
                moved = replace(fix, pose=(fix.pose[0] + JUMP, *fix.pose[1:]))
                inbox = replace(inbox, fixes={**inbox.fixes, fault.robot: moved})
            case "frozen-pose" if not mine and before and fault.robot in before.fixes:
                held = replace(inbox.fixes[fault.robot], pose=before.fixes[fault.robot].pose)
                inbox = replace(inbox, fixes={**inbox.fixes, fault.robot: held})
            case _:
                pass
    return inbox
