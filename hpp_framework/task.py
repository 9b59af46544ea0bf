"""Tasks: the shared objective of a team.

The environment, the evaluation and the planner's imagined rollouts all call these same pure functions.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

from jaxtyping import Bool, Float
from torch import Tensor


class Task(ABC):
    """A shared objective.

    Attributes:
        sustain_steps: consecutive control steps that :meth:`done` must hold for success.
        radius: distance from the team's centre in metres within which everybody fulfils the objective, for
            plots; None where the objective is no such distance.
    """

    sustain_steps: int = 5
    radius: float | None = None

    @abstractmethod
    def reward(self, poses: Float[Tensor, "*b n 3"]) -> Float[Tensor, "*b"]:
        """Return the reward of team poses (world frame)."""

    def trajectory_reward(self, poses: Float[Tensor, "*b t n 3"]) -> Float[Tensor, "*b"]:
        """Return the reward of an imagined trajectory; that of its end unless a task says otherwise.

        Only planner ``hpp`` with preset ``paper`` asks for it; preset ``best`` averages :meth:`reward` over
        the times of a trajectory instead.
        """
        return self.reward(poses[..., -1, :, :])

    @abstractmethod
    def met(self, poses: Float[Tensor, "*b n 3"]) -> Bool[Tensor, "*b"]:
        """Return whether the poses alone fulfil the objective (first contact)."""

    @abstractmethod
    def done(self, poses: Float[Tensor, "*b n 3"], velocities: Float[Tensor, "*b n 2"]) -> Bool[Tensor, "*b"]:
        """Return whether the objective is fulfilled now, motion included.

        Args:
            poses: of the team, world frame.
            velocities: forward speed (m/s) and turn rate (rad/s) of each robot.
        """
