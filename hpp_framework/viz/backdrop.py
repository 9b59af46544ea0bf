"""The canvas of top-down pictures and the part of them that does not move: floor, grid, obstacles, scale."""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

from hpp_framework.viz.floor_plan import FloorPlan
from hpp_framework.worlds.occupancy import fill_outlines

Color = tuple[int, int, int]
Image = npt.NDArray[np.uint8]

OUTSIDE, FLOOR = (214, 218, 224), (248, 249, 250)
GRID = (232, 235, 239)
SOLID, EDGE = (112, 120, 132), (78, 85, 96)
OVERHEAD = (196, 203, 213)
INK = (38, 42, 50)

FAINT = 0.22
"""Share of an obstacle's colour that is left where obstacles are only hinted at."""


class Canvas:
    """Maps metres to pixels and writes text.

    Args:
        size: width and height in pixels.
        view: (x_min, y_min, x_max, y_max) that must be seen, metres; more is shown along the longer side.
    """

    SHIFT = 4
    """Fractional bits of the pixel coordinates given to OpenCV."""

    def __init__(self, size: tuple[int, int], view: tuple[float, float, float, float]) -> None:
        self.width, self.height = size
        x_min, y_min, x_max, y_max = view
        self.scale = min(self.width / (x_max - x_min), self.height / (y_max - y_min))
        self._center = np.array([(x_min + x_max) / 2, (y_min + y_max) / 2])
        self.text_scale = max(0.35, min(size) / 1200)

    def pixels(self, points: npt.NDArray[np.floating] | npt.NDArray[np.integer]) -> npt.NDArray[np.int32]:
        """Return fixed-point pixel coordinates (..., 2) of world points (..., 2), y upwards."""
        offset = (np.nan_to_num(np.asarray(points, np.float64)) - self._center) * self.scale * (1, -1)
        places = offset + np.array([self.width / 2, self.height / 2]) - 0.5
        return np.round(np.clip(places, -2e4, 2e4) * (1 << self.SHIFT)).astype(np.int32)

    def stroke(self, width: float) -> int:
        """Return a line width in pixels for one in metres, at least 1."""
        return max(1, round(min(width * self.scale, width * 60)))

    def visible(self) -> tuple[float, float, float, float]:
        """Return what the whole canvas shows: (x_min, y_min, x_max, y_max) in metres."""
        half = np.array([self.width, self.height]) / 2 / self.scale
        (x_min, y_min), (x_max, y_max) = self._center - half, self._center + half
        return float(x_min), float(y_min), float(x_max), float(y_max)

    def text_size(self, text: str) -> tuple[int, int]:
        """Return width and height in pixels that :meth:`label` takes."""
        (width, height), base = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, self.text_scale, 1)
        return width + 12, height + base + 8

    def label(self, image: Image, text: str, corner: tuple[int, int], color: Color) -> None:
        """Write a line on a light plate, its upper left corner at a pixel."""
        width, height = self.text_size(text)
        x, y = corner
        plate = image[y : y + height, x : x + width]
        plate[:] = (0.2 * plate + 0.8 * 255).astype(np.uint8)
        base = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, self.text_scale, 1)[1]
        place = (x + 6, y + height - base - 4)
        cv2.putText(image, text, place, cv2.FONT_HERSHEY_SIMPLEX, self.text_scale, color, 1, cv2.LINE_AA)


def paint_plan(canvas: Canvas, plan: FloorPlan, *, faint: bool = False) -> Image:
    """Paint floor, grid, obstacles and a scale bar.

    Args:
        canvas: where to.
        plan: the world; what no robot touches (begins above all of them) is drawn pale.
        faint: draw obstacles as a hint only, for pictures of what a robot itself knows.

    Returns:
        (height, width, 3) RGB.
    """
    image = np.full((canvas.height, canvas.width, 3), OUTSIDE, np.uint8)
    x_min, y_min, x_max, y_max = plan.bounds
    floor = canvas.pixels(np.array([[x_min, y_min], [x_max, y_min], [x_max, y_max], [x_min, y_max]]))
    cv2.fillPoly(image, [floor], FLOOR, cv2.LINE_AA, shift=Canvas.SHIFT)
    _paint_grid(canvas, image, plan)
    empty = image.copy()
    _paint_obstacles(canvas, image, plan)
    if faint:
        cv2.addWeighted(image, FAINT, empty, 1 - FAINT, 0, image)
    _paint_scale(canvas, image)
    return image


def _paint_grid(canvas: Canvas, image: Image, plan: FloorPlan) -> None:
    x_min, y_min, x_max, y_max = plan.bounds
    step = _round_length(48 / canvas.scale)
    for x in np.arange(math.ceil(x_min / step) * step, x_max, step):
        _line(canvas, image, (x, y_min), (x, y_max), GRID, 1)
    for y in np.arange(math.ceil(y_min / step) * step, y_max, step):
        _line(canvas, image, (x_min, y), (x_max, y), GRID, 1)


def _paint_obstacles(canvas: Canvas, image: Image, plan: FloorPlan) -> None:
    # pale ones first: a table top must not hide the legs below it
    for index in np.argsort(plan.boxes_touched, kind="stable"):
        fill, edge = (SOLID, EDGE) if plan.boxes_touched[index] else (OVERHEAD, SOLID)
        corners = canvas.pixels(plan.boxes[index])
        cv2.fillPoly(image, [corners], fill, cv2.LINE_AA, shift=Canvas.SHIFT)
        cv2.polylines(image, [corners], True, edge, 1, cv2.LINE_AA, Canvas.SHIFT)
    for index in np.argsort(plan.discs_touched, kind="stable"):
        fill, edge = (SOLID, EDGE) if plan.discs_touched[index] else (OVERHEAD, SOLID)
        center = canvas.pixels(plan.discs[index, :2]).tolist()
        radius = round(float(plan.discs[index, 2]) * canvas.scale * (1 << Canvas.SHIFT))
        cv2.circle(image, center, radius, fill, -1, cv2.LINE_AA, shift=Canvas.SHIFT)
        cv2.circle(image, center, radius, edge, 1, cv2.LINE_AA, Canvas.SHIFT)
    for outline in plan.outlines:
        lines = canvas.pixels(outline) / (1 << Canvas.SHIFT)
        image[fill_outlines(lines, image.shape[:2]) > 0] = SOLID
    stroke = canvas.stroke(0.04)
    for start, end in canvas.pixels(plan.lines).tolist():
        cv2.line(image, start, end, EDGE, stroke, cv2.LINE_AA, Canvas.SHIFT)


def _paint_scale(canvas: Canvas, image: Image) -> None:
    length = _round_length(0.18 * canvas.width / canvas.scale)
    text = f"{length:g} m"
    width, height = round(length * canvas.scale), canvas.text_size(text)[1]
    left, low = 14, canvas.height - 14
    canvas.label(image, text, (left - 6, low - 8 - height), INK)
    cv2.line(image, (left, low), (left + width, low), INK, 2, cv2.LINE_AA)
    for x in (left, left + width):
        cv2.line(image, (x, low - 5), (x, low + 5), INK, 2, cv2.LINE_AA)


def _line(
    canvas: Canvas,
    image: Image,
    start: tuple[float, float],
    end: tuple[float, float],
    color: Color,
    width: int,
) -> None:
    ends = canvas.pixels(np.array([start, end]))
    cv2.line(image, ends[0].tolist(), ends[1].tolist(), color, width, cv2.LINE_AA, Canvas.SHIFT)


def _round_length(length: float) -> float:
    """Return 1, 2 or 5 times a power of ten, the largest that is not longer (at least 0.1)."""
    power = 10.0 ** math.floor(math.log10(max(length, 0.1)))
    return next(power * factor for factor in (5, 2, 1) if power * factor <= max(length, 0.1) * (1 + 1e-9))
