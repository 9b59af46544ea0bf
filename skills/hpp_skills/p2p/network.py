"""The policy network of the learned point-to-point skill."""

from __future__ import annotations

from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn

from hpp_framework.core.robot import DriveLimits, RobotSpec
from hpp_framework.utils.validation import Count, validated

_FAR = 10.0


@validated
class NetworkShape:
    """How large the policy is.

    Attributes:
        scan: ``"conv"``: two convolutions over the scan; ``"dense"``: the scan as it is.
        channels: of the convolutions.
        features: of scan, goal and velocity together.
        hidden: units of the last hidden layer.
    """

    scan: Literal["conv", "dense"] = "conv"
    channels: Count = 16
    features: Count = 160
    hidden: Count = 128


class Encoder(nn.Module):
    """Scan, goal and velocity to features.

    Ranges enter as 1 / (1 + range), so that near obstacles are seen sharply and misses vanish.

    Args:
        shape: how large.
        beams: of the lidar.
        drive: limits that scale the velocity.
    """

    def __init__(self, shape: NetworkShape, beams: int, drive: DriveLimits) -> None:
        super().__init__()
        self.scan = _scan_layers(shape)
        with torch.no_grad():
            width = self.scan(torch.zeros(1, 1, beams)).shape[1]
        self.join = nn.Sequential(nn.Linear(width + 6, shape.features), nn.ReLU())
        self.velocity_scale: Tensor
        scale = torch.tensor([drive.speed[1], drive.turn_rate])
        self.register_buffer("velocity_scale", scale, persistent=False)

    def forward(
        self, scan: Float[Tensor, "b k"], goal: Float[Tensor, "b 2"], velocity: Float[Tensor, "b 2"]
    ) -> Float[Tensor, "b f"]:
        """Encode; the goal is (distance in metres, bearing in radians)."""
        distance, bearing = goal[:, :1], goal[:, 1:]
        seen = self.scan((1 / (1 + scan))[:, None])
        where = [distance.clamp(max=_FAR) / _FAR, 1 / (1 + distance), bearing.cos(), bearing.sin()]
        return self.join(torch.cat([seen, *where, velocity / self.velocity_scale], 1))


def _scan_layers(shape: NetworkShape) -> nn.Sequential:
    if shape.scan == "dense":
        return nn.Sequential(nn.Flatten())
    return nn.Sequential(
        nn.Conv1d(1, shape.channels, 7, stride=3), nn.ReLU(),
        nn.Conv1d(shape.channels, shape.channels, 5, stride=3), nn.ReLU(),
        nn.Flatten(),
    )  # fmt: skip


class PolicyNetwork(nn.Module):
    """Encoder, one hidden layer, and the mean of the action in [-1, 1]^2.

    Args:
        robot: whose lidar and drive limits shape the network.
        shape: how large.
    """

    def __init__(self, robot: RobotSpec, shape: NetworkShape) -> None:
        super().__init__()
        self.encoder = Encoder(shape, robot.lidar.beams, robot.drive)
        self.hidden = nn.Linear(shape.features, shape.hidden)
        self.action = nn.Linear(shape.hidden, 2)
        low, high = robot.drive.speed
        turn = robot.drive.turn_rate
        self.register_buffer("middle", torch.tensor([(low + high) / 2, 0.0]), persistent=False)
        self.register_buffer("half_range", torch.tensor([(high - low) / 2, turn]), persistent=False)

    def forward(
        self, scan: Float[Tensor, "b k"], goal: Float[Tensor, "b 2"], velocity: Float[Tensor, "b 2"]
    ) -> Float[Tensor, "b 2"]:
        """Return commands [v in m/s, omega in rad/s]."""
        mean = self.action(self.hidden(self.encoder(scan, goal, velocity)).relu())
        return self.middle + self.half_range * mean.clamp(-1, 1)
