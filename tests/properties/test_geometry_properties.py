"""SE(2) as algebra, over random poses."""

from __future__ import annotations

import math

import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st

from hpp_framework.core import geometry

coordinate = st.floats(-100, 100, allow_subnormal=False)
angle = st.floats(-10, 10, allow_subnormal=False)
pose = st.tuples(coordinate, coordinate, angle).map(np.array)
point = st.tuples(coordinate, coordinate).map(np.array)


def same_pose(a, b) -> bool:
    turn = geometry.wrap_angle(np.asarray(a[2] - b[2]))
    return bool(np.allclose(a[:2], b[:2], atol=1e-9) and abs(turn) < 1e-9)


@given(pose, pose)
def test_between_inverts_compose(a, b):
    assert same_pose(geometry.between(a, geometry.compose(a, b)), b)
    assert same_pose(geometry.compose(a, geometry.between(a, b)), b)


@given(pose, pose, pose)
def test_compose_is_associative(a, b, c):
    left = geometry.compose(geometry.compose(a, b), c)
    right = geometry.compose(a, geometry.compose(b, c))
    assert same_pose(left, right)


@given(pose)
def test_identity_changes_nothing(a):
    zero = np.zeros(3)
    assert same_pose(geometry.compose(a, zero), a)
    assert same_pose(geometry.compose(zero, a), a)
    assert same_pose(geometry.between(a, a), zero)


@given(pose, point)
def test_frames_invert_each_other_and_keep_distances(a, p):
    assert np.allclose(geometry.to_world(a, geometry.to_frame(a, p)), p, atol=1e-9)
    assert math.isclose(np.hypot(*geometry.to_frame(a, p)), math.dist(a[:2], p), abs_tol=1e-9)
    assert math.isclose(geometry.polar(a, p)[0], math.dist(a[:2], p), abs_tol=1e-9)


@given(st.floats(-1e4, 1e4))
def test_wrapped_angles_are_in_range_and_point_the_same_way(value):
    wrapped = float(geometry.wrap_angle(np.asarray(value)))
    assert -math.pi <= wrapped < math.pi
    assert math.isclose(math.cos(wrapped), math.cos(value), abs_tol=1e-9)
    assert math.isclose(math.sin(wrapped), math.sin(value), abs_tol=1e-9)


@given(pose, pose)
def test_numpy_and_torch_agree(a, b):
    for function, second in (
        (geometry.compose, b), (geometry.between, b), (geometry.to_world, b[:2]),
        (geometry.to_frame, b[:2]), (geometry.polar, b[:2]),
    ):  # fmt: skip
        from_torch = function(torch.from_numpy(a), torch.from_numpy(second)).numpy()
        assert np.allclose(function(a, second), from_torch, atol=1e-9), function.__name__
