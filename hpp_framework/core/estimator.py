"""What reaches an agent, and what an estimator makes of it.

An estimator turns each :class:`Reading` into an :class:`Estimate`: where the team is, how sure that is, and a
scan without what is no range. It belongs to the experiment, the same for all planners that are compared.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.core.disturbances import Disturbances
from hpp_framework.core.robot import RobotSpec


@dataclass(frozen=True)
class Reading:
    """What reaches one agent in one control step.

    Attributes:
        agent: index of the robot in its team.
        poses: newest localised poses that came, world frame: its own, and other robots' as they sent them.
        ages: seconds since those were measured, by the stamps they bear.
        fresh: whether a pose is newer than the one in the reading before.
        velocity: own forward speed (m/s) and turn rate (rad/s), by odometry.
        scan: own lidar, metres; NaN where the driver sent no range.
    """

    agent: int
    poses: Float[Tensor, "b n 3"]
    ages: Float[Tensor, "b n"]
    fresh: Bool[Tensor, "b n"]
    velocity: Float[Tensor, "b 2"]
    scan: Float[Tensor, "b k"]


@dataclass(frozen=True)
class Estimate:
    """What an agent believes now; with the fields of an :class:`~hpp_framework.core.types.Observation`.

    Attributes:
        poses: of all robots, world frame.
        velocity: own forward speed (m/s) and turn rate (rad/s).
        scan: own lidar without what is no range, metres.
        velocities: speed (m/s) and turn rate (rad/s) of all robots; None where the estimator does not say.
        std: standard deviations of each robot's position along each axis (m), heading (rad) and speed (m/s):
            relative to the agent; of its own, in the world. None where no estimator says.
        ages: seconds since each robot was last heard of or seen; None where the estimator does not say.
        scan_age: seconds since the lidar last sent what can be believed; None where no estimator checks.
        jitter: seconds by which the next command may act earlier or later than the estimate is for; None
            where no estimator says.
    """

    poses: Float[Tensor, "b n 3"]
    velocity: Float[Tensor, "b 2"]
    scan: Float[Tensor, "b k"]
    velocities: Float[Tensor, "b n 2"] | None = None
    std: Float[Tensor, "b n 3"] | None = None
    ages: Float[Tensor, "b n"] | None = None
    scan_age: Float[Tensor, "b"] | None = None
    jitter: Float[Tensor, "b"] | None = None


class Estimator(ABC):
    """Estimates where one agent's team is; batched over episodes, keeps a state."""

    @abstractmethod
    def reset(self, reading: Reading) -> Estimate:
        """Begin with the first reading: all robots are at rest."""

    @abstractmethod
    def update(self, reading: Reading, command: Float[Tensor, "b 2"]) -> Estimate:
        """Return what to believe after a reading.

        Args:
            reading: that came.
            command: [v, omega] that the agent has sent since the reading before.
        """

    @abstractmethod
    def restart(self, reading: Reading, robots: Bool[Tensor, "b n"]) -> Estimate:
        """Begin anew with some of the robots, which have been put elsewhere, and return what to believe."""


@dataclass(frozen=True, kw_only=True)
class EstimatorContext:
    """What the factory of an estimator is told.

    Attributes:
        robots: the team, in team order.
        agent: index of the robot that estimates.
        disturbances: of each robot: what a calibration of it would find.
        settings: that differ from the estimator's own, by dotted name, e.g. ``{"noise": 2.0}``.
    """

    robots: Sequence[RobotSpec]
    agent: int
    disturbances: Sequence[Disturbances]
    settings: Mapping[str, Any] = field(default_factory=lambda: dict[str, Any]())
