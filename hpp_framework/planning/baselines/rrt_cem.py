"""RRT+CEM (section 5 of the paper): the paper's search over goals, with RRT paths as its motion model."""

from __future__ import annotations

from dataclasses import fields

from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.core.planner import PlannerContext
from hpp_framework.core.task import Task
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.planning.baselines.rrt import TreeConfig
from hpp_framework.planning.baselines.rrt_planner import PLAIN, RrtConfig, RrtPlanner, configured
from hpp_framework.planning.baselines.rrt_predictor import MotionConfig, RrtPredictor
from hpp_framework.planning.hpp.cem import CemConfig
from hpp_framework.planning.hpp.planner import HppConfig, HppPlanner
from hpp_framework.utils.validation import Positive, Share, validated


@validated
class RrtCemConfig:
    """Parameters of RRT+CEM: those of :class:`RrtConfig`, of imagined motion and of the search over goals.

    Attributes:
        plan_every: control steps between plans.
        known_map: whether the true map is known, instead of what the robot's lidar saw.
        margin: gap between footprint and obstacles that paths keep, metres.
        snap: whether a goal that cannot be reached moves to the nearest place that can.
        look_ahead: distance along the path at which the skill's goal lies ahead of the robot, metres.
        tree: how trees grow.
        motion: how all robots are imagined to move.
        horizon: prediction steps.
        terminal: share of the score that is the reward at the horizon; the rest is its mean over time.
        least_std: smallest standard deviation of the first Gaussian over goals along an axis, metres.
        cem: the search.
    """

    plan_every: int = 10
    known_map: bool = False
    margin: float = 0.1
    snap: bool = True
    look_ahead: float = 2.0
    tree: TreeConfig = TreeConfig()
    motion: MotionConfig = MotionConfig()
    horizon: int = 12
    terminal: Share = 0.4
    least_std: Positive = 2.5
    cem: CemConfig = CemConfig()

    def __post_init__(self) -> None:
        self.following()
        self.search()

    def following(self) -> RrtConfig:
        """Return how paths are found and followed."""
        return RrtConfig(**{each.name: getattr(self, each.name) for each in fields(RrtConfig)})

    def search(self) -> HppConfig:
        """Return how goals are searched for: by the paper's planner."""
        return HppConfig(horizon=self.horizon, plan_every=self.plan_every, cem=self.cem)


PRESETS = {
    "paper": RrtCemConfig(
        plan_every=40,
        least_std=0.25,
        snap=False,
        tree=PLAIN,
        motion=MotionConfig(period=CONTROL_PERIOD),
        horizon=5,
        terminal=1.0,
    ),
    "best": RrtCemConfig(),
}


def cem(context: PlannerContext) -> RrtPlanner:
    """Build RRT+CEM under the context's preset and settings.

    Raises:
        ConfigError: if OMPL is not installed.
    """
    config = configured("rrt-cem", PRESETS, context)
    predictor = RrtPredictor(context.team.as_believed_by(context.agent).robots, config.margin, config.motion)
    task = OverTime(context.task, config.terminal)
    search = HppPlanner(predictor, task, config.search(), config.least_std)
    planner = RrtPlanner(search, context, config.following(), predictor)
    planner.config = config
    return planner


class OverTime(Task):
    """A task that scores an imagined trajectory by all of it, not by its end alone.

    Args:
        task: rewards poses, and says when it is done.
        at_end: share of the score that is the reward at the end; the rest is its mean over time.
    """

    def __init__(self, task: Task, at_end: float) -> None:
        self.task = task
        self.at_end = at_end

    def reward(self, poses: Float[Tensor, "*b n 3"]) -> Float[Tensor, "*b"]:
        """Return the reward of team poses."""
        return self.task.reward(poses)

    def trajectory_reward(self, poses: Float[Tensor, "*b t n 3"]) -> Float[Tensor, "*b"]:
        """Return the reward at the end and on the way, weighed."""
        reward = self.reward(poses)
        return self.at_end * reward[..., -1] + (1 - self.at_end) * reward.mean(-1)

    def success(
        self, poses: Float[Tensor, "*b n 3"], velocities: Float[Tensor, "*b n 2"] | None = None
    ) -> Bool[Tensor, "*b"]:
        """Return whether the objective is fulfilled now."""
        return self.task.success(poses, velocities)

    def targets(
        self, goals: Float[Tensor, "*#b 2"], poses: Float[Tensor, "*#b n 3"]
    ) -> Float[Tensor, "*c n 3"] | None:
        """Return each robot's target around a shared goal."""
        return self.task.targets(goals, poses)
