"""Top-down pictures for the environments' ``render``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.world import World
from hpp_framework.utils.errors import ConfigError
from hpp_framework.viz.topdown import TopDown

SIZE = (480, 480)
MODES = (None, "rgb_array")


class Picture:
    """Keeps the drawing of a world for as long as the world stays the same.

    Args:
        robots: the team.
    """

    def __init__(self, robots: Sequence[RobotSpec]) -> None:
        self._robots = tuple(robots)
        self._view: tuple[World, TopDown] | None = None

    def draw(
        self,
        world: World,
        poses: npt.NDArray[np.floating],
        goals: npt.NDArray[np.floating],
        *,
        scans: Sequence[npt.NDArray[np.floating]] | None = None,
        people: npt.NDArray[np.floating] | None = None,
        clock: float | None = None,
    ) -> npt.NDArray[np.uint8]:
        """Return red, green, blue (480, 480, 3).

        Args:
            world: what stands around.
            poses: (n, 3) of the team.
            goals: (n, 2), NaN for none.
            scans: own ranges of each robot, metres.
            people: (p, 3) poses of the world's people; they and moving obstacles are drawn if it is given.
            clock: simulated time in seconds.
        """
        if self._view is None or self._view[0] is not world:
            self._view = (world, TopDown(world, self._robots, size=SIZE))
        moving: dict[str, Any] = {}
        if people is not None and world.people:
            radii = np.array([[person.radius] for person in world.people])
            moving["people"] = np.hstack([people[: len(radii)], radii])
        if people is not None and world.moving:
            moving["moving"] = np.stack([each.outline(clock or 0.0) for each in world.moving])
        return self._view[1].frame(poses, goals=goals, scans=scans, clock=clock, **moving)


def check_mode(render_mode: str | None, accepted: Sequence[str | None] = MODES) -> str | None:
    """Return the render mode, or raise :class:`ConfigError` if it is not offered."""
    if render_mode not in accepted:
        raise ConfigError(f"render_mode must be 'rgb_array' or None, got '{render_mode}'.")
    return render_mode
