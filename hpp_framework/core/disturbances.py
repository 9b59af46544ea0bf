"""What sensing loses, as data."""

from __future__ import annotations

from hpp_framework.utils.validation import NonNegative, Share, Whole, validated


@validated
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

    position_std: NonNegative = 0.0
    heading_std: NonNegative = 0.0
    scan_std: NonNegative | None = 0.0
    dropout: Share = 0.0
    delay: Whole = 0
    pose_dropout: Share = 0.0
