"""Where checks take place: a small room, a few episodes, and what its robots observe there."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice, permutations
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.team import Member, Team
from hpp_framework.core.types import Observation
from hpp_framework.core.world import Box, Cylinder, World
from hpp_framework.episodes.core import EpisodeBatch
from hpp_framework.plugins.builtin import DEFAULT_SKILL, DEFAULT_TEAM
from hpp_framework.plugins.registry import Entry, Registry, hub
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.seeding import torch_rng

EPISODES = 4
WARM_UP = 6
"""Control steps driven before the checks begin: histories are full then, and robots move."""
ROBOTS, SKILL = tuple(DEFAULT_TEAM.split(",")), DEFAULT_SKILL
"""The team and the skill of commands, taken where a plugin brings none that fit."""


@dataclass(frozen=True)
class Scene:
    """What a team observes in a few episodes.

    Attributes:
        team: all robots.
        world: of every episode.
        starts: of every episode.
        observations: of every robot, a moment later.
    """

    team: Team
    world: World
    starts: Float[Tensor, "b n 3"]
    observations: tuple[Observation, ...]


def room(robots: Sequence[RobotSpec]) -> World:
    """Return a walled room with a box and a pillar near its corners, wide enough for the robots."""
    half = 6.0 + 4 * max(robot.footprint_radius for robot in robots)
    far = half - 2.0
    return World(
        name="check",
        bounds=(-half, -half, half, half),
        boxes=(Box(center=(far, far), size=(1.0, 0.6), yaw=0.4),),
        cylinders=(Cylinder(center=(-far, -far), radius=0.3),),
    )


def make_scene(team: Team, *, episodes: int = EPISODES, seed: int = 0) -> Scene:
    """Let a team drive for a moment, every robot differently, and return what it observes.

    Args:
        team: all robots.
        episodes: how many, each with other starts.
        seed: of starts and commands.
    """
    robots, count = team.robots, len(team)
    rng = torch_rng(seed, "checks")
    wide = max(robot.footprint_radius for robot in robots)
    ring = max(2.0, 2.5 * wide / math.sin(math.pi / max(count, 2)))
    around = 2 * math.pi * (torch.arange(count) / count + torch.rand(episodes, 1, generator=rng))
    headings = 2 * math.pi * torch.rand(episodes, count, generator=rng) - math.pi
    starts = torch.stack([ring * around.cos(), ring * around.sin(), headings], -1)
    top = torch.tensor([[robot.drive.speed[1], robot.drive.turn_rate] for robot in robots])
    commands = top * (torch.rand(episodes, count, 2, generator=rng) - torch.tensor([0.0, 0.5]))
    world = room(robots)
    with BatchSimulator(robots, threads=1) as simulator:
        batch = EpisodeBatch(simulator)
        batch.begin([world] * episodes, starts, range(episodes))
        for _ in range(WARM_UP):
            batch.step(commands)
    return Scene(team, world, starts, tuple(batch.observe(index) for index in range(count)))


def find_robots(distribution: str) -> Iterator[RobotSpec]:
    """Yield robots to check other plugins with: a distribution's own first, then those of commands.

    Args:
        distribution: whose robots are preferred; empty for none.
    """
    own, usual = _own(hub().robots, distribution), _usual_robots()
    yield from _built([*own, *(entry for entry in (*usual, *hub().robots) if entry not in own)])


def find_teams(distribution: str) -> Iterator[Team]:
    """Yield teams of two to check other plugins with: a distribution's own first, then those of commands.

    Args:
        distribution: whose robots and skills are preferred; empty for none.
    """
    own, usual = list(_built(_own(hub().robots, distribution))), list(_built(_usual_robots()))
    pairs = [*((robot, robot) for robot in own), *permutations(own, 2)]
    pairs += [*permutations(usual, 2), *((robot, robot) for robot in usual)]
    skills = [entry.name for entry in _own(hub().skills, distribution)]
    skills += [SKILL] if SKILL in hub().skills and SKILL not in skills else []
    for robots in pairs:
        for skill in skills:
            members = [Member(id=f"robot-{i}", robot=robot, skill=skill) for i, robot in enumerate(robots)]
            yield Team(tuple(members))


def first(robots: Iterator[RobotSpec], count: int) -> list[RobotSpec]:
    """Return some robots, the last one repeated if there are too few."""
    found = list(islice(robots, count))
    return found + found[-1:] * (count - len(found))


def _own(registry: Registry[Any], distribution: str) -> list[Entry[Any]]:
    return [entry for entry in registry if distribution and entry.distribution == distribution]


def _usual_robots() -> list[Entry[Any]]:
    return [hub().robots.entry(name) for name in ROBOTS if name in hub().robots]


def _built(entries: Iterable[Entry[Any]]) -> Iterator[RobotSpec]:
    for entry in entries:
        try:
            robot = entry.factory()()
        except Exception:  # its own check says so
            continue
        if isinstance(robot, RobotSpec):
            yield robot
