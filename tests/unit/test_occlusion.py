"""Which goals lie right behind what a robot sees."""

from __future__ import annotations

import math

import pytest
import torch

from hpp_framework.core.types import Keyframes, Observation
from hpp_framework.perception.occlusion import occluded

GOALS = torch.tensor([[[1.0, 0.0], [3.0, 0.0], [6.0, 0.0], [-3.0, 0.0], [0.0, 3.0]]])
"""Before the surface, behind it, far behind it, out of view, and beside it."""


@pytest.fixture
def lidar(fetch):
    return fetch.lidar


def facing(lidar, heading=0.0, ahead=2.0):
    """Return a robot at the origin that sees a surface within 0.3 rad of the x axis and nothing else."""
    angles = torch.from_numpy(lidar.angles()).float() + heading
    narrow = torch.atan2(angles.sin(), angles.cos()).abs() < 0.3
    scan = torch.where(narrow, ahead, lidar.max_range)
    pose = torch.tensor([0.0, 0.0, heading])
    poses = torch.stack([pose, torch.tensor([0.0, -9.0, 0.0])]).expand(1, 5, 2, 3)
    return Observation(0, poses, scan.expand(1, 5, -1), torch.zeros(1, 2))


def test_only_what_lies_right_behind_is_in_shadow(lidar):
    found = occluded(facing(lidar), lidar, GOALS, 2.5)
    assert found.tolist() == [[False, True, False, False, False]]
    assert occluded(facing(lidar), lidar, GOALS, 5.0).tolist() == [[False, True, True, False, False]]


def test_what_was_seen_earlier_still_casts_its_shadow_or_lies_open(lidar):
    away = facing(lidar, math.pi)
    assert not occluded(away, lidar, GOALS, 2.5).any()
    past = facing(lidar)
    remembered = Keyframes(past.poses[:, :1], past.scans[:, :1])
    with_memory = Observation(0, away.poses, away.scans, away.velocity, remembered)
    assert occluded(with_memory, lidar, GOALS, 2.5).tolist() == [[False, True, False, False, False]]
    open_then = Keyframes(past.poses[:, :1], torch.full_like(past.scans[:, :1], lidar.max_range))
    seen_open = Observation(0, past.poses, past.scans, past.velocity, open_then)
    assert not occluded(seen_open, lidar, GOALS, 2.5).any()


def test_robots_cast_no_shadow_and_stand_in_none(lidar):
    observation = facing(lidar)
    poses = observation.poses.clone()
    poses[:, :, 1, :2] = torch.tensor([2.3, 0.0])
    mate_ahead = Observation(0, poses, observation.scans, observation.velocity)
    assert not occluded(mate_ahead, lidar, GOALS, 2.5).any()
    poses = observation.poses.clone()
    poses[:, :, 1, :2] = torch.tensor([3.2, 0.3])
    mate_behind = Observation(0, poses, observation.scans, observation.velocity)
    assert not occluded(mate_behind, lidar, GOALS, 2.5).any()
