"""Top-down pictures of a world and a team, fast enough to film every control step.

One call draws one frame::

    view = TopDown(world, robots)
    frames = [view.frame(poses, clock=time) for time, poses in episode]
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.world import World
from hpp_framework.utils.errors import ConfigError
from hpp_framework.viz import marks
from hpp_framework.viz.backdrop import INK, Canvas, Image, paint_plan
from hpp_framework.viz.floor_plan import FloorPlan, floor_plan
from hpp_framework.viz.marks import robot_colors

Array = npt.NDArray[np.floating]

MARGIN = 1.0
AROUND = 4.0
"""Ground shown around the robots by :func:`close_view`, in metres."""

AROUND_GOALS = 0.6
"""Ground shown around goals, in metres."""


class TopDown:
    """Draws one team in one world.

    Args:
        world: the world, or what is drawn of it; drawn once.
        robots: the team.
        size: width and height of the frames in pixels.
        view: (x_min, y_min, x_max, y_max) to show in metres, or None for the whole world with a margin.
        faint: draw obstacles as a hint only.

    Raises:
        ConfigError: if the size is too small or the view is empty.
    """

    def __init__(
        self,
        world: World | FloorPlan,
        robots: Sequence[RobotSpec],
        *,
        size: tuple[int, int] = (720, 720),
        view: tuple[float, float, float, float] | None = None,
        faint: bool = False,
    ) -> None:
        if min(size) < 64:
            raise ConfigError(f"a top-down picture needs at least 64 x 64 pixels, got {size[0]} x {size[1]}.")
        x_min, y_min, x_max, y_max = world.bounds
        margin = min(MARGIN, 0.05 * max(x_max - x_min, y_max - y_min))
        view = view or (x_min - margin, y_min - margin, x_max + margin, y_max + margin)
        if not (view[0] < view[2] and view[1] < view[3]):
            raise ConfigError(f"view must be (x_min, y_min, x_max, y_max) in metres, got {view}.")
        self.robots = tuple(robots)
        self.colors = robot_colors(robots)
        self.canvas = Canvas(size, view)
        if isinstance(world, World):
            world = floor_plan(world, body_height=max(robot.height for robot in robots))
        self._background = paint_plan(self.canvas, world, faint=faint)

    def empty(self) -> Image:
        """Return the empty world, to draw on: (height, width, 3) RGB."""
        return self._background.copy()

    def frame(
        self,
        poses: Array,
        *,
        scans: Sequence[Array] | None = None,
        goals: Array | None = None,
        trails: Array | None = None,
        people: Array | None = None,
        moving: Array | None = None,
        clock: float | None = None,
        title: str | None = None,
    ) -> Image:
        """Draw one moment.

        Args:
            poses: (n, 3) of the team, world frame.
            scans: own ranges (k,) of each robot, metres.
            goals: (n, 2) each agent's goal, world frame; NaN for none.
            trails: (t, n, 2 or 3) where all robots have been, oldest first.
            people: (p, 4) x, y, heading and radius of people, NaN for none.
            moving: (m, k, 2) outlines of moving obstacles.
            clock: simulated time in seconds.
            title: a line of text at the top.

        Returns:
            (height, width, 3) RGB.
        """
        image = self.empty()
        poses = np.asarray(poses, np.float64)
        if moving is not None:
            marks.draw_moving(image, self.canvas, moving)
        if scans is not None:
            marks.draw_scans(image, self.canvas, poses, scans, self.robots, self.colors)
        if trails is not None:
            for path, color in zip(np.swapaxes(trails, 0, 1), self.colors, strict=True):
                pale = marks.mix(color, 0.35)
                marks.draw_path(image, self.canvas, path[:, :2], pale, self.canvas.stroke(0.07))
        if people is not None:
            marks.draw_people(image, self.canvas, people)
        for robot, pose, color in zip(self.robots, poses, self.colors, strict=True):
            marks.draw_robot(image, self.canvas, robot, pose, color)
        if goals is not None:
            for goal, color in zip(np.asarray(goals, np.float64), self.colors, strict=True):
                marks.draw_goal(image, self.canvas, goal, color)
        self._draw_caption(image, clock, title)
        return image

    def _draw_caption(self, image: Image, clock: float | None, title: str | None) -> None:
        if title:
            self.canvas.label(image, title, (12, 12), INK)
        if clock is not None:
            text = f"{clock:.1f} s"
            self.canvas.label(image, text, (image.shape[1] - 12 - self.canvas.text_size(text)[0], 12), INK)


def close_view(
    world: World | FloorPlan, poses: Array, around: float = AROUND, goals: Array | None = None
) -> tuple[float, float, float, float]:
    """Return a square view (x_min, y_min, x_max, y_max) of the robots with some ground around them, metres.

    Args:
        world: the world; the view does not reach far beyond its bounds.
        poses: (..., 3) or (..., 2) places that must be seen, world frame.
        around: ground shown beyond the outermost, metres.
        goals: (..., 2) places that should be seen as far as they lie within the bounds, NaN for none.
    """
    points = np.asarray(poses, np.float64)[..., :2].reshape(-1, 2)
    low, high = points.min(0) - around, points.max(0) + around
    x_min, y_min, x_max, y_max = world.bounds
    if goals is not None:
        found = np.asarray(goals, np.float64).reshape(-1, 2)
        inside = np.clip(found[np.isfinite(found).all(-1)], (x_min, y_min), (x_max, y_max))
        low = np.minimum(low, inside.min(0, initial=np.inf) - AROUND_GOALS)
        high = np.maximum(high, inside.max(0, initial=-np.inf) + AROUND_GOALS)
    side = min(float((high - low).max()), max(x_max - x_min, y_max - y_min) + 2 * MARGIN)
    center = (low + high) / 2
    return center[0] - side / 2, center[1] - side / 2, center[0] + side / 2, center[1] + side / 2
