"""From shared goals to each robot's own place: what planners of shared goals ask of a task."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.predictor import Imagine, Predictor
from hpp_framework.core.task import Task
from hpp_framework.core.types import Observation, Trajectories


def own_place(
    task: Task, goal: Float[Tensor, "b 2"], poses: Float[Tensor, "b n 3"], agent: int
) -> Float[Tensor, "b 2"]:
    """Return where an agent goes when the team shares a goal: the goal itself unless the task knows better.

    Args:
        task: the shared objective.
        goal: shared, world frame, metres.
        poses: of the team, as the agent observes them.
        agent: its index.
    """
    places = task.places(goal, poses)
    if places is None:
        places = task.parking(goal, poses)
    return goal if places is None else places[:, agent]


def imagine_task(predictor: Predictor, task: Task, observation: Observation, horizon: int) -> Imagine:
    """Prepare a predictor for the shared goals of a task, each of which may mean a place of its own a robot.

    Args:
        predictor: the agent's motion models.
        task: the shared objective.
        observation: of the agent.
        horizon: prediction steps.
    """
    poses = observation.team_poses
    if task.places(poses[:, 0, :2], poses) is None:
        return predictor.condition(observation, horizon)
    imagine = predictor.condition_places(observation, horizon)

    def towards(goals: Float[Tensor, "b g 2"]) -> Trajectories:
        places = task.places(goals, poses[:, None])
        assert places is not None, "a task has places for all goals or for none"
        return imagine(places)

    return towards
