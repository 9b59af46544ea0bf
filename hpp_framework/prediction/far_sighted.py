"""A motion model that looks far: positions 1 to 12 s ahead, directly, without rolling errors out.

Everything is expressed in the frame that has its origin at the predicted robot and its x axis towards the
goal, so that one experience serves every direction. What lies around that robot is read off the *predicting*
agent's scan by asking, for a grid of points, how far each lies in front of or behind what the lidar saw in
its direction.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import cast

import torch
from jaxtyping import Float
from torch import Tensor, nn

from hpp_framework import geometry
from hpp_framework.errors import ConfigError
from hpp_framework.kernels import wp
from hpp_framework.prediction import depth_kernels
from hpp_framework.prediction.dataset import Batch
from hpp_framework.prediction.library import load_models
from hpp_framework.prediction.training import Recipe, constant_velocity_error, train_model
from hpp_framework.predictor import Predictor, PredictorRequest, PredictorTraining
from hpp_framework.robot import Lidar, RobotSpec
from hpp_framework.sensing import HISTORY
from hpp_framework.sim.simulator import CONTROL_PERIOD
from hpp_framework.types import Observation, Trajectories

KIND = "far-sighted"
OFFSETS = tuple(range(5, 61, 5))
"""Control steps ahead: every second up to 12 s."""

ALONG = tuple(-1.5 + 0.5 * i for i in range(20))
ACROSS = tuple(-3.0 + 0.6 * i for i in range(11))
"""The grid of points around the predicted robot, towards the goal and across, in metres."""

HIDDEN = 256
SCAN_FEATURES = 64
_DEPTH = 1.5
_CHANNELS = 12
_LOCAL = 2 + 2 + (2 + 1 + 1) * (HISTORY - 1) + 4 + 2 * (HISTORY - 1)
"""Goal distance, heading, the subject's recent motion, where the agent is, the agent's recent motion."""


class FarSightedNetwork(nn.Module):
    """Scan context (once a plan) and goal-dependent features (once a candidate) to future positions.

    Args:
        lidar: of the predicting agent.
    """

    mount: Tensor
    grid: Tensor
    times: Tensor

    def __init__(self, lidar: Lidar) -> None:
        super().__init__()
        self.first_angle = float(lidar.angles()[0])
        self.angle_step = float(lidar.angles()[1] - lidar.angles()[0])
        self.beams = lidar.beams
        self.scan = nn.Sequential(
            nn.Conv1d(1, _CHANNELS, 7, stride=3), nn.ReLU(),
            nn.Conv1d(_CHANNELS, _CHANNELS, 5, stride=3), nn.ReLU(),
            nn.Flatten(),
        )  # fmt: skip
        with torch.no_grad():
            width = self.scan(torch.zeros(1, 1, lidar.beams)).shape[1]
        self.context = nn.Linear(width, SCAN_FEATURES)
        self.first = nn.Linear(SCAN_FEATURES + len(ALONG) * len(ACROSS) + _LOCAL, HIDDEN)
        self.rest = nn.Sequential(
            nn.ReLU(), nn.Linear(HIDDEN, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, HIDDEN), nn.ReLU(),
            nn.Linear(HIDDEN, 2 * len(OFFSETS)),
        )  # fmt: skip
        self.register_buffer("mount", torch.tensor(lidar.mount), persistent=False)
        grid = torch.cartesian_prod(torch.tensor(ALONG), torch.tensor(ACROSS))
        self.register_buffer("grid", grid, persistent=False)
        self.register_buffer("times", torch.tensor(OFFSETS) * CONTROL_PERIOD, persistent=False)

    def forward(
        self,
        agent_poses: Float[Tensor, "b h 3"],
        subject_poses: Float[Tensor, "b h 3"],
        scan: Float[Tensor, "b k"],
        goals: Float[Tensor, "b g 2"],
    ) -> Float[Tensor, "b g t 2"]:
        """Return world positions of the subject for every goal, at :data:`OFFSETS`."""
        context = self.context(self.scan((1 / (1 + scan))[:, None]))
        subject = subject_poses[:, -1]
        towards = goals - subject[:, None, :2]
        distance = towards.norm(dim=-1, keepdim=True)
        frame = torch.cat(
            [subject[:, None, :2].expand_as(towards), torch.atan2(towards[..., 1:], towards[..., :1])], -1
        )
        near = self._surroundings(agent_poses[:, -1], scan, frame)
        local = self._motion(agent_poses, subject_poses, frame, distance)
        candidates = goals.shape[1]
        x = torch.cat([context[:, None].expand(-1, candidates, -1), near, local], -1)
        out = self.rest(self.first(x)).unflatten(-1, (len(OFFSETS), 2))
        straight = torch.minimum(distance, 0.7 * self.times)
        ahead = out + torch.stack([straight, torch.zeros_like(straight)], -1)
        return geometry.to_world(frame[:, :, None], ahead)

    def _surroundings(
        self, agent: Float[Tensor, "b 3"], scan: Float[Tensor, "b k"], frame: Float[Tensor, "b g 3"]
    ) -> Float[Tensor, "b g p"]:
        """Return how far each grid point lies in front of (+) or behind (-) what the lidar saw, in [-1, 1].

        Points outside the field of view count as far behind: nothing is known of them.
        """
        eye = geometry.compose(agent, self.mount.expand_as(agent))
        out = frame.new_empty(*frame.shape[:2], len(self.grid))
        wp.launch(
            depth_kernels.read_depths,
            dim=frame.shape[:2],
            inputs=[
                wp.from_torch(eye, dtype=wp.vec3), wp.from_torch(scan.contiguous()),
                self.first_angle, self.angle_step, wp.from_torch(frame.contiguous(), dtype=wp.vec3),
                wp.from_torch(self.grid, dtype=wp.vec2), _DEPTH, wp.from_torch(out),
            ],
            device=wp.device_from_torch(out.device),
        )  # fmt: skip
        return out

    @staticmethod
    def _motion(
        agent_poses: Float[Tensor, "b h 3"],
        subject_poses: Float[Tensor, "b h 3"],
        frame: Float[Tensor, "b g 3"],
        distance: Float[Tensor, "b g 1"],
    ) -> Float[Tensor, "b g f"]:
        """Return goal distance, headings, recent motion of subject and agent, and where the agent is."""
        subject = geometry.between(frame[:, :, None], subject_poses[:, None])
        agent = geometry.between(frame[:, :, None], agent_poses[:, None])
        heading = subject[..., 2]
        turned = geometry.wrap_angle(heading[..., 1:] - heading[..., :-1])
        steps = (subject[..., 1:, :2] - subject[..., :-1, :2]) * 5
        parts = [
            (distance / 10).clamp(max=2.0), 1 / (1 + distance),
            heading[..., -1:].cos(), heading[..., -1:].sin(),
            steps.flatten(2), turned * 5, steps.norm(dim=-1),
            (agent[..., -1, :2] / 5).clamp(-2, 2), agent[..., -1, 2:].cos(), agent[..., -1, 2:].sin(),
            ((agent[..., 1:, :2] - agent[..., :-1, :2]) * 5).flatten(2),
        ]  # fmt: skip
        return torch.cat(parts, -1)


class FarSighted(Predictor):
    """Imagines every robot of the team second by second.

    Args:
        models: one a robot, in team order; that of the agent is its self-predictor.
    """

    def __init__(self, models: list[FarSightedNetwork]) -> None:
        self.models = models

    @torch.no_grad()
    def rollout(self, observation: Observation, goals: Float[Tensor, "b g 2"], horizon: int) -> Trajectories:
        """Imagine ``horizon`` seconds; headings are not predicted (NaN).

        Raises:
            ConfigError: if the horizon is longer than 12 s.
        """
        if not 1 <= horizon <= len(OFFSETS):
            raise ConfigError(
                f"{KIND} predicts 1 to {len(OFFSETS)} steps of a second, but the horizon is {horizon}."
            )
        own = observation.poses[:, :, observation.agent]
        positions = [
            model(own, observation.poses[:, :, subject], observation.scan, goals)[:, :, :horizon]
            for subject, model in enumerate(self.models)
        ]
        xy = torch.stack(positions, 3)
        poses = torch.cat([xy, torch.full_like(xy[..., :1], math.nan)], -1)
        return Trajectories(poses, self.models[0].times[:horizon])


def _build(robot: RobotSpec) -> FarSightedNetwork:
    return FarSightedNetwork(robot.lidar)


def create(request: PredictorRequest) -> FarSighted:
    """Load the models of a team (see :func:`hpp_framework.prediction.library.load_models` for the errors)."""
    return FarSighted(cast("list[FarSightedNetwork]", load_models(KIND, request, _build)))


def train(config: PredictorTraining) -> Path:
    """Train one model on the distance to where the robot really went."""
    return train_model(
        config,
        Recipe(
            kind=KIND, build=_build, offsets=OFFSETS, scan_history=1, scan_future=0, loss=_loss,
            errors=_errors, headline=("error_5s_m", "constant_velocity_5s_m"),
        ),
    )  # fmt: skip


def _distances(model: nn.Module, batch: Batch) -> Float[Tensor, "b t"]:
    assert isinstance(model, FarSightedNetwork)
    guess = model(batch.agent_poses, batch.subject_poses, batch.scans[:, -1], batch.goals[:, None])[:, 0]
    return (guess - batch.future[..., :2]).norm(dim=-1)


def _loss(model: nn.Module, batch: Batch) -> Tensor:
    """Huber-like loss: the distance itself, so that one detour does not outweigh many straight ways."""
    distance = _distances(model, batch)
    smooth = (distance.square() + 0.04).sqrt() - 0.2
    return (smooth * batch.valid).sum() / batch.valid.sum().clamp(min=1)


def _errors(model: nn.Module, batch: Batch) -> dict[str, float]:
    """Return the mean position error by horizon, and that of constant velocity, in metres."""
    ours, theirs = _distances(model, batch), constant_velocity_error(batch, OFFSETS)
    rows: dict[str, float] = {}
    for index, offset in enumerate(OFFSETS):
        keep = batch.valid[:, index]
        seconds = round(offset * CONTROL_PERIOD)
        rows[f"error_{seconds}s_m"] = float(ours[keep, index].mean())
        rows[f"constant_velocity_{seconds}s_m"] = float(theirs[keep, index].mean())
    return rows
