"""Watchdog: a robot whose lidar cannot be believed stops."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor

from hpp_framework.config.settings import altered
from hpp_framework.core.control import ControlContext, ControlLayer
from hpp_framework.core.types import Observation
from hpp_framework.utils.validation import NonNegative, validated


@validated
class WatchdogConfig:
    """How long a robot goes on.

    Attributes:
        patience: seconds without a scan that can be believed, after which it stops.
    """

    patience: NonNegative = 0.0


class Watchdog(ControlLayer):
    """Stops a robot whose estimator does not believe its lidar: it is frozen, blind, or sends no ranges.

    Args:
        config: how long it goes on.
    """

    def __init__(self, config: WatchdogConfig | None = None) -> None:
        self.config = config or WatchdogConfig()

    def filter(
        self, observation: Observation, waypoint: Float[Tensor, "b 2"], command: Float[Tensor, "b 2"]
    ) -> Float[Tensor, "b 2"]:
        """Return the command, or a full stop."""
        del waypoint
        if observation.scan_age is None:
            return command
        return command.masked_fill((observation.scan_age > self.config.patience)[:, None], 0.0)


def watchdog(context: ControlContext) -> Watchdog:
    """Build the layer."""
    return Watchdog(altered(WatchdogConfig(), context.settings, "layer 'watchdog'"))
