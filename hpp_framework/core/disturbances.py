"""What sensing and acting lose, as data, and named profiles of it.

A robot's localisation errs slowly (drift, a constant error of its map's frame, jumps) and quickly (white
noise); messages of other robots' poses come late or not at all; drivers of lidars send what is no range;
commands act after a while. What is drawn depends on the episode's seed alone, so that all planners meet the
same disturbances.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field

from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.validation import NonNegative, Share, validated

LONGEST = 5.0
"""Seconds by which anything may be late."""

Delay = Annotated[float, Field(strict=True, ge=0, le=LONGEST, description="Seconds; at most 5.")]
Range = Annotated[float, Field(strict=True, ge=0)]
"""Metres; may be infinite."""


@validated
class Disturbances:
    """What one robot's sensing and acting lose; nothing by default. SI units, angles in radians.

    Attributes:
        position_std: white noise of localised x and y.
        heading_std: white noise of the localised heading.
        position_drift: standard deviation of a slowly varying error of x and y (Ornstein-Uhlenbeck).
        heading_drift: the same of the heading.
        drift_time: time constant of the drift, seconds.
        position_bias: standard deviation of an error of x and y that stays for the whole episode.
        heading_bias: the same of the heading.
        jump_rate: jumps of the localised position per second; the drift carries them off.
        jump_size: metres of a jump.
        odometry_scale: standard deviation of a constant error of odometry, as a share of what is driven.
        odometry_slip: standard deviation of a share that varies as the drift does: wheels that slip.
        sensing_delay: age of own scan, pose and odometry when they reach the agent.
        sensing_jitter: half the width of the uniform spread of that age.
        command_delay: time from a decision to the wheels.
        command_jitter: half the width of its uniform spread. Of commands that overtake each other the newest
            counts.
        message_delay: age of other robots' poses when they reach the agent.
        message_jitter: half the width of its uniform spread.
        message_loss: share of the other robots' poses that are lost.
        message_range: metres beyond which no pose is heard.
        message_sight: whether poses are heard only of robots in the lidar's view.
        clock_offset: standard deviation of what other robots' clocks differ by, constant in an episode.
        scan_std: noise of every range in metres, or None for the lidar's own ``noise_std``.
        lost_beams: share of beams that miss and read the maximum range.
        nan_beams: share of beams that read NaN.
        dead_sector: share of the field of view, somewhere in it, that always reads the maximum range.
        glass: share of surfaces that the lidar looks through.
        fault: what a lidar that fails sends: its last scan, no hit, NaN, or half of its beams.
        fault_rate: such failures per second.
        fault_time: seconds that each lasts.
    """

    position_std: NonNegative = 0.0
    heading_std: NonNegative = 0.0
    position_drift: NonNegative = 0.0
    heading_drift: NonNegative = 0.0
    drift_time: Annotated[float, Field(strict=True, gt=0)] = 5.0
    position_bias: NonNegative = 0.0
    heading_bias: NonNegative = 0.0
    jump_rate: NonNegative = 0.0
    jump_size: NonNegative = 0.0
    odometry_scale: NonNegative = 0.0
    odometry_slip: NonNegative = 0.0
    sensing_delay: Delay = 0.0
    sensing_jitter: Delay = 0.0
    command_delay: Delay = 0.0
    command_jitter: Delay = 0.0
    message_delay: Delay = 0.0
    message_jitter: Delay = 0.0
    message_loss: Share = 0.0
    message_range: Range = math.inf
    message_sight: bool = False
    clock_offset: NonNegative = 0.0
    scan_std: NonNegative | None = 0.0
    lost_beams: Share = 0.0
    nan_beams: Share = 0.0
    dead_sector: Share = 0.0
    glass: Share = 0.0
    fault: Literal["frozen", "blind", "nan", "half"] = "frozen"
    fault_rate: NonNegative = 0.0
    fault_time: NonNegative = 2.0

    def __post_init__(self) -> None:
        for name in ("sensing", "command", "message"):
            delay, jitter = getattr(self, f"{name}_delay"), getattr(self, f"{name}_jitter")
            if jitter > delay:
                raise ConfigError(
                    f"disturbances: {name}_jitter of {jitter:g} s is more than {name}_delay of {delay:g} s; "
                    "nothing comes before it was sent."
                )

    @property
    def latency(self) -> float:
        """Mean seconds from what the lidar sees to when the wheels heed it."""
        return self.sensing_delay + self.command_delay


IDEAL = Disturbances()
"""Nothing is lost."""
PAPER = Disturbances(position_std=0.05, heading_std=0.05)
"""Small white noise of all poses, as the paper's "noisy approximations of agent poses" (section 3)."""
FIELD = Disturbances(
    # AMCL on a differential base in a mapped building: 5 to 10 cm and 2 to 3 degrees, correlated over seconds
    position_std=0.02, heading_std=0.005, position_drift=0.05, heading_drift=math.radians(2.0),
    # UMBmark (Borenstein and Feng 1996): differential drives err by about 1 to 2 % of what they drive
    odometry_scale=0.02,
    # a 15 Hz lidar (SICK TIM571: 66 ms a turn) and half a period of the filter behind it
    sensing_delay=0.1,
    # a command over ROS topics to a base controller of 10 to 20 Hz and its motors
    command_delay=0.15, command_jitter=0.05,
    # poses over Wi-Fi, sent 5 to 10 times per second
    message_delay=0.3, message_jitter=0.1, message_loss=0.1,
    # SICK TIM571 data sheet: statistical error 20 mm
    scan_std=0.02, lost_beams=0.02,
)  # fmt: skip
"""A localised differential base with Wi-Fi."""
HARSH = Disturbances(
    position_std=0.06, heading_std=0.015, position_drift=0.15, heading_drift=math.radians(6.0),
    jump_rate=0.05, jump_size=0.3, odometry_scale=0.06, sensing_delay=0.3, command_delay=0.45,
    command_jitter=0.15, message_delay=0.9, message_jitter=0.3, message_loss=0.3, scan_std=0.06,
    lost_beams=0.06,
)  # fmt: skip
"""About three times ``field``, and localisation that jumps by 30 cm every 20 s."""

PROFILES: Mapping[str, Disturbances] = {"ideal": IDEAL, "paper": PAPER, "field": FIELD, "harsh": HARSH}
