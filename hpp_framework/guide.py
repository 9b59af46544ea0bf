"""The guide: turns a robot round where the way to its goal begins behind it.

A reactive skill decides by what it sees now. Beside an island it goes on in the direction in which it drives,
even where turning back is much shorter, and circles; its agent and everybody else expect it to come back.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework import geometry
from hpp_framework.prediction.chart import charted_ways, draw_chart
from hpp_framework.robot import RobotSpec
from hpp_framework.types import Observation

BEHIND = 2.4
"""Bearing in radians from which a way begins behind."""
BEGINNING = 0.75
"""Metres of a way that tell where it begins."""
BACK = 1.5
"""Metres along such a way that the skill is sent first: what is near and behind, skills turn round to."""


class Guide:
    """Hands a skill its goal, or a way-point a little way back if the shortest way to the goal leads back.

    The way is found on the agent's chart (:mod:`hpp_framework.prediction.chart`), as motion models of kind
    ``far-sighted`` find it, so that robots go the way that their models expect.

    Args:
        robot: whose lidar and footprint count.
    """

    def __init__(self, robot: RobotSpec) -> None:
        self.lidar = robot.lidar
        self.radius = torch.tensor([robot.footprint_radius])

    def __call__(self, observation: Observation, goal: Float[Tensor, "b 2"]) -> Float[Tensor, "b 2"]:
        """Return what the skill is to drive to.

        Args:
            observation: what the agent knows.
            goal: world coordinates, metres.
        """
        here = observation.pose[:, None, :2]
        chart = draw_chart(
            self.lidar, observation.agent, observation.team_poses, observation.scan, observation.keyframes,
            here, self.radius,
        )  # fmt: skip
        ways = charted_ways(chart, goal[:, None], torch.tensor([BEGINNING, BACK]))
        first, back = ways.points[:, 0, 0].unbind(1)
        behind = geometry.polar(observation.pose, first)[..., 1].abs() > BEHIND
        return torch.where(behind[:, None], back, goal)
