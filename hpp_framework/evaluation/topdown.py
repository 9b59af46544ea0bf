"""Top-down pictures of a world and a team, fast enough to film every control step.

One call draws one frame::

    view = TopDown(world, robots)
    frames = [view.frame(poses, clock=time) for time, poses in episode]
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from hpp_framework import geometry
from hpp_framework.errors import ConfigError
from hpp_framework.evaluation.backdrop import Canvas, paint_world
from hpp_framework.robot import RobotSpec
from hpp_framework.worlds.world import World

Color = tuple[int, int, int]
Array = npt.NDArray[np.floating]

ROBOT_COLORS: dict[str, Color] = {"fetch": (242, 106, 27), "freight": (24, 104, 196)}
PALETTE: tuple[Color, ...] = (
    (38, 150, 90), (170, 60, 160), (200, 160, 20), (20, 160, 170), (200, 50, 60), (110, 90, 200)
)  # fmt: skip
"""Colours of robots without one of their own, in team order."""

WORST, BEST = np.array((196, 200, 206)), np.array((16, 150, 110))
INK = (38, 42, 50)
MARGIN = 1.0
AROUND = 4.0
"""Ground shown around the robots by :func:`close_view`, in metres."""


@dataclass(frozen=True)
class Rollouts:
    """What one agent imagined.

    Attributes:
        trajectories: (g, t, n, 2) positions of everybody for each goal candidate, metres, world frame.
        scores: (g,) higher is better.
    """

    trajectories: Array
    scores: Array


def robot_colors(robots: Sequence[RobotSpec]) -> list[Color]:
    """Return one RGB colour a robot: the model's own where it is still free, else one of the palette."""
    colors: list[Color] = []
    spare = iter(PALETTE * (len(robots) // len(PALETTE) + 1))
    for robot in robots:
        own = ROBOT_COLORS.get(robot.name)
        colors.append(own if own and own not in colors else next(spare))
    return colors


class TopDown:
    """Draws one team in one world.

    Args:
        world: the world; drawn once.
        robots: the team.
        size: width and height of the frames in pixels.
        view: (x_min, y_min, x_max, y_max) to show in metres, or None for the whole world with a margin.

    Raises:
        ConfigError: if the size is too small or the view is empty.
    """

    def __init__(
        self,
        world: World,
        robots: Sequence[RobotSpec],
        *,
        size: tuple[int, int] = (720, 720),
        view: tuple[float, float, float, float] | None = None,
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
        self._background = paint_world(self.canvas, world, body_height=max(r.height for r in robots))

    def frame(
        self,
        poses: Array,
        *,
        scans: Sequence[Array] | None = None,
        goals: Array | None = None,
        beliefs: tuple[Array, Array] | None = None,
        rollouts: Sequence[Rollouts | tuple[Array, Array] | None] | None = None,
        trails: Array | None = None,
        clock: float | None = None,
        title: str | None = None,
    ) -> npt.NDArray[np.uint8]:
        """Draw one moment.

        Args:
            poses: (n, 3) of the team, world frame.
            scans: own ranges (k,) of each robot, metres.
            goals: (n, 2) each agent's goal, world frame; NaN for none.
            beliefs: mean (n, 2) and standard deviation (n, 2) of each agent's belief over goals, metres.
            rollouts: what each agent imagined, None for an agent that imagines nothing.
            trails: (t, n, 2 or 3) where everybody has been, oldest first.
            clock: simulated time in seconds.
            title: a line of text at the top.

        Returns:
            (height, width, 3) RGB.
        """
        image = self._background.copy()
        poses = np.asarray(poses, np.float64)
        if scans is not None:
            self._draw_scans(image, poses, scans)
        if trails is not None:
            self._draw_trails(image, np.asarray(trails, np.float64))
        for agent, imagined in enumerate(rollouts or ()):
            if imagined is not None:
                pair = (
                    (imagined.trajectories, imagined.scores) if isinstance(imagined, Rollouts) else imagined
                )
                self._draw_rollouts(image, agent, np.asarray(pair[0]), np.asarray(pair[1]))
        if beliefs is not None:
            self._draw_beliefs(image, *beliefs)
        for robot, pose, color in zip(self.robots, poses, self.colors, strict=True):
            self._draw_robot(image, robot, pose, color)
        if goals is not None:
            self._draw_goals(image, np.asarray(goals, np.float64))
        self._draw_caption(image, clock, title)
        return image

    def _draw_scans(self, image: npt.NDArray[np.uint8], poses: Array, scans: Sequence[Array]) -> None:
        fans = image.copy()
        dots: list[tuple[Any, Color]] = []
        for robot, pose, scan, color in zip(self.robots, poses, scans, self.colors, strict=True):
            mount = geometry.compose(pose, np.array(robot.lidar.mount))
            ranges = np.asarray(scan, np.float64)[: robot.lidar.beams]
            angles = mount[2] + robot.lidar.angles()
            ends = mount[:2] + ranges[:, None] * np.stack([np.cos(angles), np.sin(angles)], -1)
            outline = self.canvas.pixels(np.vstack([mount[None, :2], ends]))
            cv2.fillPoly(fans, [outline], color, cv2.LINE_AA, shift=Canvas.SHIFT)
            dots.append((self.canvas.pixels(ends[ranges < robot.lidar.max_range - 1e-3]), color))
        cv2.addWeighted(fans, 0.13, image, 0.87, 0, image)
        radius = max(1, round(self.canvas.scale * 0.045)) << Canvas.SHIFT
        for points, color in dots:
            for point in points.tolist():
                cv2.circle(image, point, radius, color, -1, cv2.LINE_AA, shift=Canvas.SHIFT)

    def _draw_trails(self, image: npt.NDArray[np.uint8], trails: Array) -> None:
        for i, color in enumerate(self.colors):
            path = self.canvas.pixels(trails[:, i, :2])
            cv2.polylines(
                image, [path], False, _mix(color, 0.35), self.canvas.stroke(0.07), cv2.LINE_AA, Canvas.SHIFT
            )

    def _draw_rollouts(self, image: npt.NDArray[np.uint8], agent: int, paths: Array, scores: Array) -> None:
        order = np.argsort(np.where(np.isfinite(scores), scores, -np.inf))
        for rank, g in enumerate(order):
            share = rank / max(len(order) - 1, 1)
            color = tuple(int(c) for c in (1 - share) * WORST + share * BEST)
            stroke = self.canvas.stroke(0.05 if share == 1 else 0.02)
            for i in range(paths.shape[2]):
                line = self.canvas.pixels(paths[g, :, i])
                cv2.polylines(image, [line], False, color, stroke, cv2.LINE_AA, Canvas.SHIFT)
            tip = self.canvas.pixels(paths[g, -1:, agent])[0].tolist()
            radius = max(2, round(self.canvas.scale * 0.06)) << Canvas.SHIFT
            cv2.circle(image, tip, radius, color, -1, cv2.LINE_AA, shift=Canvas.SHIFT)

    def _draw_beliefs(self, image: npt.NDArray[np.uint8], mean: Array, std: Array) -> None:
        layer = image.copy()
        edges: list[tuple[Any, Color]] = []
        circle = np.linspace(0, 2 * np.pi, 49)[:-1]
        for center, spread, color in zip(np.asarray(mean), np.asarray(std), self.colors, strict=True):
            if not (np.isfinite(center).all() and np.isfinite(spread).all()):
                continue
            ring = center + 2 * spread * np.stack([np.cos(circle), np.sin(circle)], -1)
            outline = self.canvas.pixels(ring)
            cv2.fillPoly(layer, [outline], color, cv2.LINE_AA, shift=Canvas.SHIFT)
            edges.append((outline, color))
        cv2.addWeighted(layer, 0.16, image, 0.84, 0, image)
        for outline, color in edges:
            cv2.polylines(image, [outline], True, color, self.canvas.stroke(0.03), cv2.LINE_AA, Canvas.SHIFT)

    def _draw_robot(self, image: npt.NDArray[np.uint8], robot: RobotSpec, pose: Array, color: Color) -> None:
        center = self.canvas.pixels(pose[None, :2])[0].tolist()
        radius = max(self.canvas.scale * robot.footprint_radius, 4)
        shown = radius / self.canvas.scale
        fixed = round(radius * (1 << Canvas.SHIFT))
        cv2.circle(image, center, fixed, color, -1, cv2.LINE_AA, shift=Canvas.SHIFT)
        cv2.circle(
            image, center, fixed, _mix(color, -0.35), self.canvas.stroke(0.04), cv2.LINE_AA, Canvas.SHIFT
        )
        arrow = np.array([[0.78, 0.0], [-0.35, 0.5], [-0.12, 0.0], [-0.35, -0.5]]) * shown
        tip = self.canvas.pixels(geometry.to_world(np.broadcast_to(pose, (4, 3)), arrow))
        cv2.fillPoly(image, [tip], (255, 255, 255), cv2.LINE_AA, shift=Canvas.SHIFT)

    def _draw_goals(self, image: npt.NDArray[np.uint8], goals: Array) -> None:
        arm = max(0.2, 6 / self.canvas.scale)
        for goal, color in zip(goals, self.colors, strict=True):
            if not np.isfinite(goal).all():
                continue
            for stroke, ink, reach in ((0.15, (255, 255, 255), arm * 1.12), (0.08, color, arm)):
                for turn in ((1, 1), (1, -1)):
                    ends = self.canvas.pixels(
                        np.stack([goal - np.multiply(turn, reach), goal + np.multiply(turn, reach)])
                    )
                    cv2.line(
                        image,
                        ends[0].tolist(),
                        ends[1].tolist(),
                        ink,
                        self.canvas.stroke(stroke),
                        cv2.LINE_AA,
                        Canvas.SHIFT,
                    )

    def _draw_caption(self, image: npt.NDArray[np.uint8], clock: float | None, title: str | None) -> None:
        if title:
            self.canvas.label(image, title, (12, 12), INK)
        if clock is not None:
            text = f"{clock:.1f} s"
            self.canvas.label(image, text, (image.shape[1] - 12 - self.canvas.text_size(text)[0], 12), INK)


def close_view(world: World, poses: Array, around: float = AROUND) -> tuple[float, float, float, float]:
    """Return a square view (x_min, y_min, x_max, y_max) of the robots with some ground around them, metres.

    Args:
        world: the world; the view does not reach far beyond its bounds.
        poses: (..., 3) or (..., 2) places that must be seen, world frame.
        around: ground shown beyond the outermost, metres.
    """
    points = np.asarray(poses, np.float64)[..., :2].reshape(-1, 2)
    low, high = points.min(0) - around, points.max(0) + around
    x_min, y_min, x_max, y_max = world.bounds
    side = min(float((high - low).max()), max(x_max - x_min, y_max - y_min) + 2 * MARGIN)
    center = (low + high) / 2
    return center[0] - side / 2, center[1] - side / 2, center[0] + side / 2, center[1] + side / 2


def _mix(color: Color, light: float) -> Color:
    """Lighten (towards 1) or darken (towards -1) a colour."""
    target = 255 if light > 0 else 0
    red, green, blue = (round(c + (target - c) * abs(light)) for c in color)
    return red, green, blue
