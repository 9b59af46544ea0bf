"""The paper's real room in its four layouts, made up and scanned by us: it shows pictures only.

Run it after a change, and commit what it writes::

    python -m hpp_framework.worlds.scans.real_room
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from hpp_framework.utils.seeding import numpy_rng
from hpp_framework.worlds.scans.shapes import LEG, box, leg_centers, panel, prism, table
from hpp_framework.worlds.scans.wear import wear

FOLDER = Path(__file__).parents[1] / "catalogue"
SEED = 2020
SIZE = (12.0, 10.0)
WALL_HEIGHT = 1.4
"""What the scan has of the room's walls, in metres: more than Fetch is high."""

CLUTTER = (
    # x, y, length, width, height in metres, yaw in degrees
    (-3.5, 4.7, 1.8, 0.5, 1.3, 0.0),
    (2.6, 4.72, 1.4, 0.45, 0.8, 0.0),
    (5.45, -1.0, 1.9, 0.85, 0.75, 90.0),
    (-5.5, -4.4, 0.7, 0.8, 0.9, 10.0),
    (-4.6, -4.55, 0.5, 0.45, 0.5, 25.0),
    (5.72, 4.72, 0.5, 0.5, 1.4, 0.0),
    (-5.55, 1.2, 1.5, 0.75, 0.74, 90.0),
    (4.2, -4.6, 0.6, 0.5, 0.6, 15.0),
    (5.65, 2.4, 0.35, 0.35, 0.6, 40.0),
    (-5.6, 4.5, 0.45, 0.45, 0.5, 20.0),
)
"""What stands along the walls of the room in all layouts."""

TABLE = (1.6, 0.96)
TABLE_PITCH = (2.5, 1.85)
TABLES = (4, 4)
NARROWEST = 0.78
"""Least distance between two legs in metres, surface to surface: robots are 0.575 m wide."""

ISLAND, RING, EXIT = 1.45, 3.5, 1.3
"""Of the roundabout: from its middle to the island's and the barriers' sides; width of the four exits."""

LAYOUTS = ("real-simple", "real-wall", "real-forest", "real-roundabout")


def scan(name: str) -> Any:
    """Return the scan of a layout as a ``trimesh.Trimesh``; the same each time.

    Args:
        name: one of ``LAYOUTS``.
    """
    rng = numpy_rng(SEED, "scan", name)
    parts = {"real-simple": _nothing, "real-wall": _wall, "real-forest": _forest, "real-roundabout": _ring}
    return wear(trimesh.util.concatenate([*_room(), *parts[name](rng)]), rng)


def _room() -> list[Any]:
    length, width = SIZE
    low, high = np.array([-length / 2, -width / 2, 0.0]), np.array([length / 2, width / 2, 0.0])
    up = (0.0, 0.0, WALL_HEIGHT)
    walls = [
        panel(low, (length, 0, 0), up),
        panel(low, (0, width, 0), up),
        panel(high, (-length, 0, 0), up),
        panel(high, (0, -width, 0), up),
    ]
    floor = panel(low, (length, 0, 0), (0, width, 0))
    clutter = [
        box((x, y), (length, width), height, yaw=math.radians(yaw))
        for x, y, length, width, height, yaw in CLUTTER
    ]
    return [floor, *walls, *clutter]


def _nothing(rng: np.random.Generator) -> list[Any]:
    del rng
    return []


def _wall(rng: np.random.Generator) -> list[Any]:
    """Return four cupboards in a row, 6 m long and 0.6 m thick, not quite in line."""
    offsets = rng.uniform(-0.03, 0.03, 4).tolist()
    return [box((x, 1.5 * i - 2.25), (0.6, 1.5), 1.2) for i, x in enumerate(offsets)]


def _forest(rng: np.random.Generator) -> list[Any]:
    """Return rows of raised desks, not quite in line; a robot passes between any two of their legs."""
    placed: list[tuple[tuple[float, float], float]] = []
    legs = np.zeros((0, 2))
    for row in range(TABLES[1]):
        for column in range(TABLES[0]):
            place = np.array([column - (TABLES[0] - 1) / 2, row - (TABLES[1] - 1) / 2]) * TABLE_PITCH
            while True:
                x, y = (place + rng.uniform(-0.12, 0.12, 2)).tolist()
                yaw = float(rng.uniform(-0.12, 0.12))
                own = leg_centers((x, y), TABLE, yaw)
                gaps = np.linalg.norm(own[:, None] - legs, axis=-1) - 2 * LEG
                if gaps.min(initial=math.inf) >= NARROWEST:
                    break
            placed.append(((x, y), yaw))
            legs = np.concatenate([legs, own])
    return [table(center, TABLE, yaw) for center, yaw in placed]


def _ring(rng: np.random.Generator) -> list[Any]:
    """Return an eight-sided island, and barriers around the path around it with four exits."""
    del rng
    angles = (np.arange(8) + 0.5) * math.pi / 4
    outline = np.stack([np.cos(angles), np.sin(angles)], -1) / math.cos(math.pi / 8)
    parts = [prism(outline * ISLAND, 1.0)]
    side = 2 * RING * math.tan(math.pi / 8)
    for index in range(8):
        yaw = index * math.pi / 4
        # every other side has an exit in its middle
        exit_ = EXIT * (1 - index % 2)
        for sign in (-1, 1):
            middle, length = sign * (side + exit_) / 4, (side - exit_) / 2
            x, y = (
                RING * math.cos(yaw) - middle * math.sin(yaw),
                RING * math.sin(yaw) + middle * math.cos(yaw),
            )
            parts.append(box((x, y), (0.12, length), 0.9, yaw=yaw))
    return parts


def write(folder: Path) -> list[Path]:
    """Write the scans of all layouts into a folder.

    Args:
        folder: where to.

    Returns:
        The files, one per layout.
    """
    files = [folder / f"{name}.ply" for name in LAYOUTS]
    for file in files:
        scan(file.stem).export(file)
    return files


if __name__ == "__main__":
    for written in write(FOLDER):
        print(f"wrote {written}: {written.stat().st_size / 1e3:.0f} kB")
