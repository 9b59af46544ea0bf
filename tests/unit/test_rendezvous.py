"""The rendezvous task by hand-computed values of Eq. 1."""

from __future__ import annotations

import dataclasses
import math

import pytest
import torch
from hpp_tasks.rendezvous import (
    AccumulatedDistance,
    Rendezvous,
    accumulated_distance,
    rendezvous,
    rendezvous_radius,
)


def team(*points: tuple[float, float]) -> torch.Tensor:
    return torch.tensor([[(*point, 0.3) for point in points]])


def test_pairs_are_counted_twice():
    # one pair 5 m apart, counted as (j, k) and as (k, j)
    assert Rendezvous(0.5).reward(team((0, 0), (3, 4))).tolist() == [-10.0]


def test_three_robots():
    # a 3-4-5 triangle: 2 * (3 + 4 + 5)
    assert Rendezvous(0.5).reward(team((0, 0), (3, 0), (0, 4))).tolist() == [-24.0]


def test_zero_within_the_radius_of_the_centre():
    task = Rendezvous(1.0)
    # centre at (0.75, 0): both 0.75 from it, though 1.5 from each other
    assert task.reward(team((0, 0), (1.5, 0))).tolist() == [0.0]
    assert task.success(team((0, 0), (1.5, 0))).tolist() == [True]


def test_exactly_the_radius_is_not_within_it():
    # Eq. 1 says "less than d"
    assert Rendezvous(1.0).success(team((0, 0), (2, 0))).tolist() == [False]
    assert Rendezvous(1.0).reward(team((0, 0), (2, 0))).tolist() == [-4.0]


def test_one_straggler_spoils_it_for_all():
    task = Rendezvous(1.0)
    together = team((0, 0), (0.2, 0), (0.1, 0.1))
    assert task.reward(together).tolist() == [0.0]
    assert task.reward(team((0, 0), (0.2, 0), (6, 0))).item() == pytest.approx(-2 * (0.2 + 6 + 5.8))


def test_headings_do_not_matter():
    poses = team((0, 0), (3, 4))
    turned = poses.clone()
    turned[..., 2] += 2.0
    assert torch.equal(Rendezvous(0.5).reward(poses), Rendezvous(0.5).reward(turned))


def test_leading_dimensions_are_kept():
    task = Rendezvous(0.5)
    poses = torch.randn(4, 7, 5, 3, 3, generator=torch.Generator().manual_seed(0))
    assert task.reward(poses).shape == (4, 7, 5)
    assert task.trajectory_reward(poses).shape == (4, 7)
    assert torch.allclose(task.reward(poses)[2, 3], task.reward(poses[2, 3]))


def test_a_trajectory_is_worth_its_end():
    # appendix A: "agents should only care about their final positions"
    poses = torch.stack([team((0, 0), (9, 0)), team((0, 0), (3, 4))], 1)
    assert Rendezvous(0.5).trajectory_reward(poses).tolist() == [-10.0]


def test_the_accumulated_reward_sums_over_the_trajectory():
    poses = torch.stack([team((0, 0), (9, 0)), team((0, 0), (3, 4)), team((0, 0), (0.5, 0))], 1)
    assert AccumulatedDistance(0.5).trajectory_reward(poses).tolist() == [-18.0 - 10.0 + 0.0]
    assert AccumulatedDistance(0.5).reward(poses[:, 0]).tolist() == [-18.0]


def test_radius_of_a_pair_of_fetch_and_freight(pair):
    # two discs of 0.2877 m touch at 0.2877 m from the centre; 0.25 m to spare
    assert rendezvous_radius(pair) == pytest.approx(0.2877 + 0.25)
    assert rendezvous(pair).radius == accumulated_distance(pair).radius == rendezvous_radius(pair)


@pytest.mark.parametrize(("count", "ring"), [(2, 1.0), (3, 2 / math.sqrt(3)), (4, math.sqrt(2)), (6, 2.0)])
def test_radius_holds_a_ring_of_touching_footprints(fetch, count, ring):
    assert rendezvous_radius([fetch] * count) == pytest.approx(ring * fetch.footprint_radius + 0.25)


def test_the_largest_footprint_counts(fetch):
    wide = dataclasses.replace(fetch, footprint_radius=0.5)
    assert rendezvous_radius([fetch, wide]) == pytest.approx(0.75)


def test_one_robot_has_always_met(fetch):
    task = rendezvous([fetch])
    assert task.success(team((7, -2))).tolist() == [True]


@pytest.mark.parametrize(
    ("headings", "speeds", "done"),
    [
        ((0.0, 0.0), (0.0, 0.0), True),
        ((0.0, 0.0), (0.5, 0.5), True),  # side by side: no relative motion
        ((0.0, math.pi), (0.04, 0.04), True),  # 0.08 m/s apart
        ((0.0, math.pi), (0.06, 0.06), False),  # 0.12 m/s apart
        ((0.0, math.pi / 2), (0.3, 0.0), False),  # one circles the other: chasing is no rendezvous
        ((0.0, math.pi / 2), (0.08, 0.08), False),  # at right angles: 0.113 m/s
    ],
)
def test_success_asks_for_little_relative_speed(headings, speeds, done):
    poses = team((0, 0), (0.5, 0))
    poses[0, :, 2] = torch.tensor(headings)
    velocities = torch.tensor([[(speed, 2.0) for speed in speeds]])
    assert Rendezvous(0.5).success(poses, velocities).tolist() == [done]


def test_success_asks_for_the_meeting_too():
    assert Rendezvous(0.5).success(team((0, 0), (5, 0)), torch.zeros(1, 2, 2)).tolist() == [False]


def test_success_is_sustained_for_five_steps(pair):
    assert rendezvous(pair).sustain_steps == 5
