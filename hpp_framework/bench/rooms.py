"""The rooms, teams and starts that benchmarks share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import cycle, islice

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.bench.measurement import Settings
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.team import Team
from hpp_framework.core.world import Box, World
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.seeding import numpy_rng
from hpp_framework.worlds.occupancy import free_space

SIDES = (0.2, 0.6)
"""Shortest and longest side of a box, metres."""

WALL_SEGMENTS = 16
"""Segments of the four outer walls."""


def team_of(settings: Settings, count: int) -> Team:
    """Return a team of a size: the robots of the settings' team, over and over."""
    names = [member.robot.name for member in parse_team(settings.team, skill=settings.skill).members]
    return parse_team(",".join(islice(cycle(names), count)), skill=settings.skill)


def robots_of(settings: Settings, count: int, beams: int) -> list[RobotSpec]:
    """Return robots of the settings' team, over and over, with another number of beams."""
    robots = team_of(settings, count).robots
    return [replace(robot, lidar=replace(robot.lidar, beams=beams)) for robot in robots]


def furnished(rng: np.random.Generator, boxes: int) -> World:
    """Return a walled room of 20 x 20 m with boxes at random places."""
    low, high = (-9.5, -9.5, *SIDES[:1] * 2, -np.pi), (9.5, 9.5, *SIDES[1:] * 2, np.pi)
    return World(
        name="bench",
        bounds=(-10.0, -10.0, 10.0, 10.0),
        boxes=tuple(
            Box(center=(x, y), size=(width, depth), yaw=yaw)
            for x, y, width, depth, yaw in rng.uniform(low, high, (boxes, 5)).tolist()
        ),
    )


def starts(
    worlds: Sequence[World], robots: Sequence[RobotSpec], episodes: int, rng: np.random.Generator
) -> Float[Tensor, "b n 3"]:
    """Draw start poses in free space; episode ``e`` is in world ``e`` modulo their number."""
    radius, height = max(r.footprint_radius for r in robots), max(r.height for r in robots)
    poses = np.empty((episodes, len(robots), 3), np.float32)
    for index, world in enumerate(worlds):
        space = free_space(world, body_height=height)
        mine = range(index, episodes, len(worlds))
        points = space.sample(space.largest_region(radius), len(mine) * len(robots), rng)
        poses[mine, :, :2] = points.reshape(len(mine), len(robots), 2)
    poses[..., 2] = rng.uniform(-np.pi, np.pi, poses.shape[:2])
    return torch.from_numpy(poses)


def named_world(name: str, settings: Settings, index: int = 0) -> World:
    """Return a world of the registry, drawn with the settings' seed."""
    return hub().worlds.create(name, numpy_rng(settings.seed, "bench", name, index))
