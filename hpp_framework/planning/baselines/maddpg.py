"""MADDPG (Lowe et al. 2017), the paper's learned baseline: the trained actors as planners that drive.

Every robot has an actor of its own, from its observation to its command (the paper's Dec-POMDP, section 3);
``hpp train maddpg`` makes them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor, nn

from hpp_framework.core.geometry import between
from hpp_framework.core.planner import PlannerContext
from hpp_framework.core.policy import Policy
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.task import Task
from hpp_framework.core.types import Observation
from hpp_framework.plugins.weights import find_weights, load_checkpoint, load_into, weight_folders
from hpp_framework.utils.blocks import in_blocks
from hpp_framework.utils.errors import ConfigError

KIND = "maddpg"
"""Name of the planner, and of the folder its weights lie in."""
HIDDEN = 64
"""Units of the two hidden layers of actors and critics (appendix C.2)."""
BLOCK = 32
"""Episodes that an actor drives at a time, so that none depends on how many there are."""
REACH = 10.0
"""Metres that distances are divided by, and that ranges are capped at."""


class Layers(nn.Module):
    """Several networks of the same shape side by side: two hidden layers of rectified units, a linear output.

    Args:
        networks: how many.
        inputs: of each.
        outputs: of each.
        rng: source of the first weights.
    """

    def __init__(self, networks: int, inputs: int, outputs: int, rng: torch.Generator) -> None:
        super().__init__()
        sizes = (inputs, HIDDEN, HIDDEN, outputs)
        self.weights = nn.ParameterList()
        self.biases = nn.ParameterList()
        for entering, leaving in pairwise(sizes):
            # as torch's own linear layers begin
            bound = 1 / math.sqrt(entering)
            for parameters, shape in (
                (self.weights, (networks, entering, leaving)), (self.biases, (networks, 1, leaving))
            ):  # fmt: skip
                parameters.append(nn.Parameter(torch.empty(shape).uniform_(-bound, bound, generator=rng)))

    def forward(self, *parts: Tensor) -> Float[Tensor, "n b o"]:
        """Return what each network makes of its inputs.

        Args:
            parts: of the inputs, in their order: (n, b, i) each network's own, or (b, i) the same for all.
        """
        first, at = self.biases[0], 0
        for part in parts:
            weight = self.weights[0][:, at : at + part.shape[-1]]
            first = torch.baddbmm(first, part.expand(len(weight), -1, -1), weight)
            at += part.shape[-1]
        second = torch.baddbmm(self.biases[1], first.relu(), self.weights[1])
        return torch.baddbmm(self.biases[2], second.relu(), self.weights[2])


def features(observation: Observation, robot: RobotSpec, others: Sequence[int]) -> Float[Tensor, "b f"]:
    """Return what an actor sees: own motion, the others' poses in the robot's own frame, its lidar.

    Args:
        observation: of the robot.
        robot: that observes.
        others: indices of the others in the team, in the order that the actor knows them by.
    """
    limits = observation.velocity.new_tensor([robot.drive.speed[1], robot.drive.turn_rate])
    poses = observation.team_poses
    seen = between(observation.pose[:, None].expand(-1, len(others), -1), poses[:, list(others)])
    heading = seen[..., 2]
    relative = torch.cat([seen[..., :2] / REACH, heading.cos()[..., None], heading.sin()[..., None]], -1)
    scan = observation.scan.clamp(max=REACH) / REACH
    return torch.cat([observation.velocity / limits, relative.flatten(1), scan], -1)


def feature_count(robots: Sequence[RobotSpec]) -> int:
    """Return how many features each actor of a team sees.

    Raises:
        ConfigError: if there is only one robot, or they have lidars of different numbers of beams.
    """
    beams = {robot.lidar.beams for robot in robots}
    if len(robots) < 2 or len(beams) > 1:
        raise ConfigError(
            f"planner '{KIND}' is for teams of two and more robots whose lidars have equally many beams, got "
            + ", ".join(f"'{robot.name}' with {robot.lidar.beams}" for robot in robots)
            + "."
        )
    return 2 + 4 * (len(robots) - 1) + beams.pop()


def roles(robots: Sequence[RobotSpec]) -> list[int]:
    """Return the team's indices in the order of the actors: by the robots' names."""
    return sorted(range(len(robots)), key=lambda index: robots[index].name)


def file_name(robots: Sequence[RobotSpec]) -> str:
    """Return the file name of a team's actors."""
    return "-".join(sorted(robot.name for robot in robots))


def expected_metadata(robots: Sequence[RobotSpec], task: Task) -> dict[str, Any]:
    """Return what weights must say of themselves to fit a team and its task."""
    return {
        "policy": KIND,
        "robots": sorted(robot.name for robot in robots),
        "beams": robots[0].lidar.beams,
        "radius": task.radius,
        "hidden": HIDDEN,
    }


def to_command(action: Float[Tensor, "*b 2"], robot: RobotSpec) -> Float[Tensor, "*b 2"]:
    """Return commands [v in m/s, omega in rad/s] for actions in [-1, 1]."""
    low, high = robot.drive.speed
    speed = (low + high) / 2 + (high - low) / 2 * action[..., 0]
    return torch.stack([speed, robot.drive.turn_rate * action[..., 1]], -1)


class MaddpgPolicy(Policy):
    """One robot's actor.

    Args:
        actors: of the whole team, in the order of :func:`roles`.
        robots: the team, in team order.
        agent: index of the robot in the team.
    """

    def __init__(self, actors: Layers, robots: Sequence[RobotSpec], agent: int) -> None:
        order = roles(robots)
        self.actors = actors
        self.role = order.index(agent)
        self.robot = robots[agent]
        self.others = [index for index in order if index != agent]

    @torch.no_grad()
    def act(self, observation: Observation) -> Float[Tensor, "b 2"]:
        """Return the actor's command [v in m/s, omega in rad/s]."""
        seen = features(observation, self.robot, self.others)
        action = in_blocks(lambda rows: self.actors(rows)[self.role], seen, rows=BLOCK)
        return to_command(action.tanh(), self.robot)


def empty_actors(robots: Sequence[RobotSpec], rng: torch.Generator) -> Layers:
    """Return untrained actors for a team."""
    return Layers(len(robots), feature_count(robots), 2, rng)


def maddpg(context: PlannerContext) -> MaddpgPolicy:
    """Build the policy of one agent from trained weights.

    Raises:
        ConfigError: if such a team cannot have any.
        CheckpointError: if there are none for these robots, or they were made for another task or lidar.
    """
    robots = context.team.robots
    actors = empty_actors(robots, torch.Generator())
    names = ",".join(robot.name for robot in robots)
    remedy = f"A policy fits the team it was trained with only: hpp train maddpg --team {names}"
    file = find_weights(weight_folders(context.weights), "planner", KIND, file_name(robots), remedy)
    weights, _ = load_checkpoint(file, expected_metadata(robots, context.task))
    load_into(actors, weights, file)
    return MaddpgPolicy(actors.requires_grad_(requires_grad=False), robots, context.agent)
