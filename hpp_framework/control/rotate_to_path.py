"""Rotate to path: turns a robot round where the path to its waypoint begins behind it.

A reactive skill decides by what it sees now. Beside an island it goes on in the direction in which it drives,
even where turning back is much shorter, and circles; its planner and its teammates expect it to come back.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.config.settings import altered
from hpp_framework.core import geometry
from hpp_framework.core.control import ControlContext, ControlLayer
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.types import Observation
from hpp_framework.perception.local_map import build_local_map, mapped_paths
from hpp_framework.utils.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class RotateToPathConfig:
    """When a robot is turned round, and how far it is sent back.

    Attributes:
        behind: bearing of the beginning of a path from which on it begins behind, radians.
        beginning: metres of a path that tell where it begins.
        back: metres along such a path that the skill is sent first: skills turn round to what is near and
            behind.
        behind_under_way: the bearing for a robot that is under way, which is sent to the beginning of
            the path only: at speed it would go on as before as soon as it has begun to turn to a point
            farther off. A robot at rest turns anyway, and loses time by what is near.
        under_way: metres that a robot has come within ``since`` if it is under way.
        since: keyframes, one per second.
    """

    behind: float = 2.4
    beginning: float = 0.75
    back: float = 1.5
    behind_under_way: float = 1.8
    under_way: float = 1.0
    since: int = 5

    def __post_init__(self) -> None:
        if not 0 < self.beginning < self.back or self.since < 1:
            raise ConfigError(f"rotate-to-path needs 0 < beginning < back and since >= 1, got {self}.")


class RotateToPath(ControlLayer):
    """Sends a skill a little back along the shortest path where that begins behind the robot.

    The path is found on the agent's local map, as motion models of kind ``far-sighted`` find it, so that
    robots take the path that their models expect.

    Args:
        robot: whose lidar and footprint count.
        config: when, and how far.
    """

    def __init__(self, robot: RobotSpec, config: RotateToPathConfig | None = None) -> None:
        self.config = config or RotateToPathConfig()
        self.lidar = robot.lidar
        self.radius = torch.tensor([robot.footprint_radius])

    def redirect(
        self, observation: Observation, goal: Float[Tensor, "b 2"], waypoint: Float[Tensor, "b 2"]
    ) -> Float[Tensor, "b 2"]:
        """Return the waypoint, or a point on the path to it where that begins behind."""
        del goal
        config = self.config
        here = observation.pose[:, None, :2]
        local_map = build_local_map(
            self.lidar, observation.agent, observation.team_poses, observation.scan, observation.keyframes,
            here, self.radius,
        )  # fmt: skip
        paths = mapped_paths(local_map, waypoint[:, None], torch.tensor([config.beginning, config.back]))
        first, back = paths.points[:, 0, 0].unbind(1)
        under_way = self._under_way(observation)
        turned = geometry.polar(observation.pose, first)[..., 1].abs()
        behind = turned > torch.where(under_way, config.behind_under_way, config.behind)
        back = torch.where(under_way[:, None], first, back)
        return torch.where(behind[:, None], back, waypoint)

    def _under_way(self, observation: Observation) -> Bool[Tensor, "b"]:
        """Return whether the robot has come from elsewhere in the last seconds."""
        here = observation.pose[:, :2]
        if observation.keyframes is None:
            return torch.zeros_like(here[:, 0], dtype=torch.bool)
        before = observation.keyframes.poses[:, -self.config.since :, observation.agent, :2][:, 0]
        return (here - before).norm(dim=-1) > self.config.under_way


def rotate_to_path(context: ControlContext) -> RotateToPath:
    """Build the layer."""
    config = altered(RotateToPathConfig(), context.settings, "layer 'rotate-to-path'")
    return RotateToPath(context.robot, config)
