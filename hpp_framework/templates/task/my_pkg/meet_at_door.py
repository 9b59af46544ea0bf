"""A task: all robots meet at one place, the door, whose position all robots know."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.task import Task

DOOR = (0.0, 5.0)
"""Where the door is, world coordinates in metres."""
NEAR = 1.0
"""How near to the door all robots must be, in metres."""
AT_REST = 0.1
"""Speed in m/s below which a robot rests."""


class MeetAtDoor(Task):
    """All robots near the door, at rest."""

    def distances(self, poses: Float[Tensor, "*b n 3"]) -> Float[Tensor, "*b n"]:
        """Return each robot's distance from the door in metres."""
        return (poses[..., :2] - torch.tensor(DOOR).to(poses)).norm(dim=-1)

    def reward(self, poses: Float[Tensor, "*b n 3"]) -> Float[Tensor, "*b"]:
        """Return 0 when all robots are at the door, and less the farther they are."""
        return -2 * (self.distances(poses) - NEAR).clamp(min=0).sum(-1)

    def success(
        self, poses: Float[Tensor, "*b n 3"], velocities: Float[Tensor, "*b n 2"] | None = None
    ) -> Bool[Tensor, "*b"]:
        """Return whether all robots are near the door, and at rest where their velocities are told."""
        near = (self.distances(poses) < NEAR).all(-1)
        return near if velocities is None else near & (velocities[..., 0].abs() < AT_REST).all(-1)


def meet_at_door(robots: Sequence[RobotSpec]) -> MeetAtDoor:
    """Build the task; it is the same for every team."""
    del robots
    return MeetAtDoor()
