"""SE(2) by hand-computed values."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from hpp_framework.core import geometry

QUARTER = math.pi / 2


def test_compose_turns_then_moves():
    # at (1, 2) facing +y, one metre ahead and two to the left
    moved = geometry.compose(np.array([1.0, 2.0, QUARTER]), np.array([1.0, 2.0, QUARTER]))
    assert moved == pytest.approx([-1.0, 3.0, -math.pi])


def test_between_is_what_the_robot_sees():
    seen = geometry.between(np.array([1.0, 2.0, QUARTER]), np.array([1.0, 5.0, 0.0]))
    assert seen == pytest.approx([3.0, 0.0, -QUARTER])


def test_polar_bearing_is_positive_to_the_left():
    pose = np.array([0.0, 0.0, QUARTER])
    assert geometry.polar(pose, np.array([0.0, 2.0])) == pytest.approx([2.0, 0.0])
    assert geometry.polar(pose, np.array([-3.0, 0.0])) == pytest.approx([3.0, QUARTER])


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [
        (0.0, 0.0),
        (math.pi, -math.pi),
        (-math.pi, -math.pi),
        (3.5 * math.pi, -QUARTER),
        (-3 * QUARTER, QUARTER),
    ],
)
def test_wrap_angle(angle, wrapped):
    assert geometry.wrap_angle(np.array(angle)) == pytest.approx(wrapped)


def test_broadcasts_goals_against_robots():
    poses, goals = torch.zeros(4, 1, 3), torch.ones(4, 7, 2)
    assert geometry.polar(poses, goals).shape == (4, 7, 2)
    assert geometry.to_world(torch.zeros(5, 3), torch.ones(2)).shape == (5, 2)


def test_keeps_kind_and_precision():
    single = geometry.compose(torch.zeros(3), torch.zeros(3))
    assert single.dtype == torch.float32
    assert geometry.compose(np.zeros(3, np.float32), np.zeros(3, np.float32)).dtype == np.float32
    assert isinstance(geometry.to_frame(np.zeros(3), np.zeros(2)), np.ndarray)
