"""Starts Warp, which compiles the project's kernels for CPU and CUDA; import ``wp`` from here."""

from __future__ import annotations

import os
import sys

import warp as wp

__all__ = ["wp"]

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
