"""Backend ``loopback``: robots and agents in one process, in simulated time, the same for the same seed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import torch

from hpp_framework.deploy.faults import Fault, cut_off, faulty, suspended
from hpp_framework.deploy.loop import RobotLoop, Step
from hpp_framework.deploy.port import Command, Fix, Inbox, RobotPort
from hpp_framework.deploy.simulated import SimulatedTeam, fix_of, motion_of, scan_of


class LoopbackPort(RobotPort):
    """One robot of a simulated team.

    Args:
        team: that is simulated.
        robot: index of the robot.
        faults: that come about.
    """

    def __init__(self, team: SimulatedTeam, robot: int, faults: Sequence[Fault] = ()) -> None:
        self.simulated, self.robot, self.faults = team, robot, faults
        self.id = team.team.ids[robot]
        self.begin()

    def begin(self) -> None:
        """Forget the episode before."""
        self._plain = Inbox(now=-1.0, clock=-1.0)
        self._inbox: Inbox | None = None

    def latest(self) -> Inbox:
        """Return the newest of everything."""
        now = self.simulated.now
        if self._inbox is None or self._inbox.now != now:
            self._inbox = faulty(self._sensed(now), self._inbox, self.id, self.faults)
        return self._inbox

    def send(self, command: Command) -> None:
        """Send a command to the watchdog beside the wheels."""
        now = self.simulated.now
        if not cut_off(self.faults, self.id, now):
            self.simulated.watchdogs[self.robot].take(command, now)

    def _sensed(self, now: float) -> Inbox:
        """Return what came; a teammate's pose that did not come anew stays as it was."""
        reading = self.simulated.reading(self.robot)
        lidar = self.simulated.team.robots[self.robot].lidar
        fixes: dict[str, Fix] = dict(self._plain.fixes)
        for index, name in enumerate(self.simulated.team.ids):
            if bool(reading.fresh[0, index]) or name not in fixes:
                fixes[name] = fix_of(reading, index, now, now)
        self._plain = Inbox(
            now=now, clock=now, scan=scan_of(reading, lidar, now, now), motion=motion_of(reading, now, now),
            fixes=fixes,
        )  # fmt: skip
        return replace(self._plain)


Look = Callable[[Sequence[Step | None]], None]
"""Called after each control step with what each robot did, None for one whose agent does not run."""


def run_loopback(
    team: SimulatedTeam, loops: Sequence[RobotLoop], faults: Sequence[Fault], steps: int,
    look: Look = lambda _: None,
) -> None:  # fmt: skip
    """Run an episode that has begun until it is decided or time is up.

    Args:
        team: that is simulated.
        loops: of all robots, in team order, which have begun.
        faults: that come about.
        steps: control steps at most.
        look: looks on.
    """
    for _ in range(steps):
        # all see the same moment, whatever the others do in it
        did = [
            None if suspended(faults, name, team.now) else loop.step()
            for name, loop in zip(team.team.ids, loops, strict=True)
        ]
        goals = [
            loop.agent.goal[0] if len(loop.agent.goal) else torch.full((2,), torch.nan) for loop in loops
        ]
        look(did)
        team.step(torch.stack(goals))
        if not team.running:
            return
