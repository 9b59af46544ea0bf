"""Starts and goals of a batch of robots in a pool of worlds, and how far they have still to go."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.core import geometry
from hpp_framework.worlds.pool import WorldPool

CANDIDATES = 16
"""Free points that starts and goals are picked from."""
_PROBE = 0.25
"""Metres beside a robot at which the path length is read to find the path's direction."""


class NavigationTasks:
    """Draws worlds, starts and goals for rows of robots, one world a row.

    Args:
        pool: the worlds; if it knows paths, goals are those that it knows paths to.
        shape: rows, robots per row.
        goal_distance: nearest and farthest goal, straight line, in metres.
        gap: smallest distance between the middles of two robots at the start, in metres.
        detours: share of tasks to the goal with the longest detour among some, if paths are known.

    Attributes:
        share: part of the pool that worlds are drawn from, its first.
    """

    def __init__(
        self,
        pool: WorldPool,
        shape: tuple[int, int],
        goal_distance: tuple[float, float],
        gap: float,
        detours: float = 0.0,
    ) -> None:
        self.pool = pool
        self.goal_distance = goal_distance
        self.gap = gap
        self.detours = detours
        self.share = 1.0
        self.world_index = torch.zeros(shape[0], dtype=torch.int64)
        self.goals = torch.zeros(*shape, 2)
        self._goal_index = torch.zeros(shape, dtype=torch.int64)
        self._points = torch.from_numpy(pool.points)
        self._destinations = self._points[:, : pool.goals] if pool.paths else self._points

    def draw(
        self, chosen: Bool[Tensor, "w n"], poses: Float[Tensor, "w n 3"], rng: torch.Generator
    ) -> Float[Tensor, "w n 3"]:
        """Give the chosen robots a new start and goal; a world is redrawn where robot 0 is chosen.

        Args:
            chosen: which robots.
            poses: of all robots now.
            rng: source of randomness.

        Returns:
            Poses of all robots, the chosen ones at their starts.
        """
        rows, robots = chosen.shape
        count = max(1, round(self.share * len(self.pool)))
        index = torch.randint(count, (rows,), generator=rng)
        self.world_index = torch.where(chosen[:, 0], index, self.world_index)
        poses = poses.clone()
        for i in range(robots):
            pick = chosen[:, i]
            if not bool(pick.any()):
                continue
            start = self._draw_start(poses, i, rng)
            heading = (torch.rand(rows, generator=rng) * 2 - 1) * torch.pi
            poses[:, i] = torch.where(pick[:, None], torch.cat([start, heading[:, None]], 1), poses[:, i])
            goal, goal_index = self._draw_goal(start, rng)
            self.goals[:, i] = torch.where(pick[:, None], goal, self.goals[:, i])
            self._goal_index[:, i] = torch.where(pick, goal_index, self._goal_index[:, i])
        return poses

    def straight(self, poses: Float[Tensor, "w n 3"]) -> Float[Tensor, "w n"]:
        """Return the straight distance to the goals in metres."""
        return (poses[..., :2] - self.goals).norm(dim=-1)

    def left(self, poses: Float[Tensor, "w n 3"]) -> Float[Tensor, "w n"]:
        """Return metres to go: along the path if the pool knows paths, else straight."""
        return self._path(poses[..., :2]) if self.pool.paths else self.straight(poses)

    def direction(self, poses: Float[Tensor, "w n 3"]) -> Float[Tensor, "w n"]:
        """Return the bearing of the path's first piece, in the robots' frames, radians."""
        if not self.pool.paths:
            return geometry.polar(poses, self.goals)[..., 1]
        probes = torch.tensor([[_PROBE, 0.0], [-_PROBE, 0.0], [0.0, _PROBE], [0.0, -_PROBE]])
        east, west, north, south = self._path(poses[..., None, :2] + probes).unbind(-1)
        return geometry.wrap_angle(torch.atan2(south - north, west - east) - poses[..., 2])

    def _path(self, points: Float[Tensor, "w n *m 2"]) -> Float[Tensor, "w n *m"]:
        assert self.pool.paths
        field = self.world_index[:, None] * self.pool.goals + self._goal_index
        field = field.reshape(*field.shape, *[1] * (points.dim() - 3)).expand(points.shape[:-1])
        return self.pool.paths.at(field.reshape(-1), points.reshape(-1, 2)).reshape(points.shape[:-1])

    def _draw_start(self, poses: Tensor, robot: int, rng: torch.Generator) -> Tensor:
        candidates, _ = self._candidates(self._points, rng)
        others = torch.cat([poses[:, :robot, :2], poses[:, robot + 1 :, :2]], 1)
        if others.shape[1] == 0:
            return candidates[:, 0]
        gap = (candidates[:, :, None] - others[:, None]).norm(dim=-1).amin(-1)
        first = (gap > self.gap).to(torch.uint8).argmax(1)
        return candidates[torch.arange(len(candidates)), first]

    def _draw_goal(self, start: Tensor, rng: torch.Generator) -> tuple[Tensor, Tensor]:
        candidates, index = self._candidates(self._destinations, rng)
        distance = (candidates - start[:, None]).norm(dim=-1)
        low, high = self.goal_distance
        suitable = (distance >= low) & (distance <= high)
        first = suitable.to(torch.uint8).argmax(1)
        rows = torch.arange(len(candidates))
        if self.detours and self.pool.paths:
            field = self.world_index[:, None] * self.pool.goals + index
            from_start = start[:, None].expand_as(candidates)
            path = self.pool.paths.at(field.reshape(-1), from_start.reshape(-1, 2)).reshape(distance.shape)
            longest = torch.where(suitable, path - distance, -1.0).argmax(1)
            first = torch.where(torch.rand(len(rows), generator=rng) < self.detours, longest, first)
        return candidates[rows, first], index[rows, first]

    def _candidates(self, points: Tensor, rng: torch.Generator) -> tuple[Tensor, Tensor]:
        index = torch.randint(points.shape[1], (len(self.world_index), CANDIDATES), generator=rng)
        return points[self.world_index[:, None], index], index
