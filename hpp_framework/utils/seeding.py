"""One seed in, named child generators out. Nothing in this package reads a global generator."""

from __future__ import annotations

import hashlib

import numpy as np
import torch


def child_seed(seed: int, *names: str | int) -> int:
    """Derive a 63-bit seed from a seed and a path of names; equal inputs give equal seeds everywhere."""
    text = "/".join([str(seed), *map(str, names)])
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "little") >> 1


def numpy_rng(seed: int, *names: str | int) -> np.random.Generator:
    """Return the named child generator of a seed, for numpy."""
    return np.random.default_rng(child_seed(seed, *names))


def torch_rng(seed: int, *names: str | int) -> torch.Generator:
    """Return the named child generator of a seed, for torch (on the CPU)."""
    return torch.Generator().manual_seed(child_seed(seed, *names))
