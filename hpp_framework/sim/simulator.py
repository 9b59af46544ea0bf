"""The interface of both simulators.

The loop that drives one::

    with make_simulator("batch", robots) as simulator:
        state = simulator.reset(worlds, poses)
        while not finished:
            state = simulator.step(commands)
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from types import TracebackType
from typing import TypeVar

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.types import State
from hpp_framework.core.world import World
from hpp_framework.utils.errors import SimulatorError

SUBSTEPS = 4
"""Substeps per control period, at which both simulators update speeds and resolve contact."""


# not typing.Self, which beartype takes only on whole classes
S = TypeVar("S", bound="Simulator")


class Simulator(ABC):
    """Steps teams in worlds and casts their lidars.

    Args:
        robots: the team, the same in every episode.
    """

    def __init__(self, robots: Sequence[RobotSpec]) -> None:
        if not robots:
            raise SimulatorError("a simulator needs at least one robot.")
        self.robots = tuple(robots)
        self.beams = max(robot.lidar.beams for robot in robots)

    @abstractmethod
    def reset(self, worlds: Sequence[World], poses: Float[Tensor, "b n 3"]) -> State:
        """Start one episode per world, robots at rest at the given poses."""

    @abstractmethod
    def step(self, commands: Float[Tensor, "b n *p 2"]) -> State:
        """Drive for one control period (0.2 s).

        Args:
            commands: wanted forward speed (m/s) and turn rate (rad/s), for the whole period (b, n, 2) or one
                for each of its ``SUBSTEPS`` equal parts (b, n, 4, 2); limits are applied.

        Raises:
            SimulatorError: if a command is not finite or has the wrong shape.
        """

    def advance(self, commands: Float[Tensor, "b n *p 2"]) -> State:
        """Do what :meth:`step` does, but the state may be memory that the next step overwrites."""
        return self.step(commands)

    def close(self) -> None:
        """Free what the simulator holds; safe to call twice."""
        return

    def __enter__(self: S) -> S:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def check_poses(self, worlds: Sequence[World], poses: Tensor) -> None:
        """Raise :class:`SimulatorError` unless poses are finite and shaped (worlds, robots, 3)."""
        expected = (len(worlds), len(self.robots), 3)
        if tuple(poses.shape) != expected:
            raise SimulatorError(
                f"poses must have shape {expected} (worlds, robots, 3), got {tuple(poses.shape)}."
            )
        if not bool(torch.isfinite(poses).all()):
            raise SimulatorError("poses must be finite; found NaN or infinity.")

    def check_commands(self, commands: Tensor, episodes: int) -> None:
        """Raise :class:`SimulatorError` unless commands are finite and shaped (episodes, robots, 2)."""
        expected = (episodes, len(self.robots), 2)
        parts = (*expected[:2], SUBSTEPS, 2)
        if tuple(commands.shape) not in (expected, parts):
            raise SimulatorError(
                f"commands must have shape {expected} (episodes, robots, [v, omega]), "
                f"got {tuple(commands.shape)}."
            )
        if not bool(torch.isfinite(commands).all()):
            bad = torch.nonzero(~torch.isfinite(commands))[0].tolist()
            raise SimulatorError(
                f"command of episode {bad[0]}, robot {bad[1]} is not finite: "
                f"{commands[bad[0], bad[1]].tolist()}. Commands are [v in m/s, omega in rad/s]."
            )
