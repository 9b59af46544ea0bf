"""The guide: turns a robot round where the way to its goal begins behind it, and keeps it from slowing down.

A reactive skill decides by what it sees now. Beside an island it goes on in the direction in which it drives,
even where turning back is much shorter, and circles; its agent and everybody else expect it to come back.

A skill also slows down before its goal. Where the others come the same way, that costs time: agents rest as
soon as braking fulfils the task, wherever the goal is (:class:`~hpp_framework.control.stop_on_success.Rest`).
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.core import geometry
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.types import Observation
from hpp_framework.perception.local_map import charted_ways, draw_chart

BEHIND = 2.4
"""Bearing in radians from which a way begins behind."""
BEGINNING = 0.75
"""Metres of a way that tell where it begins."""
BACK = 1.5
"""Metres along such a way that the skill is sent first: what is near and behind, skills turn round to."""
BEHIND_UNDER_WAY = 1.8
"""The bearing from which a way begins behind one of two robots under way, sent to the beginning of it only.

At speed it would go on as before as soon as it has begun to turn to a point farther off. Who stands turns
anyway, and would lose time, since skills slow down for what is near. Larger teams do not circle."""
UNDER_WAY = 1.0
"""Metres that a robot has come within :data:`SINCE` if it is under way."""
SINCE = 5
"""Keyframes, one a second."""
BEYOND = 1.0
"""Metres beyond a place to meet that the skill is sent: about the distance over which skills slow down."""
ARRIVED = 0.6
"""Metres from a place to meet at which a robot is sent no farther: it waits there."""


class Guide:
    """Hands a skill what to drive to: a little way back along the shortest way if that begins behind.

    Else it is the goal, or a point straight on beyond it where the robot need not halt.

    The way is found on the agent's chart (:mod:`hpp_framework.perception.local_map`), as motion models of
    kind ``far-sighted`` find it, so that robots go the way that their models expect.

    Args:
        robot: whose lidar and footprint count.
        beyond: metres beyond a goal at which the robot need not halt.
    """

    def __init__(self, robot: RobotSpec, beyond: float = BEYOND) -> None:
        self.beyond = beyond
        self.lidar = robot.lidar
        self.radius = torch.tensor([robot.footprint_radius])

    def __call__(
        self, observation: Observation, goal: Float[Tensor, "b 2"], halt: Bool[Tensor, "b"] | None = None
    ) -> Float[Tensor, "b 2"]:
        """Return what the skill is to drive to.

        Args:
            observation: what the agent knows.
            goal: world coordinates, metres.
            halt: where the robot is to halt at the goal; None: everywhere.
        """
        here = observation.pose[:, None, :2]
        chart = draw_chart(
            self.lidar, observation.agent, observation.team_poses, observation.scan, observation.keyframes,
            here, self.radius,
        )  # fmt: skip
        ways = charted_ways(chart, goal[:, None], torch.tensor([BEGINNING, BACK]))
        first, back = ways.points[:, 0, 0].unbind(1)
        under_way = _under_way(observation)
        turned = geometry.polar(observation.pose, first)[..., 1].abs()
        behind = turned > torch.where(under_way, BEHIND_UNDER_WAY, BEHIND)
        back = torch.where(under_way[:, None], first, back)
        ahead = goal if halt is None else torch.where(halt[:, None], goal, self._beyond(observation, goal))
        return torch.where(behind[:, None], back, ahead)

    def _beyond(self, observation: Observation, goal: Float[Tensor, "b 2"]) -> Float[Tensor, "b 2"]:
        towards = goal - observation.pose[:, :2]
        distance = towards.norm(dim=-1, keepdim=True)
        return goal + (self.beyond * towards / distance).where(distance > ARRIVED, 0.0)


def _under_way(observation: Observation) -> Bool[Tensor, "b"]:
    """Return whether the robot is one of two and has come from elsewhere in the last seconds."""
    here = observation.pose[:, :2]
    if observation.keyframes is None or observation.team_poses.shape[1] != 2:
        return torch.zeros_like(here[:, 0], dtype=torch.bool)
    before = observation.keyframes.poses[:, -SINCE:, observation.agent, :2][:, 0]
    return (here - before).norm(dim=-1) > UNDER_WAY
