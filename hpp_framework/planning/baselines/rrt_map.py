"""What a robot that plans paths knows of free space: what its lidar saw in the last seconds, on a grid."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from hpp_framework.core.robot import Lidar
from hpp_framework.core.types import Observation
from hpp_framework.perception.sensing import seen_points
from hpp_framework.worlds.occupancy import FreeSpace

RESOLUTION = 0.1
"""Metres per cell of a map made of lidar."""
REACH = 8.0
"""How far such a map reaches beyond the team, metres."""
STRIDE = 0.05
"""Metres between two points of a straight line that are looked up."""

Points = npt.NDArray[np.floating]
Bounds = tuple[float, float, float, float]


@dataclass(frozen=True)
class Room:
    """Where the middle of a disc can be.

    Attributes:
        slack: (rows, columns) metres that the disc can be moved in any direction; it fits where this is
            positive. Row 0 has the lowest y.
        origin: (x, y) of the corner of cell (0, 0), metres.
        resolution: metres per cell.
    """

    slack: npt.NDArray[np.float32]
    origin: tuple[float, float]
    resolution: float

    def corners(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return the lowest and the highest (x, y) that have a cell."""
        rows, columns = self.slack.shape
        x, y = self.origin
        # a hair inside: what lies on the far edge would be in the next cell
        far = self.resolution * (1 - 1e-6)
        return (x, y), (x + columns * far, y + rows * far)

    def slack_at(self, points: Points) -> npt.NDArray[np.float32]:
        """Return the slack at points (..., 2); -1 outside."""
        cells = np.floor((points - np.array(self.origin)) / self.resolution).astype(np.int64)
        rows, columns = self.slack.shape
        column, row = cells[..., 0], cells[..., 1]
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        found = self.slack[row.clip(0, rows - 1), column.clip(0, columns - 1)]
        return np.where(inside, found, np.float32(-1.0))

    def fits(self, points: Points) -> npt.NDArray[np.bool_]:
        """Return whether the disc fits at points (..., 2); it does not outside."""
        return np.asarray(self.slack_at(points) > 0)

    def passes(self, starts: Points, ends: Points) -> npt.NDArray[np.bool_]:
        """Return whether the disc can go straight from points (..., 2) to others.

        Looks where it has to only: a disc with slack cannot touch anything sooner than that.
        """
        starts, ends = (part.reshape(-1, 2) for part in np.broadcast_arrays(starts, ends))
        lengths = np.linalg.norm(ends - starts, axis=-1)
        courses = (ends - starts) / np.maximum(lengths, 1e-9)[:, None]
        clear = np.ones(len(starts), np.bool_)
        under_way, gone = np.arange(len(starts)), np.zeros(len(starts))
        while len(under_way):
            slack = self.slack_at(starts[under_way] + gone[:, None] * courses[under_way])
            clear[under_way] = slack > 0
            on = (slack > 0) & (gone < lengths[under_way])
            # a cell tells of its middle, up to 0.7 cells away
            further = gone + np.maximum(slack - 0.7 * self.resolution, STRIDE)
            under_way = under_way[on]
            gone = np.minimum(further[on], lengths[under_way])
        return clear

    def around(self, point: Points) -> Room:
        """Return what can be reached from a place where the disc fits."""
        _, labels = cv2.connectedComponents((self.slack > 0).view(np.uint8), connectivity=4)
        column, row = np.floor((point - np.array(self.origin)) / self.resolution).astype(int)
        reached = np.where(labels == labels[row, column], self.slack, np.float32(-1.0))
        return Room(reached, self.origin, self.resolution)

    def nearest(self, point: Points) -> Points | None:
        """Return a place where the disc fits: the point itself, else the nearest; None if there is none."""
        if bool(self.fits(point)):
            return point
        rows, columns = np.nonzero(self.slack > 0)
        if not len(rows):
            return None
        places = np.stack([columns + 0.5, rows + 0.5], -1) * self.resolution + np.array(self.origin)
        return places[np.square(places - point).sum(-1).argmin()]


def room_for(space: FreeSpace, clearance: float) -> Room:
    """Return where the middle of a disc of this radius can be."""
    return Room(space.distance - np.float32(clearance), space.origin, space.resolution)


def seen_spaces(observation: Observation, lidar: Lidar, bounds: Bounds) -> list[FreeSpace]:
    """Map what a robot saw now and in its keyframes, an episode each; what it did not see counts as free.

    Points on other robots are left out, as they will not stay where they are.

    Args:
        observation: of the robot.
        lidar: of the robot.
        bounds: of the world (x_min, y_min, x_max, y_max), metres; maps end there, or 8 m beyond the team.
    """
    points, real = seen_points(observation, lidar)
    team = observation.team_poses[..., :2].double().cpu().numpy()
    return [
        _rasterise(seen[kept], *_limits(robots, bounds))
        for seen, kept, robots in zip(points.cpu().numpy(), real.cpu().numpy(), team, strict=True)
    ]


def _limits(robots: Points, bounds: Bounds) -> tuple[Points, Points]:
    """Return the lowest and the highest corner of a map that holds all robots."""
    low = np.maximum(robots.min(0) - REACH, bounds[:2])
    high = np.minimum(robots.max(0) + REACH, bounds[2:])
    return np.minimum(low, robots.min(0) - 1), np.maximum(high, robots.max(0) + 1)


def _rasterise(points: Points, low: Points, high: Points) -> FreeSpace:
    shape = np.ceil((high - low) / RESOLUTION).astype(int)
    cells = np.floor((points - low) / RESOLUTION).astype(int)
    column, row = cells[((cells >= 0) & (cells < shape)).all(-1)].T
    open_cells = np.ones((shape[1], shape[0]), np.uint8)
    open_cells[row, column] = 0
    # distances are endless where nothing was seen
    distance = cv2.distanceTransform(open_cells, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * RESOLUTION
    return FreeSpace(np.asarray(distance, np.float32), (float(low[0]), float(low[1])), RESOLUTION)
