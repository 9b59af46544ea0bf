"""What is drawn on a top-down picture: robots, scans, goals, beliefs, candidates, imagined motion.

Every function draws onto an image in place; colours are red, green, blue, places metres in the world frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import cv2
import numpy as np
import numpy.typing as npt

from hpp_framework.core import geometry
from hpp_framework.core.robot import RobotSpec
from hpp_framework.viz.backdrop import Canvas, Color, Image

Array = npt.NDArray[np.floating]

WHITE: Color = (255, 255, 255)
ROBOT_COLORS: dict[str, Color] = {"fetch": (242, 106, 27), "freight": (24, 104, 196)}
PALETTE: tuple[Color, ...] = (
    (38, 150, 90), (170, 60, 160), (200, 160, 20), (20, 160, 170), (200, 50, 60), (110, 90, 200)
)  # fmt: skip
"""Colours of robots without one of their own, in team order."""

COATS: tuple[Color, ...] = (
    (176, 70, 84), (70, 128, 104), (146, 112, 160), (172, 146, 70), (76, 112, 134), (176, 122, 140)
)  # fmt: skip
"""Colours of people, in turn; duller than those of robots."""
DOOR: Color = (158, 112, 76)

DASH = 9.0
"""Length in pixels of a dash, and of the gap after it."""

LOW_QUANTILE = 0.25
"""Share of the candidates that all get the palest colour: the paths into walls would use up the scale."""


def robot_colors(robots: Sequence[RobotSpec]) -> list[Color]:
    """Return one RGB colour a robot: the model's own where it is still free, else one of the palette."""
    colors: list[Color] = []
    spare = iter(PALETTE * (len(robots) // len(PALETTE) + 1))
    for robot in robots:
        own = ROBOT_COLORS.get(robot.name)
        colors.append(own if own and own not in colors else next(spare))
    return colors


def mix(color: Color, light: float) -> Color:
    """Lighten (towards 1) or darken (towards -1) a colour."""
    target = 255 if light > 0 else 0
    red, green, blue = (round(c + (target - c) * abs(light)) for c in color)
    return red, green, blue


def score_range(scores: Array) -> tuple[float, float]:
    """Return the scores (g,) at the pale and at the dark end of the scale; NaN if none is finite."""
    finite = np.asarray(scores, np.float64)[np.isfinite(scores)]
    if not len(finite):
        return np.nan, np.nan
    return float(np.quantile(finite, LOW_QUANTILE)), float(finite.max())


def score_colors(shares: Array) -> npt.NDArray[np.uint8]:
    """Return colours (g, 3) of shares (g,) of the scale: 0 pale yellow, 1 dark violet (viridis, reversed)."""
    places = np.clip(np.nan_to_num(shares), 0.0, 1.0) * 255
    return _scale()[255 - places.astype(int)]


@cache
def _scale() -> npt.NDArray[np.uint8]:
    ramp = np.arange(256, dtype=np.uint8)[:, None]
    return np.asarray(cv2.applyColorMap(ramp, cv2.COLORMAP_VIRIDIS)[:, 0, ::-1], np.uint8)


def draw_scans(
    image: Image, canvas: Canvas, poses: Array, scans: Sequence[Array], robots: Sequence[RobotSpec],
    colors: Sequence[Color],
) -> None:  # fmt: skip
    """Draw what lidars see: a fan, and a dot where a beam met something.

    Args:
        image: (height, width, 3).
        canvas: the image's.
        poses: (n, 3) of the robots.
        scans: own ranges (k,) of each robot, metres.
        robots: whose lidars they are.
        colors: one per robot.
    """
    fans = image.copy()
    dots: list[tuple[npt.NDArray[np.int32], Color]] = []
    for robot, pose, scan, color in zip(robots, poses, scans, colors, strict=True):
        mount = geometry.compose(np.asarray(pose, np.float64), np.array(robot.lidar.mount))
        ranges = np.asarray(scan, np.float64)[: robot.lidar.beams]
        angles = mount[2] + robot.lidar.angles()
        ends = mount[:2] + ranges[:, None] * np.stack([np.cos(angles), np.sin(angles)], -1)
        outline = canvas.pixels(np.vstack([mount[None, :2], ends]))
        cv2.fillPoly(fans, [outline], color, cv2.LINE_AA, shift=Canvas.SHIFT)
        dots.append((canvas.pixels(ends[ranges < robot.lidar.max_range - 1e-3]), color))
    cv2.addWeighted(fans, 0.13, image, 0.87, 0, image)
    radius = max(1, round(canvas.scale * 0.045)) << Canvas.SHIFT
    for points, color in dots:
        for point in points.tolist():
            cv2.circle(image, point, radius, color, -1, cv2.LINE_AA, shift=Canvas.SHIFT)


def draw_path(
    image: Image, canvas: Canvas, path: Array, color: Color, width: int = 1, *, dashed: bool = False
) -> None:
    """Draw a path (t, 2) through places; places that are not finite are left out.

    Args:
        image: (height, width, 3).
        canvas: the image's.
        path: places in order.
        color: of the line.
        width: in pixels.
        dashed: instead of solid.
    """
    known = np.asarray(path, np.float64)
    points = canvas.pixels(known[np.isfinite(known).all(-1)])
    pieces = _dashes(points) if dashed else [points]
    cv2.polylines(image, pieces, False, color, width, cv2.LINE_AA, Canvas.SHIFT)


def _dashes(points: npt.NDArray[np.int32]) -> list[npt.NDArray[np.int32]]:
    """Cut a line in fixed-point pixels into dashes of equal length."""
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=-1)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    starts = np.arange(0, along[-1], 2 * DASH * (1 << Canvas.SHIFT))
    ends = np.minimum(starts + DASH * (1 << Canvas.SHIFT), along[-1])
    at = np.stack([starts, ends], -1)
    places = np.stack([np.interp(at, along, points[:, axis]) for axis in (0, 1)], -1)
    return list(np.round(places).astype(np.int32))


def draw_candidates(image: Image, canvas: Canvas, goals: Array, scores: Array) -> None:
    """Draw candidate goals (g, 2) as dots, the better the darker and larger, the best on top.

    Args:
        image: (height, width, 3).
        canvas: the image's.
        goals: the candidates.
        scores: (g,) higher is better; candidates without a finite score are left out.
    """
    low, high = score_range(scores)
    shares = np.clip((np.asarray(scores, np.float64) - low) / max(high - low, 1e-9), 0, 1)
    colors, places = score_colors(shares), canvas.pixels(goals)
    for g in np.argsort(shares):
        if not np.isfinite(scores[g]):
            continue
        radius = (canvas.scale * 0.05 + 1.0) * (1 + 0.7 * float(shares[g]))
        center, fixed = places[g].tolist(), round(radius * (1 << Canvas.SHIFT))
        rim = round((radius + 1.0) * (1 << Canvas.SHIFT))
        cv2.circle(image, center, rim, WHITE, -1, cv2.LINE_AA, shift=Canvas.SHIFT)
        cv2.circle(image, center, fixed, colors[g].tolist(), -1, cv2.LINE_AA, shift=Canvas.SHIFT)


def draw_belief(image: Image, canvas: Canvas, mean: Array, std: Array, color: Color) -> None:
    """Draw a belief over goals as the ellipse of two standard deviations; nothing where it is not finite."""
    if not (np.isfinite(mean).all() and np.isfinite(std).all()):
        return
    circle = np.linspace(0, 2 * np.pi, 49)[:-1]
    ring = np.asarray(mean) + 2 * np.asarray(std) * np.stack([np.cos(circle), np.sin(circle)], -1)
    outline, layer = canvas.pixels(ring), image.copy()
    cv2.fillPoly(layer, [outline], color, cv2.LINE_AA, shift=Canvas.SHIFT)
    cv2.addWeighted(layer, 0.13, image, 0.87, 0, image)
    cv2.polylines(image, [outline], True, color, canvas.stroke(0.03), cv2.LINE_AA, Canvas.SHIFT)


def draw_robot(
    image: Image, canvas: Canvas, robot: RobotSpec, pose: Array, color: Color, *, hollow: bool = False
) -> None:
    """Draw a robot as its footprint with an arrow ahead.

    Args:
        image: (height, width, 3).
        canvas: the image's.
        robot: its data.
        pose: (3,).
        color: of the robot.
        hollow: draw the rim only, for robots that are not the one whose view it is.
    """
    place = np.asarray(pose, np.float64)
    center = canvas.pixels(place[None, :2])[0].tolist()
    radius = max(canvas.scale * robot.footprint_radius, 4)
    fixed = round(radius * (1 << Canvas.SHIFT))
    rim, stroke = (color, 0.07) if hollow else (mix(color, -0.35), 0.04)
    fill = mix(color, 0.75) if hollow else color
    cv2.circle(image, center, fixed, fill, -1, cv2.LINE_AA, shift=Canvas.SHIFT)
    cv2.circle(image, center, fixed, rim, canvas.stroke(stroke), cv2.LINE_AA, Canvas.SHIFT)
    shown = radius / canvas.scale
    arrow = np.array([[0.78, 0.0], [-0.35, 0.5], [-0.12, 0.0], [-0.35, -0.5]]) * shown
    tip = canvas.pixels(geometry.to_world(np.broadcast_to(place, (4, 3)), arrow))
    cv2.fillPoly(image, [tip], color if hollow else WHITE, cv2.LINE_AA, shift=Canvas.SHIFT)


def draw_people(image: Image, canvas: Canvas, people: Array) -> None:
    """Draw people from above: shoulders, and a head that looks where they walk.

    Args:
        image: (height, width, 3).
        canvas: the image's.
        people: (p, 4) x, y, heading and radius; rows that are not finite are left out.
    """
    around = np.linspace(0, 2 * np.pi, 25)[:-1]
    for number, (x, y, heading, radius) in enumerate(np.asarray(people, np.float64).tolist()):
        if not np.isfinite(x):
            continue
        coat = COATS[number % len(COATS)]
        place = np.broadcast_to(np.array([x, y, heading]), (len(around), 3))
        for ahead, long, wide, ink in (
            (0.0, 1.0, 1.0, mix(coat, 0.75)), (0.0, 0.5, 0.95, coat), (0.12, 0.42, 0.42, mix(coat, -0.5)),
        ):  # fmt: skip
            ring = radius * np.stack([ahead + long * np.cos(around), wide * np.sin(around)], -1)
            outline = canvas.pixels(geometry.to_world(place, ring))
            cv2.fillPoly(image, [outline], ink, cv2.LINE_AA, shift=Canvas.SHIFT)


def draw_moving(image: Image, canvas: Canvas, outlines: Array) -> None:
    """Draw moving obstacles by their outlines (m, k, 2)."""
    for outline in canvas.pixels(outlines):
        cv2.fillPoly(image, [outline], DOOR, cv2.LINE_AA, shift=Canvas.SHIFT)
        cv2.polylines(image, [outline], True, mix(DOOR, -0.35), 1, cv2.LINE_AA, Canvas.SHIFT)


def draw_goal(image: Image, canvas: Canvas, goal: Array, color: Color) -> None:
    """Draw a cross at a goal (2,); nothing where it is not finite."""
    if not np.isfinite(goal).all():
        return
    arm = max(0.2, 6 / canvas.scale)
    for stroke, ink, reach in ((0.15, WHITE, arm * 1.12), (0.08, color, arm)):
        for turn in ((1, 1), (1, -1)):
            reached = np.multiply(turn, reach)
            draw_path(image, canvas, np.stack([goal - reached, goal + reached]), ink, canvas.stroke(stroke))
