"""A plain top-down picture of an episode."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from hpp_framework.robot import RobotSpec
from hpp_framework.worlds.slicing import planar_map
from hpp_framework.worlds.world import World

Image = npt.NDArray[np.uint8]

_PAPER = (250, 250, 250)
_INK = (70, 70, 80)
_COLORS = ((226, 100, 30), (30, 100, 190), (40, 150, 80), (150, 70, 160), (190, 160, 30), (40, 160, 170))
_SHIFT = 4


def draw(
    world: World,
    robots: Sequence[RobotSpec],
    poses: npt.NDArray[np.floating],
    goals: npt.NDArray[np.floating],
    *,
    width: int = 480,
) -> Image:
    """Draw obstacles, robots with their headings, and goals as crosses.

    Args:
        world: what stands around.
        robots: whose footprints to draw.
        poses: (n, 3) of the robots.
        goals: (n, 2) of the robots, world coordinates in metres.
        width: of the picture in pixels; the height follows from the world's bounds.

    Returns:
        Red, green, blue (height, width, 3), y upwards.
    """
    x_min, y_min, x_max, y_max = world.bounds
    scale = width / (x_max - x_min)
    image = np.full((max(round((y_max - y_min) * scale), 2), width, 3), _PAPER, np.uint8)

    def pixels(points: npt.NDArray[np.floating]) -> npt.NDArray[np.int32]:
        flipped = np.stack([points[..., 0] - x_min, y_max - points[..., 1]], -1) * scale
        return np.round(np.clip(flipped, -1e5, 1e5) * (1 << _SHIFT)).astype(np.int32)

    tallest = max(robot.height for robot in robots)
    segments, discs = planar_map(world, lidar_heights=(), body_height=tallest).touched_below(tallest)
    for segment in segments:
        start, end = pixels(segment.reshape(2, 2)).tolist()
        cv2.line(image, start, end, _INK, 2, cv2.LINE_AA, _SHIFT)
    for x, y, radius in discs:
        size = round(float(radius) * scale * (1 << _SHIFT))
        cv2.circle(image, pixels(np.array([x, y])).tolist(), size, _INK, -1, cv2.LINE_AA, _SHIFT)
    for i, (robot, pose, goal) in enumerate(zip(robots, poses, goals, strict=True)):
        color = _COLORS[i % len(_COLORS)]
        radius = round(robot.footprint_radius * scale * (1 << _SHIFT))
        tip = pose[:2] + 1.6 * robot.footprint_radius * np.array([np.cos(pose[2]), np.sin(pose[2])])
        center = pixels(pose[:2])
        cv2.circle(image, center.tolist(), radius, color, -1, cv2.LINE_AA, _SHIFT)
        cv2.line(image, center.tolist(), pixels(tip).tolist(), _INK, 2, cv2.LINE_AA, _SHIFT)
        if np.isfinite(goal).all():
            at = (pixels(goal) >> _SHIFT).tolist()
            cv2.drawMarker(image, at, color, cv2.MARKER_TILTED_CROSS, 12, 2, cv2.LINE_AA)
    return image
