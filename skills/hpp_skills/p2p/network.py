"""The policy network of the learned point-to-point skill."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

from hpp_framework.robot import DriveLimits, RobotSpec

FEATURES = 160
HIDDEN = 128
_CHANNELS = 16
_FAR = 10.0


class Encoder(nn.Module):
    """Scan, goal and velocity to features.

    Ranges enter as 1 / (1 + range), so that near obstacles are seen sharply and misses vanish.

    Args:
        beams: of the lidar.
        drive: limits that scale the velocity.
    """

    def __init__(self, beams: int, drive: DriveLimits) -> None:
        super().__init__()
        self.scan = nn.Sequential(
            nn.Conv1d(1, _CHANNELS, 7, stride=3), nn.ReLU(),
            nn.Conv1d(_CHANNELS, _CHANNELS, 5, stride=3), nn.ReLU(),
            nn.Flatten(),
        )  # fmt: skip
        with torch.no_grad():
            width = self.scan(torch.zeros(1, 1, beams)).shape[1]
        self.join = nn.Sequential(nn.Linear(width + 6, FEATURES), nn.ReLU())
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


class PolicyNetwork(nn.Module):
    """Encoder, one hidden layer, and the mean of the action in [-1, 1]^2.

    Args:
        robot: whose lidar and drive limits shape the network.
    """

    def __init__(self, robot: RobotSpec) -> None:
        super().__init__()
        self.encoder = Encoder(robot.lidar.beams, robot.drive)
        self.hidden = nn.Linear(FEATURES, HIDDEN)
        self.action = nn.Linear(HIDDEN, 2)
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
