"""One seed in, named child generators out. Nothing in this package reads a global generator."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

# SplitMix64 (Steele, Lea and Flood 2014) as signed 64-bit integers
_GAMMA = 0x9E3779B97F4A7C15 - 2**64
_FIRST = 0xBF58476D1CE4E5B9 - 2**64
_SECOND = 0x94D049BB133111EB - 2**64


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


class EpisodeRng:
    """A random stream per episode: an episode draws the same numbers alone and in any batch.

    Numbers come from a counter that is hashed with the episode's seed, so that all episodes draw at once.

    Args:
        seeds: one per episode.
    """

    def __init__(self, seeds: Sequence[int] | Int[Tensor, "b"]) -> None:
        self._seeds = _mixed(torch.as_tensor(seeds, dtype=torch.int64))
        self._drawn = torch.zeros_like(self._seeds)

    def __len__(self) -> int:
        return len(self._seeds)

    def reseed(self, episodes: Bool[Tensor, "b"], seeds: Sequence[int] | Int[Tensor, "k"]) -> None:
        """Begin the streams of the chosen episodes anew.

        Args:
            episodes: which.
            seeds: theirs, in order.
        """
        self._seeds[episodes] = _mixed(torch.as_tensor(seeds, dtype=torch.int64))
        self._drawn[episodes] = 0

    def uniform(self, *shape: int) -> Float[Tensor, "b ..."]:
        """Return numbers in [0, 1), each episode's of the given shape."""
        return _unit(self._bits(shape) >> 40)

    def normal(self, *shape: int) -> Float[Tensor, "b ..."]:
        """Return standard normal numbers (Box and Muller 1958), each episode's of the given shape."""
        bits = self._bits(shape)
        radius = (-2.0 * (1.0 - _unit(bits >> 40)).log()).sqrt()
        return radius * (2 * math.pi * _unit(bits & 0xFFFFFF)).cos()

    def integers(self, high: int, *shape: int) -> Int[Tensor, "b ..."]:
        """Return integers from 0 to below ``high`` (at most 2**31), each episode's of the given shape."""
        return (self._bits(shape) >> 32 & 0xFFFFFFFF) * high >> 32

    def _bits(self, shape: tuple[int, ...]) -> Int[Tensor, "b ..."]:
        count = math.prod(shape)
        place = self._drawn[:, None] + torch.arange(1, count + 1)
        self._drawn += count
        return _mixed(self._seeds[:, None] + place * _GAMMA).reshape(-1, *shape)


def _unit(bits: Int[Tensor, "..."]) -> Float[Tensor, "..."]:
    """Return the lowest 24 bits as a number in [0, 1)."""
    return (bits & 0xFFFFFF).float() / 2**24


def _mixed(bits: Int[Tensor, "..."]) -> Int[Tensor, "..."]:
    bits = (bits ^ _shifted(bits, 30)) * _FIRST
    bits = (bits ^ _shifted(bits, 27)) * _SECOND
    return bits ^ _shifted(bits, 31)


def _shifted(bits: Int[Tensor, "..."], by: int) -> Int[Tensor, "..."]:
    """Return bits moved right, zeros first."""
    return bits >> by & (1 << (64 - by)) - 1
