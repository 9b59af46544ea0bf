"""A simulated team in real time: other processes drive it, as they would drive robots."""

from __future__ import annotations

from collections.abc import Callable

import torch

from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.deploy.port import TeamPort
from hpp_framework.deploy.simulated import SimulatedTeam, fix_of, motion_of, scan_of
from hpp_framework.utils.errors import SimulatorError

PATIENCE = 120.0
"""Seconds until all agents must have sent a first command."""


class RealTimeWorld:
    """Sends what robots sense, and lets them do what their agents say, at the pace of the clock.

    Args:
        team: in an episode that has begun.
        port: to the agents.
        check: called while agents are waited for; raises if they cannot come.
    """

    def __init__(self, team: SimulatedTeam, port: TeamPort, check: Callable[[], None] = lambda: None) -> None:
        self.team, self.port, self.check = team, port, check

    def run(self, steps: int) -> None:
        """Run an episode until it is decided or time is up; it begins when all agents send commands.

        Args:
            steps: control steps at most.

        Raises:
            SimulatorError: if an agent sends none.
        """
        end = self.port.times()[0] + PATIENCE
        while not self._all_heard():
            self.check()
            if self.port.times()[0] > end:
                names = zip(self.team.team.ids, self.team.watchdogs, strict=True)
                silent = ", ".join(name for name, dog in names if dog.heard < 0)
                raise SimulatorError(
                    f"no command from {silent} in {PATIENCE:.0f} s. Start `hpp robot run --me ...` for each "
                    "robot in the same ROS_DOMAIN_ID, and see what `hpp robot check` says."
                )
            self._publish()
            self._drive(self.port.times()[0] + CONTROL_PERIOD)
        due = self.port.times()[0]
        for _ in range(steps):
            self._publish()
            due = max(due + CONTROL_PERIOD, self.port.times()[0])
            self._drive(due)
            goals = torch.tensor(self.port.goals, dtype=torch.float32)
            self.team.step(goals, self.port.times()[0])
            if not self.team.running:
                return

    def _all_heard(self) -> bool:
        return all(dog.heard >= 0 for dog in self.team.watchdogs)

    def _publish(self) -> None:
        now, clock = self.port.times()
        for index, robot in enumerate(self.team.team.robots):
            reading = self.team.reading(index)
            self.port.publish(
                index, scan_of(reading, robot.lidar, clock, now), motion_of(reading, clock, now),
                fix_of(reading, index, clock, now),
            )  # fmt: skip

    def _drive(self, until: float) -> None:
        for robot, command in self.port.wait(until):
            self.team.watchdogs[robot].take(command, self.port.times()[0])
