"""Length of the shortest way from everywhere in a world to a goal, around obstacles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from jaxtyping import Float, Int
from torch import Tensor

from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.kernels import wp
from hpp_framework.utils.thread_pool import Crew
from hpp_framework.worlds import geodesic_kernels
from hpp_framework.worlds.occupancy import FreeSpace

BLOCKED = float(geodesic_kernels.FAR)
_NO_ROOM = 20.0
"""Slowness where a disc does not fit."""


@dataclass(frozen=True)
class GoalFields:
    """Distances to goals on grids, one field a goal.

    Attributes:
        values: metres, all fields one after the other, row by row; infinite where no way leads.
        first: index of each field's first cell.
        shape: rows and columns of each field.
        origin: corner of each field's cell (0, 0), in metres.
        resolution: metres a cell.
    """

    values: Float[Tensor, "cells"]
    first: Int[Tensor, "f"]
    shape: Int[Tensor, "f 2"]
    origin: Float[Tensor, "f 2"]
    resolution: float

    def at(self, field: Int[Tensor, "p"], points: Float[Tensor, "p 2"]) -> Float[Tensor, "p"]:
        """Return the way's length in metres from points, bilinear between cells; infinite if there is none.

        Args:
            field: index of the field of each point.
            points: world coordinates in metres; those outside read the nearest cell.
        """
        shape = self.shape[field]
        cell = (points - self.origin[field]) / self.resolution - 0.5
        column = cell[:, 0].clamp(min=0).minimum(shape[:, 1] - 1.0)
        row = cell[:, 1].clamp(min=0).minimum(shape[:, 0] - 1.0)
        left, low = column.floor().long(), row.floor().long()
        right, high = (left + 1).minimum(shape[:, 1] - 1), (low + 1).minimum(shape[:, 0] - 1)
        along, up = column - left, row - low
        start = self.first[field]
        rows = torch.stack([low, low, high, high])
        columns = torch.stack([left, right, left, right])
        weights = torch.stack([(1 - along) * (1 - up), along * (1 - up), (1 - along) * up, along * up])
        corners = self.values[start + rows * shape[:, 1] + columns]
        # corners inside obstacles do not count
        weights = weights.masked_fill(corners.isinf(), 0.0)
        total = weights.sum(0)
        mean = (weights * corners.masked_fill(corners.isinf(), 0.0)).sum(0) / total
        return torch.where(total > 1e-6, mean, torch.inf)


def shortest_ways(
    spaces: Sequence[FreeSpace],
    radius: float,
    goals: Float[Tensor, "f 2"],
    space_of: Int[Tensor, "f"],
    *,
    threads: int | None = None,
) -> GoalFields:
    """Find the length of the shortest way of a disc to each goal, accurate to about one percent.

    Args:
        spaces: free spaces of the worlds, of one resolution.
        radius: of the disc, in metres. A cell counts as free in case of doubt.
        goals: world coordinates in metres.
        space_of: index of each goal's world.
        threads: that work side by side, or None for one a core.

    Raises:
        ConfigError: if the resolutions differ, or a goal lies outside its world.
    """
    free = [space.distance > radius - space.resolution for space in spaces]
    slowness = [np.where(cells, 1.0, BLOCKED).astype(np.float32) for cells in free]
    return _solve(geodesic_kernels.solve_straight, spaces, slowness, goals, space_of, threads, scratch=True)


def comfortable_ways(
    spaces: Sequence[FreeSpace],
    radius: float,
    comfort: float,
    goals: Float[Tensor, "f 2"],
    space_of: Int[Tensor, "f"],
    *,
    threads: int | None = None,
) -> GoalFields:
    """Find the length of the way to each goal that a careful disc prefers: metres near obstacles count more.

    Solves the eikonal equation ``|grad T| = slowness`` (Zhao 2005), too long by up to a few percent on
    diagonals. Where a disc does not fit the way is long but finite, so that every place has one.

    Args:
        spaces: free spaces of the worlds, of one resolution.
        radius: of the disc, in metres.
        comfort: gap to obstacles in metres from which a metre counts once; with no gap it counts three times.
        goals: world coordinates in metres.
        space_of: index of each goal's world.
        threads: that work side by side, or None for one a core.

    Raises:
        ConfigError: if the resolutions differ, or a goal lies outside its world.
    """
    slowness: list[npt.NDArray[np.float32]] = []
    for space in spaces:
        room = space.distance - (radius - space.resolution / 2)
        cells = np.where(room > 0, 1 + 2 * np.clip(1 - room / comfort, 0, 1), _NO_ROOM)
        slowness.append(cells.astype(np.float32))
    return _solve(geodesic_kernels.solve, spaces, slowness, goals, space_of, threads)


def _solve(
    kernel: Any,
    spaces: Sequence[FreeSpace],
    slowness: Sequence[npt.NDArray[np.float32]],
    goals: Tensor,
    space_of: Tensor,
    threads: int | None,
    *,
    scratch: bool = False,
) -> GoalFields:
    resolution = spaces[0].resolution
    if any(space.resolution != resolution for space in spaces):
        raise ConfigError("free spaces must have one resolution; rasterise all worlds with the same.")
    shapes = torch.tensor([cells.shape for cells in slowness])
    origins = torch.tensor([space.origin for space in spaces], dtype=torch.float32)
    shape, origin = shapes[space_of], origins[space_of]
    cells = (goals - origin) / resolution
    if bool(((cells < 0) | (cells >= shape.flip(1))).any()):
        raise ConfigError("a goal lies outside the bounds of its world.")
    sizes = shape.prod(1)
    first = sizes.cumsum(0) - sizes
    values = torch.empty(int(sizes.sum()))
    inputs = [
        _grids(slowness, shapes),
        wp.from_torch(space_of.to(torch.int32).contiguous()),
        wp.from_torch(cells.contiguous(), dtype=wp.vec2),
        wp.from_torch(first.contiguous()),
        wp.from_torch(values),
    ]
    if scratch:
        inputs.append(wp.empty(len(values), dtype=int, device="cpu"))
    crew = Crew(threads)
    crew.run([partial(_launch, kernel, start, stop, inputs) for start, stop in crew.slices(len(goals))])
    crew.close()
    values.mul_(resolution).masked_fill_(values >= 0.5 * BLOCKED * resolution, torch.inf)
    return GoalFields(values, first, shape, origin, resolution)


def _launch(kernel: Any, start: int, stop: int, inputs: Sequence[object]) -> None:
    wp.launch(kernel, dim=stop - start, inputs=[start, *inputs], device="cpu")


def _grids(slowness: Sequence[npt.NDArray[np.float32]], shapes: Tensor) -> Any:
    sizes = shapes.prod(1)
    grids: Any = geodesic_kernels.Grids()
    grids.slowness = wp.array(np.concatenate([cells.ravel() for cells in slowness]), dtype=float)
    grids.first = wp.array((sizes.cumsum(0) - sizes).numpy(), dtype=wp.int64)
    grids.rows = wp.array(shapes[:, 0].numpy(), dtype=int)
    grids.columns = wp.array(shapes[:, 1].numpy(), dtype=int)
    return grids
