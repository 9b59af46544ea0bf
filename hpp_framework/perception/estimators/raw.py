"""No estimator: what came last counts as it is."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.core.estimator import Estimate, Estimator, EstimatorContext, Reading
from hpp_framework.core.robot import Lidar


def cleaned(scan: Float[Tensor, "b k"], lidar: Lidar) -> Float[Tensor, "b k"]:
    """Return a scan in which each beam has a range: where none was sent, the nearer of its neighbours'.

    Args:
        scan: metres; NaN, infinite, and below 0 where the driver sent no range.
        lidar: whose limits hold.
    """
    wrong = ~(scan >= 0)  # NaN too
    if bool(wrong.any()):
        known = scan.masked_fill(wrong, torch.inf)
        padded = torch.nn.functional.pad(known, (2, 2), value=torch.inf)
        scan = torch.where(wrong, padded.unfold(1, 5, 1).amin(-1), scan)
    return scan.clamp(lidar.min_range, lidar.max_range)


class Raw(Estimator):
    """Takes the newest reading for the present.

    Args:
        lidar: of the robot.
    """

    def __init__(self, lidar: Lidar) -> None:
        self.lidar = lidar

    def reset(self, reading: Reading) -> Estimate:
        """Return what was read."""
        return Estimate(reading.poses, reading.velocity, cleaned(reading.scan, self.lidar))

    def update(self, reading: Reading, command: Float[Tensor, "b 2"]) -> Estimate:
        """Return what was read."""
        del command
        return self.reset(reading)

    def restart(self, reading: Reading, robots: Bool[Tensor, "b n"]) -> Estimate:
        """Return what was read."""
        del robots
        return self.reset(reading)


def raw(context: EstimatorContext) -> Raw:
    """Build the estimator."""
    return Raw(context.robots[context.agent].lidar)
