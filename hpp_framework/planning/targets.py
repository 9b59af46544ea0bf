"""From shared goals to each robot's own target: what planners of shared goals ask of a task."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.predictor import Imagine, Predictor
from hpp_framework.core.task import Task
from hpp_framework.core.types import Observation, Trajectories


def own_target(
    task: Task, goal: Float[Tensor, "b 2"], poses: Float[Tensor, "b n 3"], agent: int
) -> Float[Tensor, "b 2"]:
    """Return where an agent goes when the team shares a goal: the goal itself unless the task knows better.

    Args:
        task: the shared objective.
        goal: shared, world frame, metres.
        poses: of the team, as the agent observes them.
        agent: its index.
    """
    targets = task.targets(goal, poses)
    return goal if targets is None else targets[:, agent, :2]


def imagine_task(predictor: Predictor, task: Task, observation: Observation, horizon: int) -> Imagine:
    """Prepare a predictor for the shared goals of a task, each of which may mean a target for each robot.

    Args:
        predictor: the agent's motion models.
        task: the shared objective.
        observation: of the agent.
        horizon: prediction steps.
    """
    poses = observation.team_poses
    if task.targets(poses[:, 0, :2], poses) is None:
        return predictor.condition(observation, horizon)
    imagine = predictor.condition_places(observation, horizon)

    def towards(goals: Float[Tensor, "b g 2"]) -> Trajectories:
        targets = task.targets(goals, poses[:, None])
        assert targets is not None, "a task has targets for all goals or for none"
        return imagine(targets[..., :2])

    return towards
