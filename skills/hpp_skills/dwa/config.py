"""What the dynamic window approach can be told."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

from hpp_framework.utils.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class DwaConfig:
    """Sizes and weights of the dynamic window approach.

    The defaults were tuned by random search, 33 trials with ``fetch`` and ``freight-real`` together, in the
    world ``training`` (goals 5 to 10 m away, seeds 5001 and 6001), in ``barn`` (3 to 6 m, seed 6001) and in
    fields of legs 0.75 to 1.3 m apart (5 to 9 m, seeds 5001 and 999), scored by success, success without a
    touch, path length and time. The best few then drove in ``training``, ``legs`` and ``barn`` with seeds 999
    and 6001, where they differed by no more than chance; the one kept is among the two best on average.

    Attributes:
        speeds: forward speeds that are tried, spread over what can be reached in one control period.
        turns: turn rates that are tried with each of them.
        look_ahead: seconds that the robot is imagined to go on with a command.
        margin: gap in metres to obstacles that the robot keeps, beside its footprint.
        blind_turn: angle in radians that the robot may still have to turn while it brakes, unless it turns in
            place: beyond it, it would drive into what its lidar has not seen.
        side_reach: gap in metres beside an arc from which on more makes no difference.
        free_path: metres that a direction must be free for to be headed for instead of the goal, when the way
            to the goal is not; 0 always heads for the goal, as Fox et al. do.
        keep: how much a free direction ahead of the robot is preferred to one nearer to the goal: 0 not at
            all, 1 as much as nearness to the goal.
        goal_radius: distance from the goal in metres within which the robot rests.
        heading: weight of turning towards what it heads for, and not past it.
        progress: weight of coming nearer to it during the look-ahead.
        clearance: weight of the way to the first hit along the arc.
        side: weight of the gap beside the arc.
        speed: weight of driving fast.
    """

    speeds: int = 5
    turns: int = 15
    look_ahead: float = 1.06
    margin: float = 0.043
    blind_turn: float = 0.66
    side_reach: float = 0.175
    free_path: float = 1.44
    keep: float = 0.73
    goal_radius: float = 0.2
    heading: float = 0.91
    progress: float = 0.54
    clearance: float = 0.26
    side: float = 0.034
    speed: float = 0.45

    def __post_init__(self) -> None:
        for name in ("speeds", "turns"):
            if getattr(self, name) < 2:
                raise ConfigError(f"dwa: {name} must be at least 2, got {getattr(self, name)}.")
        for name in ("look_ahead", "side_reach", "goal_radius"):
            if not 0 < getattr(self, name) < math.inf:
                raise ConfigError(f"dwa: {name} must be a positive number, got {getattr(self, name)}.")
        for name, value in asdict(self).items():
            if not 0 <= value < math.inf:
                raise ConfigError(f"dwa: {name} must be 0 or more, got {value}.")
