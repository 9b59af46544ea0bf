"""The control loop of one robot: data in, one command out, once a control period."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from hpp_framework.core.agent import Agent
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.deploy.assembly import Assembly
from hpp_framework.deploy.port import HALT, Command, RobotPort, View
from hpp_framework.deploy.safety import LOST, Gate


@dataclass(frozen=True)
class Step:
    """What happened in a control step.

    Attributes:
        command: sent; None before the robot is armed.
        reasons: why the gate braked, or what the robot waits for.
        seconds: wall time of the step.
    """

    command: Command | None
    reasons: tuple[str, ...]
    seconds: float


class RobotLoop:
    """Runs one agent on one robot.

    It is armed by the first step in which all data are there and nothing is wrong; nothing is sent before.

    Args:
        agent: that drives.
        assembly: of its observations.
        gate: between the agent and the wheels.
        port: of the robot.

    Attributes:
        armed: whether commands are sent.
        seconds: wall time of each control step since then.
    """

    def __init__(self, agent: Agent, assembly: Assembly, gate: Gate, port: RobotPort) -> None:
        self.agent, self.assembly, self.gate, self.port = agent, assembly, gate, port
        self.armed = False
        self.seconds: list[float] = []

    def begin(self, seed: int) -> None:
        """Forget everything; the robot is not armed.

        Args:
            seed: of the agent.
        """
        self.agent.reset([seed])
        self.gate.reset()
        self.armed, self._doubted = False, False
        self._sent: Command = HALT

    def warm_up(self, plans: int = 2) -> None:
        """Let the agent act in an empty room, unsent: a first plan compiles kernels and takes seconds.

        Args:
            plans: that it makes.
        """
        reading = self.assembly.reading(self.assembly.empty_room())
        assert reading is not None, "an empty room lacks nothing"
        for _ in range(plans):
            self.agent.reset([0])
            self.assembly.begin(reading)
            for _ in range(2):
                self.agent.act(self.assembly.observation())
                self.assembly.update(reading, HALT)

    def step(self) -> Step:
        """Do one control step."""
        began = time.perf_counter()
        inbox = self.port.latest()
        reasons = self.gate.judge(inbox)
        reading = self.assembly.reading(inbox)
        if reading is None or not (self.armed or not reasons):
            missing = tuple(self.assembly.missing(inbox))
            return Step(None, missing or reasons, time.perf_counter() - began)
        self._doubted |= bool(LOST & set(reasons))
        if not self.armed or (self._doubted and not reasons):
            # what was estimated and remembered meanwhile is wrong; the robot is at rest
            self.assembly.begin(reading)
            self.armed, self._doubted = True, False
        else:
            self.assembly.update(reading, self._sent)
        wanted = self.agent.act(self.assembly.observation())[0].tolist()
        self._sent = self.gate.passed((wanted[0], wanted[1]), reasons, reading.scan[0].numpy())
        self.port.send(self._sent)
        self.seconds.append(time.perf_counter() - began)
        self.port.show(view_of(self.agent, reasons))
        return Step(self._sent, reasons, self.seconds[-1])

    def halt(self) -> None:
        """Brake."""
        self.port.send(HALT)


def drive(loop: RobotLoop, *, seconds: float, report: Callable[[Step], None] = lambda _: None) -> int:
    """Run control steps in real time until time is up or someone interrupts; the robot brakes first, then.

    Args:
        loop: of the robot.
        seconds: for which it runs.
        report: called after each step.

    Returns:
        How many control steps began late.
    """
    late, now = 0, loop.port.latest().now
    end, due = now + seconds, now
    episode = loop.port.episode
    try:
        while now < end:
            if loop.port.episode is not None and loop.port.episode != episode:
                episode = loop.port.episode
                loop.begin(episode)
            report(loop.step())
            due += CONTROL_PERIOD
            now = loop.port.latest().now
            if now > due:
                late, due = late + 1, now
            loop.port.wait(due)
            inbox = loop.port.latest()
            if inbox.scan is not None and inbox.now - inbox.scan.arrived > CONTROL_PERIOD / 2:
                # a slow lidar sets the pace: steps follow its scans at once, not at any phase
                loop.port.wait(due + CONTROL_PERIOD / 2, for_scan=True)
                due = loop.port.latest().now
    finally:
        loop.halt()
    return late


def view_of(agent: Agent, reasons: tuple[str, ...]) -> View:
    """Return what an agent is up to."""

    def point(values: torch.Tensor) -> tuple[float, float]:
        return float(values[0, 0]), float(values[0, 1])

    belief = agent.belief
    paths: np.ndarray | None = None
    if belief is not None and belief.imagination is not None:
        best = int(belief.imagination.scores[0].argmax())
        paths = belief.imagination.trajectories.poses[0, best, :, :, :2].transpose(0, 1).cpu().numpy()
    return View(
        goal=point(agent.goal),
        waypoint=point(agent.waypoint),
        mean=None if belief is None else point(belief.mean),
        std=None if belief is None else point(belief.std),
        paths=paths,
        reasons=reasons,
    )
