"""Predictors: goal-conditioned motion models of a whole team, from one agent's point of view.

The loop that calls one (inside a meta-planner)::

    imagine = predictor.condition(observation, horizon)
    for goals in candidates:
        scores = task.reward(imagine(goals).poses[:, :, -1])
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.team import Team
from hpp_framework.core.types import Observation, Trajectories

Imagine = Callable[[Float[Tensor, "b g 2"]], Trajectories]
"""The motion of the team for each goal, after one observation."""
ImaginePlaces = Callable[[Float[Tensor, "b g n 2"]], Trajectories]
"""The same where each robot has its own place for each goal, see
:meth:`hpp_framework.core.task.Task.places`."""


class Predictor(ABC):
    """Answers "where would we all be if we shared this goal?"."""

    @abstractmethod
    def rollout(self, observation: Observation, goals: Float[Tensor, "b g 2"], horizon: int) -> Trajectories:
        """Imagine the motion of every robot of the team towards each goal.

        Args:
            observation: of the predicting agent.
            goals: candidates in world coordinates, metres.
            horizon: number of prediction steps; their length is the predictor's own
                (see ``Trajectories.times``).
        """

    def condition(self, observation: Observation, horizon: int) -> Imagine:
        """Prepare :meth:`rollout` for many calls with one observation, as a search over goals makes them.

        Predictors override this to compute once what is the same for every goal. A call of the result may
        overwrite the trajectories that the call before returned.
        """
        return lambda goals: self.rollout(observation, goals, horizon)

    def condition_places(self, observation: Observation, horizon: int) -> ImaginePlaces:
        """Prepare the same question for a team in which each robot has its own place.

        Models that know of one shared goal are asked once for the place of each robot, and each answers for
        the robot whose place it is.
        """
        imagine = self.condition(observation, horizon)
        return lambda places: own_motion(imagine(places.flatten(1, 2)), places.shape[1])


def own_motion(imagined: Trajectories, goals: int) -> Trajectories:
    """Return each robot's motion towards its own place.

    Args:
        imagined: the team's motion towards every robot's place, goal by goal.
        goals: how many there are.
    """
    poses = imagined.poses.unflatten(1, (goals, -1)).diagonal(dim1=2, dim2=4).movedim(-1, -2)
    std = imagined.std
    if std is not None:
        std = std.unflatten(1, (goals, -1)).diagonal(dim1=2, dim2=4)
    return Trajectories(poses, imagined.times, std)


@dataclass(frozen=True, kw_only=True)
class PredictorRequest:
    """What a predictor factory is told.

    Attributes:
        team: all robots, with their skills.
        agent: index of the agent that will use it.
        folders: extra folders searched for weights before the registered ones.
    """

    team: Team
    agent: int
    folders: tuple[Path, ...] = ()


@dataclass(frozen=True)
class TrainingProgress:
    """How far the training of a model has come.

    Attributes:
        model: its file name.
        step: gradient steps done.
        status: loss and the like, in a few words.
        message: a line worth keeping, or empty.
    """

    model: str
    step: int
    status: str
    message: str = ""


def print_message(progress: TrainingProgress) -> None:
    """Print the lines worth keeping."""
    if progress.message:
        print(progress.message)


@dataclass(frozen=True, kw_only=True)
class PredictorTraining:
    """What every predictor trainer is told.

    Attributes:
        data: folder written by ``hpp collect``.
        out: folder for weights, card and curves.
        agent: index of the predicting robot in the collected team.
        subject: index of the predicted robot; equal to ``agent`` for self-prediction.
        seed: of the network and the batches.
        steps: gradient steps.
        batch: samples a gradient step.
        learning_rate: of Adam.
        report: is told now and then how far the training has come.
    """

    data: Path
    out: Path
    agent: int
    subject: int
    seed: int = 0
    steps: int = 50_000
    batch: int = 500
    learning_rate: float = 1e-3
    report: Callable[[TrainingProgress], None] = field(default=print_message, compare=False)
