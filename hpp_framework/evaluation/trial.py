"""What a skill is put to when it is judged."""

from __future__ import annotations

from typing import Literal

from hpp_framework.envs.problem import PointToPoint
from hpp_framework.plugins.builtin import DEFAULT_WORLD, UNDISTURBED
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.validation import Count, NonNegative, Positive, validated

Draw = Literal["uniform", "even"]

ARRIVAL = PointToPoint()
"""What counts as arriving, the same as in training."""
RESOLUTION = 0.05
"""Metres per cell of the grids that starts, goals, clearances and paths are found on."""


@validated
class Trial:
    """What a skill is put to: worlds, goals and disturbances.

    Attributes:
        world: registered world or world file; every episode has a world of its own.
        episodes: how many.
        goal_distance: nearest and farthest goal, straight line, in metres.
        clearance: gap between a footprint at start or goal and the nearest obstacle, at least; in metres.
        draw: ``"uniform"``: any goal at the distance asked for, in the region that a disc of footprint and
            clearance can reach. ``"even"``: tasks that fill the bins of the competence map evenly, as far
            as the worlds have them; passages may be so narrow that the footprint just fits.
        steps: control steps before an episode counts as failed (200 are 40 s).
        disturbances: of sensing and acting: a profile, with settings or without.
        estimator: registered estimator, with settings or without.
        seed: of worlds, starts, goals and disturbances.
        backend: ``"batch"`` or ``"sapien"``.
    """

    world: str = DEFAULT_WORLD
    episodes: Count = 500
    goal_distance: tuple[Positive, Positive] = (5.0, 10.0)
    clearance: NonNegative = 0.15
    draw: Draw = "uniform"
    steps: Count = 200
    disturbances: str = UNDISTURBED
    estimator: str = "none"
    seed: int = 0
    backend: str = "batch"

    def __post_init__(self) -> None:
        low, high = self.goal_distance
        if not ARRIVAL.goal_radius < low <= high:
            raise ConfigError(
                f"goal distance must be nearest and farthest in metres, the nearest above "
                f"{ARRIVAL.goal_radius}, got {low:g} and {high:g}."
            )
        if not RESOLUTION <= self.clearance < float("inf"):
            raise ConfigError(
                f"clearance must be at least {RESOLUTION} m, the accuracy of the grid that finds starts and "
                f"goals, got {self.clearance:g}."
            )
