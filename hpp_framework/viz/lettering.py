"""Text and legends beside pictures, at sizes that stay readable in a video."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from hpp_framework.viz import marks
from hpp_framework.viz.backdrop import INK, Color, Image

FONT = cv2.FONT_HERSHEY_SIMPLEX
PAPER: Color = (255, 255, 255)
QUIET: Color = (96, 104, 116)
LINE = 24
"""Height of a line in pixels."""

SCALE = 0.58
LEGEND_HEIGHT = 40


def write(
    image: Image, text: str, corner: tuple[int, int], *, room: int, color: Color = INK, scale: float = SCALE
) -> int:
    """Write a line, smaller if it would not fit.

    Args:
        image: (height, width, 3), written on in place.
        text: one line; what the font lacks is left out.
        corner: upper left pixel.
        room: width in pixels that may be used.
        color: of the letters.
        scale: of the letters.

    Returns:
        The width used, in pixels.
    """
    width = cv2.getTextSize(text, FONT, scale, 1)[0][0]
    if width > room:
        scale *= room / width
    place = (corner[0], corner[1] + LINE - 7)
    cv2.putText(image, text, place, FONT, scale, color, 1, cv2.LINE_AA)
    return min(width, room)


def strip_height(lines: int) -> int:
    """Return the height in pixels of a :func:`strip` of so many lines."""
    return lines * LINE + 10


def strip(width: int, lines: Sequence[str], color: Color | None = None) -> Image:
    """Return a strip of lines, the first dark, with a bar in a robot's colour at its left.

    Args:
        width: in pixels.
        lines: of text.
        color: of the bar, None for none.
    """
    image = np.full((strip_height(len(lines)), width, 3), PAPER, np.uint8)
    left = 14
    if color is not None:
        image[5:-5, 6:14] = color
        left = 22
    for row, line in enumerate(lines):
        ink = INK if row == 0 else QUIET
        write(image, line, (left, 4 + row * LINE), room=width - left - 8, color=ink)
    return image


def legend(width: int) -> Image:
    """Return a strip that explains the pictures of :class:`~hpp_framework.viz.ego_view.EgoView`."""
    image = np.full((LEGEND_HEIGHT, width, 3), PAPER, np.uint8)
    middle, x = LEGEND_HEIGHT // 2, 14
    step = width / 5
    bar = marks.score_colors(np.linspace(0, 1, 110))
    image[middle - 6 : middle + 6, x : x + 110] = bar
    x += 118
    entries = ("goal", "belief (2 sd)", "own path, imagined", "others' paths, imagined")
    x += (
        write(
            image,
            "candidate goals: worse to better",
            (x, middle - 12),
            room=int(step),
            color=QUIET,
            scale=0.52,
        )
        + 22
    )
    for number, entry in enumerate(entries):
        _symbol(image, number, x, middle)
        x += 36
        x += write(image, entry, (x, middle - 12), room=int(step), color=QUIET, scale=0.52) + 22
    return image


def _symbol(image: Image, number: int, x: int, y: int) -> None:
    if number == 0:
        for up in (-1, 1):
            cv2.line(image, (x + 8, y - 7 * up), (x + 22, y + 7 * up), QUIET, 3, cv2.LINE_AA)
    elif number == 1:
        cv2.ellipse(image, (x + 15, y), (14, 9), 0, 0, 360, QUIET, 1, cv2.LINE_AA)
    else:
        for start in (0,) if number == 2 else (0, 11, 22):
            end = 28 if number == 2 else start + 6
            cv2.line(image, (x + start, y), (x + end, y), QUIET, 3, cv2.LINE_AA)
