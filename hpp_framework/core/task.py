"""Tasks: the shared objective of a team.

The environment, the evaluation and the planner's imagined rollouts all call these same pure functions.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.core.requirement import Gathering, Requirement


@dataclass(frozen=True)
class Settling:
    """How a team that is near comes to rest, whatever goals its members have.

    Attributes:
        near: which teams are near enough (b,).
        middle: around which they come to rest, world frame, metres (b, 2).
        clear: metres around the middle that should be free of things that stand still; 0 keeps the middle.
    """

    near: Bool[Tensor, "b"]
    middle: Float[Tensor, "b 2"]
    clear: float


class Task(ABC):
    """A shared objective.

    Attributes:
        sustain_steps: consecutive control steps that :meth:`done` must hold for success.
        radius: distance from the team's centre in metres within which everybody fulfils the objective, for
            plots; None where the objective is no such distance.
        halts: whether agents stop where :meth:`met` holds; not where the objective is to keep moving.
    """

    sustain_steps: int = 5
    radius: float | None = None
    halts: bool = True

    @abstractmethod
    def reward(self, poses: Float[Tensor, "*b n 3"]) -> Float[Tensor, "*b"]:
        """Return the reward of team poses (world frame); headings are NaN where a predictor has none."""

    def unit(self, robots: int) -> float:
        """Return what a metre costs a team of so many robots, against one of two; as in Eq. 1 unless told.

        Planners measure in it what they weigh against rewards, so that it weighs as much in any team.

        Args:
            robots: in the team, at least 1.
        """
        return max(robots * (robots - 1) / 2, 1.0)

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

    def places(
        self, goals: Float[Tensor, "*#b 2"], poses: Float[Tensor, "*#b n 3"]
    ) -> Float[Tensor, "*c n 2"] | None:
        """Return where each robot goes when the team shares a goal; None: everybody to the goal itself.

        Planners choose shared goals; this gives each robot its own place around one. It must be the same
        whoever asks, so it may depend on the poses and nothing else, and should change little as robots move
        to their places.

        Args:
            goals: shared goals, world frame, metres.
            poses: of the team now, world frame; leading dimensions are broadcast against those of goals.
        """
        del goals, poses
        return None

    def parking(
        self, goals: Float[Tensor, "*#b 2"], poses: Float[Tensor, "*#b n 3"]
    ) -> Float[Tensor, "*c n 2"] | None:
        """Return where around a shared goal each robot drives so that all find room; None: to the goal.

        Unlike :meth:`places` it is no part of what is imagined and scored, so it must be near the goal.

        Args:
            goals: shared goals, world frame, metres.
            poses: of the team now, world frame.
        """
        del goals, poses
        return None

    def settling(self, poses: Float[Tensor, "b n 3"]) -> Settling | None:
        """Return which teams settle now and where; None: robots go where their goals send them to the end.

        Goals a little apart are as good once everybody is near, and a robot that turns from one to the next
        never comes to rest. So it must be the same whoever asks, and depend on poses alone.

        Args:
            poses: of the team now, world frame.
        """
        del poses
        return None

    def stances(self, middle: Float[Tensor, "b 2"], poses: Float[Tensor, "b n 3"]) -> Float[Tensor, "b n 3"]:
        """Return where each robot of a settling team stands, and where it looks (NaN: as it likes).

        Args:
            middle: around which they come to rest, world frame, metres.
            poses: of the team now, world frame.
        """
        raise NotImplementedError(f"{type(self).__name__} settles and must say where.")

    def requirement(self) -> Requirement | None:
        """Return what holds in every fulfilled state, for lower bounds of the time; None if unknown."""
        return None if self.radius is None else Gathering(self.radius)


def relative_speed(
    poses: Float[Tensor, "*b n 3"], velocities: Float[Tensor, "*b n 2"]
) -> Float[Tensor, "*b"]:
    """Return the largest speed at which two robots move apart, together or past each other, m/s.

    Args:
        poses: of the team, world frame.
        velocities: forward speed (m/s) and turn rate (rad/s) of each robot.
    """
    heading = poses[..., 2]
    motion = velocities[..., :1] * torch.stack([heading.cos(), heading.sin()], -1)
    return (motion[..., :, None, :] - motion[..., None, :, :]).norm(dim=-1).flatten(-2).amax(-1)
