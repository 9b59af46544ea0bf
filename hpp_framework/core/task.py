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
from hpp_framework.utils.errors import ConfigError


@dataclass(frozen=True)
class Terminal:
    """Which teams are in their terminal phase: near enough to finish, whatever goals their robots have.

    Attributes:
        now: which teams (b,).
        middle: around which they come to rest, world frame, metres (b, 2).
        clear: metres around the middle that should be free of things that stand still; 0 keeps the middle.
    """

    now: Bool[Tensor, "b"]
    middle: Float[Tensor, "b 2"]
    clear: float = 0.0


_RENAMED = {
    "met": "success(poses)", "done": "success(poses, velocities)", "places": "targets(goals, poses)",
    "parking": "targets(goals, poses)", "stances": "targets(goals, poses)", "settling": "terminal(poses)",
}  # fmt: skip


class Task(ABC):
    """A shared objective.

    Three lines make one::

        class Meet(Task):
            def reward(self, poses): return -spread(poses)
            def success(self, poses, velocities=None): return spread(poses) < 1.0

    Attributes:
        sustain_steps: consecutive control steps that :meth:`success` must hold.
        radius: distance from the team's centre in metres within which all robots fulfil the objective, for
            plots; None where the objective is no such distance.
        halts: whether robots stop where :meth:`success` holds; not where the objective is to keep moving.
    """

    sustain_steps: int = 5
    radius: float | None = None
    halts: bool = True

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        for old, new in _RENAMED.items():
            if old in cls.__dict__:
                raise ConfigError(f"task {cls.__name__}: '{old}' is now {new}; rename it.")

    @abstractmethod
    def reward(self, poses: Float[Tensor, "*b n 3"]) -> Float[Tensor, "*b"]:
        """Return the reward of team poses (world frame); headings are NaN where a predictor has none."""

    @abstractmethod
    def success(
        self, poses: Float[Tensor, "*b n 3"], velocities: Float[Tensor, "*b n 2"] | None = None
    ) -> Bool[Tensor, "*b"]:
        """Return whether the objective is fulfilled now.

        Args:
            poses: of the team, world frame.
            velocities: forward speed (m/s) and turn rate (rad/s) of each robot; None asks of the poses alone
                (first contact).
        """

    def targets(
        self, goals: Float[Tensor, "*#b 2"], poses: Float[Tensor, "*#b n 3"]
    ) -> Float[Tensor, "*c n 3"] | None:
        """Return where each robot goes when the team shares a goal; None: all to the goal itself.

        Planners choose shared goals; this gives each robot a target of its own around one: x, y, and a
        heading, NaN for any. It must be the same whichever robot asks, so it may depend on the poses and
        nothing else, and should change little as robots move to their targets.

        Args:
            goals: shared goals, world frame, metres.
            poses: of the team now, world frame; leading dimensions are broadcast against those of goals.
        """
        del goals, poses
        return None

    def terminal(self, poses: Float[Tensor, "b n 3"]) -> Terminal | None:
        """Return which teams finish now and where; None: robots go where their goals send them to the end.

        Goals a little apart are as good once the whole team is near, and a robot that turns from one to the
        next never comes to rest. So this must be the same whichever robot asks, and depend on poses alone.
        In the terminal phase robots go to their :meth:`targets` around the middle, or to the middle itself.

        Args:
            poses: of the team now, world frame.
        """
        del poses
        return None

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


def any_heading(places: Float[Tensor, "*b 2"]) -> Float[Tensor, "*b 3"]:
    """Return places (metres) as targets at which robots look anywhere."""
    return torch.cat([places, torch.full_like(places[..., :1], torch.nan)], -1)
