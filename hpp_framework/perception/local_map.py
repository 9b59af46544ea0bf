"""What a robot has seen lately as a local map, and the paths through it from every robot to every goal.

It is made for one observation of one agent: the points its lidar saw now and in its keyframes, without those
on other robots, on a grid around the team. What was never seen counts as free. It is built afresh for each
plan: 12 keyframes of 222 beams are mapped faster than a neural network of modest size runs.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.robot import Lidar
from hpp_framework.core.types import Keyframes
from hpp_framework.perception import local_map_kernels as chart_kernels
from hpp_framework.perception.sensing import lidar_poses, viewpoints
from hpp_framework.utils.kernels import vectors, wp

RESOLUTION = 0.25
CELLS = 56
"""Metres per cell and cells per side: 14 m around the team's middle."""
COMFORT = 0.3
"""Gap to obstacles in metres from which a metre of path counts once, as in the training of skills."""
BLOCKED = 20.0
"""What a metre counts where a robot does not fit; finite, so that every goal has a path."""
CLEAR = 3.0 * RESOLUTION
"""Largest clearance that a local map tells, in metres."""
BODY = 0.42
"""Points nearer than this to the middle of another robot are on it, in metres."""


@dataclass(frozen=True)
class LocalMap:
    """Local maps of a batch, and the cost of the path from each subject to everywhere.

    Attributes:
        origins: corner of each map's first cell, world frame, metres.
        clearance: distance to the nearest point seen, cells.
        starts: subjects' positions, cells.
        fields: cost of the path from each subject, cells.
    """

    origins: Float[Tensor, "b 2"]
    clearance: Float[Tensor, "b r c"]
    starts: Float[Tensor, "b s 2"]
    fields: Float[Tensor, "b s r c"]


@dataclass(frozen=True)
class MappedPaths:
    """Paths from each subject to each goal.

    Attributes:
        lengths: in metres.
        costs: in metres, those near obstacles counted up to three times.
        points: of each path at given lengths from the subject, world frame, metres; the goal beyond its end.
    """

    lengths: Float[Tensor, "b s g"]
    costs: Float[Tensor, "b s g"]
    points: Float[Tensor, "b s g a 2"]


def build_local_map(
    lidar: Lidar,
    agent: int,
    team_poses: Float[Tensor, "b n 3"],
    scan: Float[Tensor, "b k"],
    keyframes: Keyframes | None,
    subjects: Float[Tensor, "b s 2"],
    radii: Float[Tensor, "s"],
) -> LocalMap:
    """Map what an agent has seen, and find the paths of the subjects.

    Args:
        lidar: of the agent.
        agent: index of the agent in the team.
        team_poses: present poses of all robots, world frame.
        scan: the agent's present scan, metres.
        keyframes: what it remembers, None for nothing.
        subjects: positions from which paths begin, world frame, metres.
        radii: of the subjects' footprints, metres.
    """
    seen_from = viewpoints(team_poses, scan, keyframes)
    poses, scans = seen_from.poses, seen_from.scans
    own = poses[:, :, agent]
    eyes = lidar_poses(lidar, own)
    angles = torch.from_numpy(lidar.angles()).to(own)
    beams = torch.stack([angles.cos(), angles.sin(), torch.zeros_like(angles)], -1)[None]
    origins = team_poses[..., :2].mean(1) - RESOLUTION * CELLS / 2
    count = len(own)
    seen = own.new_zeros(count, CELLS, CELLS, 3)
    clearance = own.new_empty(count, CELLS, CELLS)
    device = wp.device_from_torch(own.device)
    wp.launch(
        chart_kernels.mark,
        dim=count,
        inputs=[
            vectors(eyes), vectors(beams), wp.from_torch(scans.contiguous()), vectors(poses), agent,
            lidar.max_range - 0.01, BODY, vectors(origins), RESOLUTION, vectors(seen),
        ],
        device=device,
    )  # fmt: skip
    wp.launch(
        chart_kernels.dilate,
        dim=count,
        inputs=[vectors(seen), CLEAR / RESOLUTION, wp.from_torch(clearance)],
        device=device,
    )
    starts = ((subjects - origins[:, None]) / RESOLUTION).contiguous()
    fields = own.new_empty(count, subjects.shape[1], CELLS, CELLS)
    wp.launch(
        chart_kernels.sweep,
        dim=starts.shape[:2],
        inputs=[
            wp.from_torch(clearance), vectors(starts),
            wp.from_torch(((radii - RESOLUTION / 2) / RESOLUTION).to(own)), COMFORT / RESOLUTION, BLOCKED,
            wp.from_torch(torch.empty_like(fields).view(-1)), wp.from_torch(fields.view(-1)),
        ],
        device=device,
    )  # fmt: skip
    return LocalMap(origins, clearance, starts, fields)


def mapped_paths(local_map: LocalMap, goals: Float[Tensor, "b g 2"], arcs: Float[Tensor, "a"]) -> MappedPaths:
    """Follow the path from each subject to each goal.

    Args:
        local_map: of the batch.
        goals: world frame, metres.
        arcs: lengths from the subject at which points of the path are wanted, metres, increasing.
    """
    cells = ((goals - local_map.origins[:, None]) / RESOLUTION).contiguous()
    shape = (*local_map.starts.shape[:2], goals.shape[1])
    lengths = goals.new_empty(*shape, 2)
    points = goals.new_empty(*shape, len(arcs), 2)
    wp.launch(
        chart_kernels.trace,
        dim=shape,
        inputs=[
            wp.from_torch(local_map.fields), vectors(local_map.starts), vectors(cells),
            wp.from_torch((arcs / RESOLUTION).to(goals)), vectors(lengths), vectors(points),
        ],
        device=wp.device_from_torch(goals.device),
    )  # fmt: skip
    metres = lengths * RESOLUTION
    return MappedPaths(
        metres[..., 0], metres[..., 1], points * RESOLUTION + local_map.origins[:, None, None, None]
    )


def clearance_around(
    local_map: LocalMap, frames: Float[Tensor, "b s g 3"], grid: Float[Tensor, "p 2"]
) -> Float[Tensor, "b s g p"]:
    """Return the clearance at points placed in frames, as a share of ``CLEAR``.

    Args:
        local_map: of the batch.
        frames: world frame.
        grid: points in a frame, metres.
    """
    origin = torch.nn.functional.pad(local_map.origins, (0, 1))[:, None, None]
    scale = frames.new_tensor([RESOLUTION, RESOLUTION, 1.0])
    placed = ((frames - origin) / scale).contiguous()
    around = frames.new_empty(*frames.shape[:3], len(grid))
    wp.launch(
        chart_kernels.look_around,
        dim=frames.shape[:3],
        inputs=[
            wp.from_torch(local_map.clearance), vectors(placed), vectors((grid / RESOLUTION).to(frames)),
            CLEAR / RESOLUTION, wp.from_torch(around),
        ],
        device=wp.device_from_torch(frames.device),
    )  # fmt: skip
    return around
