"""Pictures of worlds: from above with a team at its start, and rooms in 3-D.

The pictures of the documentation are drawn by::

    python -m hpp_framework.viz.world_pictures docs/images
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from hpp_framework.core.world import World
from hpp_framework.plugins.builtin import DEFAULT_TEAM
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import HppError
from hpp_framework.utils.run_folder import ROOM, write_bytes
from hpp_framework.utils.seeding import numpy_rng
from hpp_framework.viz.topdown import TopDown
from hpp_framework.worlds.loader import resolve_world
from hpp_framework.worlds.spawn import spawn_poses

Image = npt.NDArray[np.uint8]

CATALOGUE = ("training", "simple", "wall", "navigation")
SCANS = ("real-simple", "real-wall", "real-forest", "real-roundabout")
HELD_OUT = ("u-trap", "two-doors", "l-room", "maze")
TUNING = "walls"
TEAM = tuple(DEFAULT_TEAM.split(","))
SIDE = 420
COLUMNS = 4
ROOM_SIZE = (840, 560)
"""Width and height in pixels of a room in 3-D."""

SEED = 6001
"""Of the worlds shown; those of reports are drawn from other seeds."""


def draw_worlds(
    out: Path, names: Sequence[str] = CATALOGUE, *, seeds: Sequence[int] = (SEED,), side: int = SIDE
) -> Path:
    """Draw worlds from above, each with a team at its start, into one PNG, four in a row.

    Args:
        out: the picture; its folder is made if need be.
        names: registered worlds or world files.
        seeds: each world is drawn from each of these.
        side: pixels of each world.

    Raises:
        HppError: if the file cannot be written.
    """
    robots = [hub().robots.create(name) for name in TEAM]
    tiles: list[Image] = []
    for name in names:
        for seed in seeds:
            world, poses = _start(name, seed)
            tiles.append(TopDown(world, robots, size=(side, side)).frame(poses, title=name))
    return save_picture(out, tiled(tiles, COLUMNS))


def draw_rooms(out: Path, names: Sequence[str] = SCANS, *, size: tuple[int, int] = ROOM_SIZE) -> Path:
    """Draw worlds in 3-D, each with a team at its start, into one PNG, two in a row.

    Args:
        out: the picture; its folder is made if need be.
        names: registered worlds or world files.
        size: width and height in pixels of each.

    Raises:
        SimulatorError: if SAPIEN cannot draw on this machine.
        HppError: if the file cannot be written.
    """
    # SAPIEN is slow to load, and not every picture needs it
    from hpp_framework.sim.sapien.camera import SceneCamera, View

    robots = [hub().robots.create(name) for name in TEAM]
    tiles: list[Image] = []
    for name in names:
        world, poses = _start(name, SEED)
        x_min, y_min, x_max, y_max = world.bounds
        middle, reach = ((x_min + x_max) / 2, (y_min + y_max) / 2), math.hypot(x_max - x_min, y_max - y_min)
        view = View(
            eye=(middle[0] + 0.1 * reach, middle[1] - 0.8 * reach, 0.76 * reach),
            target=(middle[0] + 0.01 * reach, middle[1] - 0.05 * reach, 0.0),
        )
        tiles.append(SceneCamera(world, robots, view, size=size).picture(poses))
    return save_picture(out, tiled(tiles, 2))


def _start(name: str, seed: int) -> tuple[World, npt.NDArray[np.float64]]:
    world = resolve_world(name)(numpy_rng(seed, "world", name))
    return world, spawn_poses(world, [hub().robots.create(robot) for robot in TEAM], numpy_rng(seed, "start"))


def tiled(tiles: Sequence[Image], columns: int) -> Image:
    """Join pictures of one size row by row; places that are left over are white."""
    columns = min(columns, len(tiles))
    blank = np.full_like(tiles[0], 255)
    padded = [*tiles, *[blank] * (-len(tiles) % columns)]
    return np.vstack([np.hstack(padded[i : i + columns]) for i in range(0, len(padded), columns)])


def save_picture(out: Path, picture: Image) -> Path:
    """Write a picture as a PNG; its folder is made if need be.

    Raises:
        HppError: if it cannot be written.
    """
    encoded = cv2.imencode(".png", picture[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])[1]
    failed = f"picture '{out}' could not be written"
    return write_bytes(out, encoded.tobytes(), failed=failed, remedy=ROOM, error=HppError)


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    draw_worlds(folder / "worlds.png", (*CATALOGUE, *SCANS))
    draw_worlds(folder / "held-out-worlds.png", HELD_OUT, seeds=(SEED, SEED + 1))
    draw_worlds(folder / "tuning-worlds.png", (TUNING,), seeds=range(SEED, SEED + 4))
    draw_rooms(folder / "scans.png")
