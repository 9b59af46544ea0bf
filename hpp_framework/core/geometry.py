"""SE(2) algebra on batched poses (x, y, theta), for numpy arrays and torch tensors alike.

Every function takes arrays whose last dimension is the pose or point and broadcasts over the rest.
"""

from __future__ import annotations

import math
from types import ModuleType
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

Array = TypeVar("Array", Tensor, npt.NDArray[np.floating])
# one element of a numpy array is a scalar, not an array
Angle = TypeVar("Angle", Tensor, npt.NDArray[np.floating], np.floating)


def _lib(array: object) -> ModuleType:
    return torch if isinstance(array, Tensor) else np


def _stack(parts: list[Any]) -> Any:
    return _lib(parts[0]).stack(parts, -1)


def wrap_angle(angle: Angle) -> Angle:
    """Wrap angles in radians into [-pi, pi)."""
    return (angle + math.pi) % (2 * math.pi) - math.pi


def compose(pose: Array, relative: Array) -> Array:
    """Return the world pose of ``relative``, a pose given in the frame of ``pose``."""
    xy = to_world(pose, relative[..., :2])
    return _stack([xy[..., 0], xy[..., 1], wrap_angle(pose[..., 2] + relative[..., 2])])


def between(pose: Array, other: Array) -> Array:
    """Return the pose ``other`` expressed in the frame of ``pose`` (inverse of :func:`compose`)."""
    xy = to_frame(pose, other[..., :2])
    return _stack([xy[..., 0], xy[..., 1], wrap_angle(other[..., 2] - pose[..., 2])])


def to_world(pose: Array, point: Array) -> Array:
    """Return world coordinates of a point (..., 2) given in the frame of ``pose``."""
    lib = _lib(pose)
    cos, sin = lib.cos(pose[..., 2]), lib.sin(pose[..., 2])
    x, y = point[..., 0], point[..., 1]
    return _stack([pose[..., 0] + cos * x - sin * y, pose[..., 1] + sin * x + cos * y])


def to_frame(pose: Array, point: Array) -> Array:
    """Return a world point (..., 2) in the frame of ``pose``."""
    lib = _lib(pose)
    cos, sin = lib.cos(pose[..., 2]), lib.sin(pose[..., 2])
    dx, dy = point[..., 0] - pose[..., 0], point[..., 1] - pose[..., 1]
    return _stack([cos * dx + sin * dy, cos * dy - sin * dx])


def polar(pose: Array, point: Array) -> Array:
    """Return (distance in metres, bearing in radians) of a world point seen from ``pose``."""
    lib = _lib(pose)
    local = to_frame(pose, point)
    return _stack([lib.hypot(local[..., 0], local[..., 1]), lib.arctan2(local[..., 1], local[..., 0])])
