"""Lengths of shortest paths from everywhere in a world to a goal, by fast marching (Sethian 1996)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import skfmm
import torch
from jaxtyping import Float, Int
from torch import Tensor

from hpp_framework.utils.errors import ConfigError
from hpp_framework.worlds.occupancy import FreeSpace

Array = npt.NDArray[np.float64]

_SOURCE = 1.5
"""Cells around a goal within which paths are straight lines."""
DOUBT = 1.5
"""Cells by which a free space is taken to call obstacles nearer than they are; it may be up to 1.92 cells."""
_NO_ROOM = 20.0
"""Slowness where a disc does not fit."""


@dataclass(frozen=True)
class PathFields:
    """Lengths of paths to goals on grids.

    Attributes:
        values: metres, one field per goal; infinite where no path leads.
        origin: corner of each field's cell (0, 0), metres.
        resolution: metres per cell.
    """

    values: Float[Tensor, "f r c"]
    origin: Float[Tensor, "f 2"]
    resolution: float

    def at(self, field: Int[Tensor, "p"], points: Float[Tensor, "p 2"]) -> Float[Tensor, "p"]:
        """Return the path length in metres from points, bilinear between cells; infinite if there is no path.

        Args:
            field: index of the field of each point.
            points: world coordinates in metres; points outside read the nearest cell.
        """
        rows, columns = self.values.shape[1:]
        x, y = ((points - self.origin[field]) / self.resolution - 0.5).unbind(-1)
        x, y = x.clamp(0, columns - 1), y.clamp(0, rows - 1)
        left, low = x.floor().long(), y.floor().long()
        right, high = (left + 1).clamp(max=columns - 1), (low + 1).clamp(max=rows - 1)
        along, up = x - left, y - low
        corners = self.values[
            field, torch.stack([low, low, high, high]), torch.stack([left, right, left, right])
        ]
        weights = torch.stack([(1 - along) * (1 - up), along * (1 - up), (1 - along) * up, along * up])
        # corners inside obstacles do not count
        weights = weights.masked_fill(corners.isinf(), 0.0)
        total = weights.sum(0)
        mean = (weights * corners.masked_fill(corners.isinf(), 0.0)).sum(0) / total
        return torch.where(total > 1e-6, mean, torch.inf)


def shortest_paths(
    spaces: Sequence[FreeSpace],
    radius: float,
    goals: Float[Tensor, "f 2"],
    space_of: Int[Tensor, "f"],
    *,
    farthest: float = 0.0,
) -> PathFields:
    """Find the length of the shortest path of a disc to each goal, accurate to about two percent.

    In passages that are one or two cells wide and run across the grid it may be 15 percent too long.

    Args:
        spaces: free spaces of the worlds, of one resolution.
        radius: of the disc, in metres. A cell counts as free in case of doubt.
        goals: world coordinates in metres.
        space_of: index of each goal's world.
        farthest: longest path that is looked for, metres; longer ones are infinite. 0 looks for all.

    Raises:
        ConfigError: if the resolutions differ, or a goal lies outside its world.
    """

    def march(space: FreeSpace, outside: Array) -> Array:
        blocked = (space.distance <= radius - DOUBT * space.resolution) & (outside > 0)
        return skfmm.distance(np.ma.MaskedArray(outside, blocked), space.resolution, narrow=farthest)

    return _fields(march, spaces, goals, space_of)


def comfortable_paths(
    spaces: Sequence[FreeSpace],
    radius: float,
    comfort: float,
    goals: Float[Tensor, "f 2"],
    space_of: Int[Tensor, "f"],
) -> PathFields:
    """Find the length of the path to each goal that a careful disc prefers: metres near obstacles count more.

    Where a disc does not fit the path is long but finite, so that every place has one.

    Args:
        spaces: free spaces of the worlds, of one resolution.
        radius: of the disc, in metres.
        comfort: gap to obstacles in metres from which a metre counts once; with no gap it counts three times.
        goals: world coordinates in metres.
        space_of: index of each goal's world.

    Raises:
        ConfigError: if the resolutions differ, or a goal lies outside its world.
    """

    def march(space: FreeSpace, outside: Array) -> Array:
        room = space.distance - (radius - space.resolution / 2)
        slowness = np.where(room > 0, 1 + 2 * np.clip(1 - room / comfort, 0, 1), _NO_ROOM)
        costs = np.copysign(skfmm.travel_time(outside, 1 / slowness, space.resolution), outside)
        # metres around the goal are as slow as at the goal
        return costs + (slowness.flat[outside.argmin()] - 1) * _SOURCE * space.resolution

    return _fields(march, spaces, goals, space_of)


def _fields(
    march: Callable[[FreeSpace, Array], Array], spaces: Sequence[FreeSpace], goals: Tensor, space_of: Tensor
) -> PathFields:
    """Return the fields that marching from a circle around each goal gives.

    Args:
        march: given a free space and the distance of its cells from the circle, negative inside, returns the
            lengths of paths to the circle likewise.
        spaces: free spaces of the worlds.
        goals: world coordinates in metres.
        space_of: index of each goal's world.
    """
    resolution = spaces[0].resolution
    if any(space.resolution != resolution for space in spaces):
        raise ConfigError("free spaces must have one resolution; rasterise all worlds with the same.")
    shape = np.max([space.distance.shape for space in spaces], axis=0)
    values = torch.empty(len(goals), *shape.tolist())
    origin = torch.tensor([space.origin for space in spaces], dtype=torch.float32)[space_of]
    for field, (goal, world) in enumerate(zip(goals.double().numpy(), space_of.tolist(), strict=True)):
        space = spaces[world]
        if not space.contains(goal):
            raise ConfigError(f"the goal {goal.tolist()} lies outside the bounds of its world.")
        circle = _SOURCE * resolution
        lengths = np.ma.filled(march(space, space.distance_from(goal) - circle), np.inf) + circle
        # smaller worlds are padded with their edges
        padding = [(0, most - size) for most, size in zip(shape.tolist(), lengths.shape, strict=True)]
        values[field] = torch.from_numpy(np.pad(lengths, padding, mode="edge"))
    return PathFields(values, origin, resolution)
