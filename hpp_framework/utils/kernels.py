"""Starts Warp, which compiles the project's kernels for CPU and CUDA; import ``wp`` from here."""

from __future__ import annotations

import os
import sys
from typing import Any

import warp as wp
from torch import Tensor

__all__ = ["vectors", "wp"]

wp.config.log_level = wp.LOG_ERROR


def _initialise() -> None:
    """Start Warp without the line that its native part prints on machines that have no CUDA."""
    sys.stderr.flush()
    kept = os.dup(2)
    silent = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(silent, 2)
        wp.init()
    finally:
        os.dup2(kept, 2)
        os.close(silent)
        os.close(kept)


_initialise()


def vectors(tensor: Tensor) -> Any:
    """Hand a tensor (..., 2) or (..., 3) to Warp as an array of vectors."""
    return wp.from_torch(tensor.contiguous(), dtype=wp.vec2 if tensor.shape[-1] == 2 else wp.vec3)
