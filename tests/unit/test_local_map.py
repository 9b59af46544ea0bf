"""Local maps of what a robot saw, and the paths through them."""

from __future__ import annotations

import math

import pytest
import torch

from hpp_framework.core.types import Keyframes
from hpp_framework.core.world import Box, World
from hpp_framework.episodes.core import EpisodeBatch
from hpp_framework.perception.local_map import (
    CELLS,
    CLEAR,
    RESOLUTION,
    build_local_map,
    clearance_around,
    mapped_paths,
)
from hpp_framework.sim.batch.simulator import BatchSimulator

ARCS = torch.tensor([0.5, 1.0, 2.0, 3.0, 5.0])


@pytest.fixture
def radii(pair):
    return torch.tensor([robot.footprint_radius for robot in pair])


def seen_by(pair, world, starts, turns=(0.0,)):
    """Return what robot 0 observes, its keyframes taken while it looked around on the spot."""
    batch = EpisodeBatch(BatchSimulator(pair), keyframes=len(turns))
    poses, scans = [], []
    for turn in turns:
        start = torch.tensor([starts], dtype=torch.float32)
        start[0, 0, 2] += turn
        batch.begin([world], start, [0])
        observation = batch.observe(0)
        poses.append(observation.team_poses)
        scans.append(observation.scan)
    return observation, Keyframes(torch.stack(poses, 1), torch.stack(scans, 1))


def map_of(pair, radii, observation, keyframes=None):
    return build_local_map(
        pair[0].lidar, 0, observation.team_poses, observation.scan, keyframes,
        observation.team_poses[..., :2], radii,
    )  # fmt: skip


def test_ways_in_the_open_are_straight(pair, radii):
    world = World(name="open", walled=False)
    observation, _ = seen_by(pair, world, [[-2.0, 0.0, 0.0], [2.0, 0.5, 2.0]])
    goals = torch.tensor([[[1.0, 2.0], [-2.2, -0.1], [0.0, 11.0]]])
    paths = mapped_paths(map_of(pair, radii, observation), goals, ARCS)
    straight = torch.cdist(observation.team_poses[..., :2], goals)
    # the grid bends paths by a few percent
    assert paths.lengths.allclose(straight, rtol=0.03, atol=0.05)
    share = (ARCS / straight[..., None]).clamp(max=1)[..., None]
    start = observation.team_poses[:, :, None, None, :2]
    on_line = start + share * (goals[:, None, :, None] - start)
    assert (paths.points - on_line).norm(dim=-1).max() < 0.5


def test_ways_lead_around_what_was_seen(pair, radii):
    """A wall of 4 m between robot and goal: the path goes past an end of it, as long as geometry says."""
    world = World(name="wall", walled=False, boxes=(Box(center=(0.0, 0.0), size=(0.4, 4.0)),))
    observation, _ = seen_by(pair, world, [[-2.0, 0.5, 0.0], [-4.0, 3.0, 0.0]])
    goals = torch.tensor([[[2.0, 0.5]]])
    paths = mapped_paths(map_of(pair, radii, observation), goals, ARCS)
    # past the corner at the footprint's radius, or with the gap that comfort asks for
    corner = 2.0 + pair[0].footprint_radius
    shortest = 2 * math.hypot(1.8, corner - 0.5)
    assert shortest - 0.3 < paths.lengths[0, 0, 0] < shortest + 1.2
    assert paths.costs[0, 0, 0] >= paths.lengths[0, 0, 0] - 0.2
    assert paths.points[0, 0, 0, 3, 1] > 1.5


def test_what_was_seen_earlier_still_stands_there(pair, radii):
    world = World(name="wall", walled=False, boxes=(Box(center=(-3.5, 0.0), size=(0.4, 4.0)),))
    behind, remembered = seen_by(pair, world, [[-2.0, 0.0, 0.0], [2.0, 0.0, 0.0]], turns=(math.pi, 0.0))
    goals = torch.tensor([[[-5.0, 0.0]]])
    blind = mapped_paths(map_of(pair, radii, behind), goals, ARCS)
    aware = mapped_paths(map_of(pair, radii, behind, remembered), goals, ARCS)
    assert blind.lengths[0, 0, 0] < 3.2
    assert aware.lengths[0, 0, 0] > 4.0


def test_robots_are_no_obstacles(pair, radii):
    observation, _ = seen_by(pair, World(name="open", walled=False), [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    assert observation.scan.min() < 2.0
    local_map = map_of(pair, radii, observation)
    assert (local_map.clearance * RESOLUTION == CLEAR).all()


def test_clearance_is_read_in_the_frame_of_the_subject(pair, radii):
    world = World(name="post", walled=False, boxes=(Box(center=(1.0, 0.0), size=(0.2, 0.2)),))
    observation, _ = seen_by(pair, world, [[-1.0, 0.0, 0.0], [-3.0, 0.0, 0.0]])
    local_map = map_of(pair, radii, observation)
    frames = torch.tensor([[[[-1.0, 0.0, 0.0]], [[1.0, -2.0, math.pi / 2]]]])
    grid = torch.tensor([[1.95, 0.0], [0.0, 1.5], [50.0, 0.0]])
    around = clearance_around(local_map, frames, grid)[0, :, 0]
    assert (around[:, 0] < 0.5).all()
    assert (around[:, 1:] == 1).all()


def test_charts_of_a_batch_do_not_mix(pair, radii):
    world = World(name="wall", boxes=(Box(center=(0.5, 1.0), size=(0.4, 4.0)),))
    places = [[[-2.0, 0.5, 0.0], [2.0, 3.0, 0.0]], [[-1.0, -2.0, 1.0], [3.0, 0.0, 2.0]]]
    seen = [seen_by(pair, world, place)[0] for place in places]
    poses, scans = (torch.cat(each) for each in zip(*[(o.team_poses, o.scan) for o in seen], strict=True))
    goals = torch.tensor([[[1.0, 1.5], [4.0, -4.0]], [[0.0, 3.0], [-2.0, 2.0]]])
    both = build_local_map(pair[0].lidar, 0, poses, scans, None, poses[..., :2], radii)
    assert both.fields.shape == (2, 2, CELLS, CELLS)
    together = mapped_paths(both, goals, ARCS)
    for row, observation in enumerate(seen):
        alone = mapped_paths(map_of(pair, radii, observation), goals[row : row + 1], ARCS)
        assert torch.equal(alone.lengths[0], together.lengths[row])
        assert torch.equal(alone.points[0], together.points[row])
