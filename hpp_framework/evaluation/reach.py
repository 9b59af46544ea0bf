"""How far a robot can get from rest, at most, in so many control periods."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from jaxtyping import Float, Int

from hpp_framework.core.robot import DriveLimits
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.sim.simulator import SUBSTEPS

Array = npt.NDArray[np.float64]

PERIODS = 300
"""Control periods that are looked ahead (60 s)."""
ANGLES = 181
"""Deviations from straight ahead to straight behind that are told apart."""


class Reach:
    r"""Distances that no drive from rest beats.

    A robot at distance :math:`\rho` of a point, which it sees at a bearing :math:`\alpha`, obeys
    :math:`\rho' = -v \cos\alpha` and :math:`\alpha' = -\omega + v \sin\alpha / \rho` (Aicardi et al. 1995).
    For :math:`v \ge 0` driving only turns the point further away, so that :math:`|\alpha(t)| \ge |\alpha_0| -
    \Omega(t)`, where :math:`\Omega(t)` is the angle that turning at full acceleration and top rate covers,
    and the robot comes nearer by no more than

    .. math:: \int_0^T \min(a t, v_{top}) \max(0, \cos\max(0, |\alpha_0| - \Omega(t))) \, dt.

    Args:
        drive: limits of the robot.
    """

    def __init__(self, drive: DriveLimits) -> None:
        self.drive = drive
        self.top = max(drive.speed[1], -drive.speed[0])
        count = PERIODS * SUBSTEPS
        times = np.arange(count + 1) * (CONTROL_PERIOD / SUBSTEPS)
        risen = np.minimum(times, self.top / drive.acceleration)
        self._driven = drive.acceleration * risen**2 / 2 + self.top * (times - risen)
        turning = np.minimum(times, drive.turn_rate / drive.turn_acceleration)
        turned = drive.turn_acceleration * turning**2 / 2 + drive.turn_rate * (times - turning)
        deviation = np.linspace(0, math.pi, ANGLES)[:, None]
        # a robot that backs up need not turn
        forward = drive.speed[0] >= 0
        left = np.maximum(deviation - turned[1:], 0) if forward else np.zeros((ANGLES, count))
        share = np.maximum(np.cos(left), 0)
        nearer = np.cumsum(np.diff(self._driven) * share, axis=1)
        self._nearer = np.concatenate([np.zeros((ANGLES, 1)), nearer], axis=1)

    def distance(self, steps: int) -> float:
        """Return the metres that can be driven in so many control periods."""
        return float(self._driven[min(steps, PERIODS) * SUBSTEPS])

    def driving(self, lengths: Float[np.ndarray, "p"], limit: int) -> Int[np.ndarray, "p"]:
        """Return the control periods that ways of these lengths take at least; limit + 1 where more.

        Args:
            lengths: in metres.
            limit: periods that are looked ahead.
        """
        return np.searchsorted(self._driven[: limit * SUBSTEPS + 1 : SUBSTEPS], lengths, side="left")

    def approaching(
        self,
        distances: Float[np.ndarray, "p"],
        deviations: Float[np.ndarray, "p"],
        room: float,
        limit: int,
    ) -> Int[np.ndarray, "p"]:
        """Return the control periods that coming nearer by a distance takes at least; limit + 1 where more.

        Args:
            distances: in metres.
            deviations: absolute bearing at the start, radians.
            room: metres that can be driven before anything can be touched; from then on nothing is said of
                turning, as a robot may be pushed and slide.
            limit: periods that are looked ahead.
        """
        last = limit * SUBSTEPS + 1
        untouched = int(np.searchsorted(self._driven[:last], room, side="right")) - 1
        nearer, driven = self._nearer[:, :last:SUBSTEPS].copy(), self._driven[:last:SUBSTEPS]
        pushed = np.arange(0, last, SUBSTEPS) >= untouched
        nearer[:, pushed] = self._nearer[:, [untouched]] + driven[pushed] - self._driven[untouched]
        row = np.floor(deviations * ((ANGLES - 1) / math.pi) - 1e-9).astype(int).clip(0, ANGLES - 1)
        return _first_above(nearer, row, distances)

    def towards(
        self,
        pose: Float[np.ndarray, "3"],
        points: Float[np.ndarray, "p 2"],
        radius: float,
        room: float,
        limit: int,
    ) -> Int[np.ndarray, "p"]:
        """Return the control periods that getting within a radius of points takes at least, as above.

        Args:
            pose: at the start, at rest.
            points: in metres.
            radius: in metres.
            room: as in :meth:`approaching`.
            limit: periods that are looked ahead.
        """
        offset = points - pose[:2]
        distance = np.maximum(np.linalg.norm(offset, axis=1), 1e-9)
        bearing = np.arctan2(offset[:, 1], offset[:, 0]) - pose[2]
        deviation = np.abs((bearing + np.pi) % (2 * np.pi) - np.pi)
        width = np.arcsin(np.minimum(radius / distance, 1))
        width = np.where(distance <= radius, np.pi, width)
        return self.approaching(distance - radius, np.maximum(deviation - width, 0), room, limit)


def _first_above(
    table: Float[np.ndarray, "k t"], row: Int[np.ndarray, "p"], values: Float[np.ndarray, "p"]
) -> Int[np.ndarray, "p"]:
    """Return the first column of each row whose entry is not below a value, t where none is, by halving.

    Args:
        table: rows that never fall.
        row: of each value.
        values: looked for.
    """
    low = np.zeros(len(values), np.int64)
    high = np.full(len(values), table.shape[1])
    flat, start = table.ravel(), row * table.shape[1]
    for _ in range(table.shape[1].bit_length()):
        middle = (low + high) // 2
        below = flat[start + np.minimum(middle, table.shape[1] - 1)] < values
        below &= low < high
        low = np.where(below, middle + 1, low)
        high = np.where(below, high, middle)
    return low
