"""A motion model that looks far: positions 1 to 15 s ahead, directly, along paths through what was seen.

A robot that is told a goal goes there around obstacles. So the model first finds that path
itself, on a local map of all that the *predicting* agent saw in the last seconds, and a network then says
how the robot's motion differs from going along it at a steady speed, with a standard deviation. Everything is
expressed in the frame that has its origin at the predicted robot and its x axis towards the goal, so that
one experience serves every direction.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import cast

import torch
from jaxtyping import Float
from torch import Tensor, nn

from hpp_framework.core import geometry
from hpp_framework.core.predictor import Imagine, Predictor, PredictorRequest, PredictorTraining
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import Observation, Trajectories
from hpp_framework.perception.local_map import LocalMap, build_local_map, clearance_around, mapped_paths
from hpp_framework.perception.sensing import HISTORY, KEYFRAMES
from hpp_framework.prediction.dataset import Batch, Prepared, collected_team
from hpp_framework.prediction.library import find_members, load_models
from hpp_framework.prediction.training import Recipe, constant_velocity_error, train_model
from hpp_framework.utils.blocks import in_blocks
from hpp_framework.utils.errors import ConfigError

KIND = "far-sighted"
OFFSETS = tuple(range(5, 76, 5))
"""Control steps ahead: every second up to 15 s."""

SPEED = 0.7
"""Speed in m/s of the motion along the path that the network corrects."""

ALONG = tuple(-1.0 + 0.5 * i for i in range(17))
ACROSS = tuple(-3.0 + 0.6 * i for i in range(11))
"""The grid of points around the predicted robot, towards the goal and across, in metres."""

HIDDEN = 256
SCAN_FEATURES = 64
CHANNELS = 12
PATH = 2 * len(OFFSETS) + 5
"""Points of the path, its length and cost against the straight line."""
LOCAL = 2 + 2 + (2 + 1 + 1) * (HISTORY - 1) + 4 + 2 * (HISTORY - 1)
"""Goal distance, heading, the subject's recent motion, where the agent is, the agent's recent motion."""
FEATURES = len(ALONG) * len(ACROSS) + PATH + LOCAL

SMALLEST_STD = 0.03
LARGEST_STD = 5.0
"""Bounds of the predicted standard deviation, in metres."""
DOUBT_WEIGHT = 0.1
"""Weight of the likelihood, which trains the standard deviation only, beside the distance."""
DISTINCT = 800
"""Batches whose local maps a training makes: finding paths takes longer than a gradient step."""


class FarSightedNetwork(nn.Module):
    """Scan features (once a plan) and goal-dependent ones (once a candidate) to future positions.

    Args:
        robot: the predicting one.
    """

    def __init__(self, robot: RobotSpec) -> None:
        super().__init__()
        self.lidar = robot.lidar
        self.scan = nn.Sequential(
            nn.Conv1d(1, CHANNELS, 7, stride=3), nn.ReLU(),
            nn.Conv1d(CHANNELS, CHANNELS, 5, stride=3), nn.ReLU(),
            nn.Flatten(),
        )  # fmt: skip
        with torch.no_grad():
            width = self.scan(torch.zeros(1, 1, robot.lidar.beams)).shape[1]
        self.context = nn.Linear(width, HIDDEN)
        self.first = nn.Linear(FEATURES, HIDDEN)
        self.rest = nn.Sequential(
            nn.ReLU(), nn.Linear(HIDDEN, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, HIDDEN), nn.ReLU(),
            nn.Linear(HIDDEN, 3 * len(OFFSETS)),
        )  # fmt: skip

    def forward(
        self,
        scan: Float[Tensor, "b k"],
        features: Float[Tensor, "b g f"],
        steady: Float[Tensor, "b g t 2"],
        heading: Float[Tensor, "b g"],
    ) -> tuple[Float[Tensor, "b g t 2"], Float[Tensor, "b g t"]]:
        """Return world positions of the subject at :data:`OFFSETS`, and their standard deviation in metres.

        Args:
            scan: of the agent, metres.
            features: see :func:`describe`.
            steady: positions of a steady motion along the path, world frame, metres.
            heading: direction from the subject to the goal.
        """
        context = self.context(self.scan((1 / (1 + scan))[:, None]))
        out = self.rest(self.first(features) + context[:, None]).unflatten(-1, (len(OFFSETS), 3))
        cos, sin = heading.cos()[..., None], heading.sin()[..., None]
        ahead, aside = out[..., 0], out[..., 1]
        offset = torch.stack([cos * ahead - sin * aside, sin * ahead + cos * aside], -1)
        std = out[..., 2].exp().clamp(SMALLEST_STD, LARGEST_STD)
        return steady + offset, std


def describe(
    local_map: LocalMap,
    agent_poses: Float[Tensor, "b h 3"],
    subject_poses: Float[Tensor, "b s h 3"],
    goals: Float[Tensor, "b g 2"],
) -> tuple[Float[Tensor, "b s g f"], Float[Tensor, "b s g t 2"], Float[Tensor, "b s g"]]:
    """Return what the network is told of every subject and goal.

    Args:
        local_map: of what the agent saw, with the paths of the subjects.
        agent_poses: its history.
        subject_poses: their histories.
        goals: world frame, metres.

    Returns:
        Features, positions of a steady motion along the path, and the direction from subject to goal.
    """
    now = subject_poses[:, :, -1, :2]
    towards = goals[:, None] - now[:, :, None]
    distance = towards.norm(dim=-1)
    heading = torch.atan2(towards[..., 1], towards[..., 0])
    frame = torch.cat([now[:, :, None].expand_as(towards), heading[..., None]], -1)
    arcs = torch.tensor(OFFSETS) * (CONTROL_PERIOD * SPEED)
    paths = mapped_paths(local_map, goals, arcs)
    points = geometry.to_frame(frame[..., None, :], paths.points) / 5
    straight = distance[..., None]
    length, cost = paths.lengths[..., None], paths.costs[..., None]
    path = [
        points.flatten(3),
        (length / 10).clamp(max=2), ((length - straight) / 5).clamp(-1, 2),
        ((cost - length) / 5).clamp(-1, 4),
        1 / (1 + length), (length / (straight + 0.3)).clamp(max=5),
    ]  # fmt: skip
    grid = torch.cartesian_prod(torch.tensor(ALONG), torch.tensor(ACROSS))
    near = clearance_around(local_map, frame, grid)
    motion = _motion(agent_poses, subject_poses, frame, straight)
    return torch.cat([near, *path, *motion], -1), paths.points, heading


def _motion(
    agent_poses: Float[Tensor, "b h 3"],
    subject_poses: Float[Tensor, "b s h 3"],
    frame: Float[Tensor, "b s g 3"],
    distance: Float[Tensor, "b s g 1"],
) -> list[Float[Tensor, "b s g _"]]:
    """Return goal distance, headings, recent motion of subject and agent, and where the agent is."""
    subject = geometry.between(frame[..., None, :], subject_poses[:, :, None])
    agent = geometry.between(frame[..., None, :], agent_poses[:, None, None])
    heading = subject[..., 2]
    turned = geometry.wrap_angle(heading[..., 1:] - heading[..., :-1])
    steps = (subject[..., 1:, :2] - subject[..., :-1, :2]) * 5
    return [
        (distance / 10).clamp(max=2.0), 1 / (1 + distance),
        heading[..., -1:].cos(), heading[..., -1:].sin(),
        steps.flatten(3), turned * 5, steps.norm(dim=-1),
        (agent[..., -1, :2] / 5).clamp(-2, 2), agent[..., -1, 2:].cos(), agent[..., -1, 2:].sin(),
        ((agent[..., 1:, :2] - agent[..., :-1, :2]) * 5).flatten(3),
    ]  # fmt: skip


class FarSighted(Predictor):
    """Imagines every robot of the team second by second.

    Args:
        models: one per robot, in team order; that of the agent is its self-predictor.
        robots: the team.
    """

    def __init__(self, models: list[FarSightedNetwork], robots: tuple[RobotSpec, ...]) -> None:
        self.models = models
        self.radii = torch.tensor([robot.footprint_radius for robot in robots])
        self.times = torch.tensor(OFFSETS) * CONTROL_PERIOD

    def rollout(self, observation: Observation, goals: Float[Tensor, "b g 2"], horizon: int) -> Trajectories:
        """Imagine ``horizon`` seconds; headings are not predicted (NaN).

        Raises:
            ConfigError: if the horizon is longer than 15 s.
        """
        return self.condition(observation, horizon)(goals)

    @torch.no_grad()
    def condition(self, observation: Observation, horizon: int) -> Imagine:
        """Map what the agent saw, once for all goals; raises as :meth:`rollout` does."""
        if not 1 <= horizon <= len(OFFSETS):
            raise ConfigError(
                f"{KIND} predicts 1 to {len(OFFSETS)} steps of a second, but the horizon is {horizon}."
            )
        team = observation.team_poses
        local_map = build_local_map(
            self.models[0].lidar, observation.agent, team, observation.scan, observation.keyframes,
            team[..., :2], self.radii,
        )  # fmt: skip
        own, team = observation.poses[:, :, observation.agent], observation.poses.transpose(1, 2)

        @torch.no_grad()
        def imagine(goals: Float[Tensor, "b g 2"]) -> Trajectories:
            features, steady, heading = describe(local_map, own, team, goals)
            guesses = [
                in_blocks(model, observation.scan, features[:, i], steady[:, i], heading[:, i], rows=1)
                for i, model in enumerate(self.models)
            ]
            xy = torch.stack([guess[0][:, :, :horizon] for guess in guesses], 3)
            std = torch.stack([guess[1][:, :, :horizon] for guess in guesses], 3)
            poses = torch.cat([xy, torch.full_like(xy[..., :1], math.nan)], -1)
            return Trajectories(poses, self.times[:horizon], std)

        return imagine


def create(request: PredictorRequest) -> FarSighted:
    """Load the models of a team (see :func:`hpp_framework.prediction.library.load_models` for the errors)."""
    models = cast("list[FarSightedNetwork]", load_models(KIND, request, FarSightedNetwork))
    return FarSighted(models, request.team.robots)


def train(config: PredictorTraining) -> Path:
    """Train one model on the distance to where the robot really went, and on the doubt that is left."""
    team = collected_team(config.data)
    agent, subject = find_members(team, config.agent, config.subject)

    def prepare(batch: Batch) -> Prepared:
        local_map = build_local_map(
            agent.robot.lidar, config.agent, batch.team_poses, batch.scans[:, -1], batch.keyframes,
            batch.subject_poses[:, -1:, :2], torch.tensor([subject.robot.footprint_radius]),
        )  # fmt: skip
        told = describe(local_map, batch.agent_poses, batch.subject_poses[:, None], batch.goals[:, None])
        features, steady, heading = (each[:, 0] for each in told)
        return features.half(), steady, heading

    return train_model(
        config,
        Recipe(
            kind=KIND, build=FarSightedNetwork, offsets=OFFSETS, scan_history=1, scan_future=0, loss=_loss,
            errors=_errors, headline=("error_5s_m", "constant_velocity_5s_m"), keyframes=KEYFRAMES,
            prepare=prepare, distinct=DISTINCT,
        ),
    )  # fmt: skip


def _missed(model: nn.Module, batch: Batch) -> tuple[Float[Tensor, "b t"], Float[Tensor, "b t"]]:
    """Return the distance between guess and truth, and the standard deviation that was predicted."""
    assert isinstance(model, FarSightedNetwork)
    assert batch.prepared is not None
    features, steady, heading = batch.prepared
    guess, std = model(batch.scans[:, -1], features.float(), steady, heading)
    return (guess[:, 0] - batch.future[..., :2]).norm(dim=-1), std[:, 0]


def _loss(model: nn.Module, batch: Batch) -> Tensor:
    """Train positions on a Huber-like loss, so that one detour does not outweigh many straight paths.

    The standard deviation is trained on the likelihood of what positions miss, which leaves them alone.
    """
    distance, std = _missed(model, batch)
    smooth = (distance.square() + 0.04).sqrt() - 0.2
    doubt = distance.detach().square() / (2 * std.square()) + 2 * std.log()
    return ((smooth + DOUBT_WEIGHT * doubt) * batch.valid).sum() / batch.valid.sum().clamp(min=1)


def _errors(model: nn.Module, batch: Batch) -> dict[str, float]:
    """Return the mean position error by horizon, and that of constant velocity, in metres."""
    (ours, std), theirs = _missed(model, batch), constant_velocity_error(batch, OFFSETS)
    rows: dict[str, float] = {}
    for index, offset in enumerate(OFFSETS):
        keep = batch.valid[:, index]
        seconds = round(offset * CONTROL_PERIOD)
        rows[f"error_{seconds}s_m"] = float(ours[keep, index].mean())
        rows[f"constant_velocity_{seconds}s_m"] = float(theirs[keep, index].mean())
        rows[f"std_{seconds}s_m"] = float(std[keep, index].mean())
    return rows
