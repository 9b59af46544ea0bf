"""What sensing loses, as data."""

from __future__ import annotations

from dataclasses import dataclass

from hpp_framework.utils.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class NoiseModel:
    """Disturbances of what agents observe; all off by default.

    Attributes:
        position_std: of everybody's observed x and y, in metres.
        heading_std: of everybody's observed heading, in radians.
        scan_std: of every range in metres, or None for the lidar's own ``noise_std``.
        dropout: share of beams that miss and read the maximum range.
        delay: control steps after which a robot hears of the others' poses; it knows its own at once.
        pose_dropout: share of the others' poses that are lost on the way.

    Poses that are late or lost are made up for by dead reckoning: the last one that came, moved on as that
    robot moved before (:class:`Sensing`).
    """

    position_std: float = 0.0
    heading_std: float = 0.0
    scan_std: float | None = 0.0
    dropout: float = 0.0
    delay: int = 0
    pose_dropout: float = 0.0

    def __post_init__(self) -> None:
        for name in ("position_std", "heading_std", "scan_std", "dropout", "delay", "pose_dropout"):
            value = getattr(self, name)
            if value is not None and not 0 <= value < float("inf"):
                raise ConfigError(f"noise: {name} must be 0 or more, got {value}.")
        for name in ("dropout", "pose_dropout"):
            if getattr(self, name) > 1:
                raise ConfigError(f"noise: {name} is a share between 0 and 1, got {getattr(self, name)}.")
