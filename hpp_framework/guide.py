"""The guide: shows a skill the next piece of the way to its goal, through what the robot has seen lately.

A reactive skill decides by what it sees now. Before a long wall it may circle, and around an island it goes
on in the direction in which it drives, even where turning back is shorter, as its agent expects it to.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework import geometry
from hpp_framework.prediction.chart import charted_ways, draw_chart
from hpp_framework.robot import RobotSpec
from hpp_framework.types import Observation

AHEAD = 3.0
"""Metres of the way to look ahead."""
NEAR = 0.75
"""Metres to look ahead where the way begins behind the robot: what is near and behind, skills turn to."""
BEHIND = 2.4
"""Bearing in radians from which the way begins behind."""


class Guide:
    """Turns a goal into a way-point: the shortest way there is followed for a few metres.

    The way is found on the agent's chart (:mod:`hpp_framework.prediction.chart`), as motion models of kind
    ``far-sighted`` find it, so that robots go the way that their models expect.

    Args:
        robot: whose lidar and footprint count.
    """

    def __init__(self, robot: RobotSpec) -> None:
        self.lidar = robot.lidar
        self.radius = torch.tensor([robot.footprint_radius])

    def __call__(self, observation: Observation, goal: Float[Tensor, "b 2"]) -> Float[Tensor, "b 2"]:
        """Return a point on the way to the goal, or the goal if it is nearer.

        Args:
            observation: what the agent knows.
            goal: world coordinates, metres.
        """
        here = observation.pose[:, None, :2]
        chart = draw_chart(
            self.lidar, observation.agent, observation.team_poses, observation.scan, observation.keyframes,
            here, self.radius,
        )  # fmt: skip
        ways = charted_ways(chart, goal[:, None], torch.tensor([NEAR, AHEAD]))
        near, ahead = ways.points[:, 0, 0].unbind(1)
        behind = geometry.polar(observation.pose, near)[..., 1].abs() > BEHIND
        return torch.where(behind[:, None], near, ahead)
