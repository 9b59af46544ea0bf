"""Stop-on-success: agents stop where braking fulfils the task."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Bool
from torch import Tensor

from hpp_framework.control.stopping import Halting
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.task import Task
from hpp_framework.core.types import Observation


class Rest:
    """Decides when an agent stops: when braking now leaves everybody where the task is fulfilled.

    "The process stops when the agents are close to each other" (section 4.2 of the paper).

    Args:
        task: the shared objective.
        robots: the team, for its deceleration.
    """

    def __init__(self, task: Task, robots: Sequence[RobotSpec]) -> None:
        self.task = task
        self.halting = Halting(robots)

    def __call__(self, observation: Observation) -> Bool[Tensor, "b"]:
        """Return whether to rest now, judged from observed poses, their recent change and odometry."""
        poses = observation.team_poses
        halt = self.halting(observation)
        return self.task.met(poses) | self.task.met(torch.cat([halt, poses[..., 2:]], -1))
