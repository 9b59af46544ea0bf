"""What a robot sees to be in the way, and whether the robots of a team see each other.

Robots that see each other know the same of the path between them, and each knows that the other does. So it
is the one place where no guess about the other is needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.core import geometry
from hpp_framework.core.geometry import polar, to_frame
from hpp_framework.core.option import Condition
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.types import Observation
from hpp_framework.perception.sensing import lidar_poses, seen_points

GAP = 0.04
"""Metres that a robot keeps from what it passes."""


def in_the_way(
    pose: Float[Tensor, "b 3"],
    end: Float[Tensor, "b 2"],
    points: Float[Tensor, "b q 2"],
    still: Bool[Tensor, "b q"],
    radius: float,
) -> Bool[Tensor, "b"]:
    """Return whether points that stand still are in the way from a pose straight to a place.

    Args:
        pose: where the path begins, world frame.
        end: where it ends, world frame, metres.
        points: that were seen, world frame, metres.
        still: which of them lie on things that stand still.
        radius: of who drives, metres.
    """
    distance, bearing = polar(pose, end).unbind(-1)
    towards = torch.cat([pose[:, :2], (pose[:, 2] + bearing)[:, None]], -1)
    ahead, aside = to_frame(towards[:, None], points).unbind(-1)
    reach = radius + GAP
    on_way = (ahead > 0) & (ahead < distance[:, None] + reach) & (aside.abs() < reach)
    return (on_way & still).any(-1)


def all_in_view(observation: Observation, robots: Sequence[RobotSpec]) -> Bool[Tensor, "b"]:
    """Return whether a robot and each teammate see each other with nothing between them that either touches.

    Args:
        observation: of the robot.
        robots: the team, in team order.
    """
    poses, agent = observation.team_poses, observation.agent
    own, robot = poses[:, agent], robots[agent]
    seen = torch.ones(len(poses), dtype=torch.bool, device=poses.device)
    mates = [index for index in range(len(robots)) if index != agent]
    for mate in mates:
        distance, bearing = polar(own, poses[:, mate, :2]).unbind(-1)
        back = polar(poses[:, mate], own[:, :2])[..., 1]
        seen &= (bearing.abs() < robot.lidar.field_of_view / 2) & (distance < robot.lidar.max_range)
        lidar = robots[mate].lidar
        seen &= (back.abs() < lidar.field_of_view / 2) & (distance < lidar.max_range)
    # what the present scan shows in the way needs no search of what earlier ones saw
    for known in (replace(observation, keyframes=None), observation):
        rows = seen.nonzero()[:, 0]
        points, still = seen_points(known.episodes(rows), robot.lidar)
        free = torch.ones_like(rows, dtype=torch.bool)
        for mate in mates:
            widest = max(robot.footprint_radius, robots[mate].footprint_radius)
            free &= ~in_the_way(own[rows], poses[rows, mate, :2], points, still, widest)
        seen = seen.index_put((rows,), free)
    return seen


def clear_way(robot: RobotSpec, margin: float = 0.1) -> Condition:
    """Return the condition that the goal lies in view, and nothing that was seen on the straight path to it.

    Other robots do not count: they move on.

    The initiation set of a skill that avoids nothing, and of one whose motion model knows no obstacles.

    Args:
        robot: whose lidar and footprint.
        margin: gap in metres that the footprint keeps on the way.
    """
    half = robot.footprint_radius + margin

    def holds(observation: Observation, goal: Float[Tensor, "b 2"]) -> Bool[Tensor, "b"]:
        distance, bearing = geometry.polar(observation.pose, goal).unbind(-1)
        eye = lidar_poses(robot.lidar, observation.pose)
        in_view = geometry.polar(eye, goal)[:, 1].abs() <= robot.lidar.field_of_view / 2
        ends, real = seen_points(observation, robot.lidar)
        reach, direction = geometry.polar(observation.pose[:, None], ends).unbind(-1)
        turned = direction - bearing[:, None]
        ahead, aside = reach * turned.cos(), reach * turned.sin()
        blocked = real & (ahead > 0) & (ahead < distance[:, None]) & (aside.abs() < half)
        return in_view & ~blocked.any(-1)

    return holds
