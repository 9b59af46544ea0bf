"""Goals that lie right behind what a robot sees: probably inside it, and at best far to drive to.

Nothing that a robot sees tells how thick it is. A model that takes the unseen for free lets the *others*
come into an island from behind while oneself waits before it; as they think likewise, all circle around it.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.core import geometry
from hpp_framework.core.robot import Lidar
from hpp_framework.core.types import Observation
from hpp_framework.perception.sensing import BODY, lidar_poses, viewpoints

SLACK = 0.3
"""Metres before a surface that do not count as seen through."""
OCCUPIED = 0.8
"""Where a robot stands is free, and so is this distance around it, in metres."""


def occluded(
    observation: Observation, lidar: Lidar, goals: Float[Tensor, "b g 2"], depth: float
) -> Bool[Tensor, "b g"]:
    """Return which goals lie behind something seen, by no more than a depth, and were never seen free.

    Args:
        observation: of the agent; its keyframes count too.
        lidar: of the agent.
        goals: world coordinates, metres.
        depth: of the occluded strip, metres.
    """
    seen_from = viewpoints(observation.team_poses, observation.scan, observation.keyframes)
    poses, scans = seen_from.poses, seen_from.scans
    eyes = lidar_poses(lidar, poses[:, :, observation.agent])
    towards = goals[:, None] - eyes[:, :, None, :2]
    distance = towards.norm(dim=-1)
    bearing = geometry.wrap_angle(torch.atan2(towards[..., 1], towards[..., 0]) - eyes[:, :, None, 2])
    angles = lidar.angles()
    beam = ((bearing - angles[0]) / (angles[1] - angles[0])).round().long()
    seen = (beam >= 0) & (beam < lidar.beams)
    reach = scans.gather(2, beam.clamp(0, lidar.beams - 1))
    end = eyes[:, :, None, :2] + towards * (reach / distance.clamp(min=1e-3))[..., None]
    mates = torch.arange(poses.shape[2]) != observation.agent
    on_robot = (end[:, :, :, None] - poses[:, :, None, mates, :2]).norm(dim=-1) < BODY
    seen &= ~on_robot.any(-1)
    beyond = distance - reach
    free = (seen & (beyond < SLACK)).any(1)
    behind = (seen & (beyond >= SLACK) & (beyond < depth)).any(1)
    taken = (goals[:, :, None] - observation.team_poses[:, None, :, :2]).norm(dim=-1) < OCCUPIED
    return behind & ~free & ~taken.any(-1)
