"""The learned point-to-point skill."""

from __future__ import annotations

from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core import geometry
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.skill import Skill
from hpp_framework.core.types import Observation
from hpp_framework.plugins.weights import find_weights, load_checkpoint, load_into, weight_folders
from hpp_framework.utils.blocks import in_blocks
from hpp_skills.p2p.network import NetworkShape, PolicyNetwork

BLOCK = 32
"""Episodes that the network drives at a time, so that none depends on how many there are."""
WEIGHTS = Path(__file__).parent / "weights"


class PointToPoint(Skill):
    """Drives to a goal with the trained policy, deterministically.

    Args:
        network: the policy.
    """

    def __init__(self, network: PolicyNetwork) -> None:
        self.network = network.eval()

    @torch.no_grad()
    def act(self, observation: Observation, goal: Float[Tensor, "b 2"]) -> Float[Tensor, "b 2"]:
        """Return commands [v in m/s, omega in rad/s]."""
        seen = (observation.scan, geometry.polar(observation.pose, goal), observation.velocity)
        return in_blocks(self.network, *seen, rows=BLOCK)


def expected_metadata(robot: RobotSpec) -> dict[str, object]:
    """Return what weights for this robot must say of themselves."""
    drive = robot.drive
    return {
        "skill": "p2p",
        "robot": robot.name,
        "beams": robot.lidar.beams,
        "drive": [*drive.speed, drive.turn_rate, drive.acceleration, drive.turn_acceleration],
    }


def predictor_folder() -> Path:
    """Return the folder with the shipped weights of this skill's motion models."""
    return Path(__file__).parent / "predictors"


def find(robot: RobotSpec) -> Path:
    """Return the weights for a robot: shipped ones, or ``p2p/ROBOT.safetensors`` in a folder of weights.

    Raises:
        CheckpointError: if there are none, or they were made for another robot.
    """
    shipped = WEIGHTS / f"{robot.name}.safetensors"
    if shipped.is_file():
        return shipped
    remedy = (
        f"Train them, with all that teams must learn of this robot: hpp onboard {robot.name}; or them alone: "
        f"hpp train skill p2p --robot {robot.name}"
    )
    folders, expected = weight_folders(()), expected_metadata(robot)
    return find_weights(folders, "skill", "p2p", robot.name, remedy, expected=expected)


def load(robot: RobotSpec, file: Path | None = None) -> PointToPoint:
    """Load the skill for a robot.

    Args:
        robot: whose skill.
        file: other weights than the shipped ones.

    Raises:
        CheckpointError: if there are no weights for this robot, or they were made for another.
    """
    file = file or find(robot)
    weights, card = load_checkpoint(file, expected_metadata(robot))
    network = PolicyNetwork(robot, NetworkShape(**card.get("network", {})))
    load_into(network, weights, file)
    return PointToPoint(network)


def load_early(robot: RobotSpec) -> PointToPoint:
    """Load the skill as it was after 1.5 million steps of training; raises as :func:`load` does."""
    return load(robot, WEIGHTS / "early" / f"{robot.name}.safetensors")
