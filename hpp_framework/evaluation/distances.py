"""How far apart robots were over time: every episode's curve, and the bands of each cell.

``distances/`` holds one array (episodes, steps) a chunk, in metres; ``distance.npz`` what the figures of the
paper show: means and quantiles over the episodes of each world and planner.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.evaluation.rollout import EPISODE_STEPS, Episodes
from hpp_framework.evaluation.statistics import Z95
from hpp_framework.utils.run_folder import RESUME, replacing

CURVES, BANDS = "distances", "distance.npz"
QUANTILES = (0.1, 0.25, 0.5, 0.75, 0.9)


def distance_curves(episodes: Episodes) -> Float[np.ndarray, "b t"]:
    """Return the mean distance between robots by control step, in metres; held from an episode's end on."""
    steps = torch.arange(EPISODE_STEPS + 1)
    held = torch.minimum(steps, episodes.last_step()[:, None])
    return episodes.spread().gather(1, held).numpy().astype(np.float32)


def curve_file(out: Path, world: int, planner: int, first: int) -> Path:
    """Return where the curves of a chunk lie.

    Args:
        out: run folder.
        world: its place in the experiment.
        planner: its place in the experiment.
        first: episode of the chunk.
    """
    return out / CURVES / f"{world:02d}-{planner:02d}-{first:05d}.npy"


def write_curves(file: Path, curves: Float[np.ndarray, "b t"]) -> None:
    """Write the curves of a chunk, completely or not at all.

    Raises:
        ConfigError: if the file cannot be written.
    """
    with replacing(file, remedy=RESUME) as temporary, temporary.open("wb") as stream:
        np.save(stream, curves, allow_pickle=False)


def write_bands(out: Path, worlds: Sequence[str], planners: Sequence[str], firsts: Sequence[int]) -> None:
    """Write ``distance.npz``: what the curves of each cell come to.

    Its arrays: ``worlds`` (w,), ``planners`` (p,), ``seconds`` (t,), ``episodes`` (w, p), and in metres
    ``mean``, ``std``, ``mean_low`` and ``mean_high`` (95 % interval of the mean) (w, p, t), ``quantiles``
    (w, p, q, t) at ``levels`` (q,). Cells without curves, from older versions, are NaN.

    Args:
        out: run folder.
        worlds: of the experiment.
        planners: of the experiment.
        firsts: first episode of each chunk.
    """
    shape = (len(worlds), len(planners))
    steps = EPISODE_STEPS + 1
    count = np.zeros(shape, np.int64)
    mean, std = np.full((*shape, steps), np.nan), np.full((*shape, steps), np.nan)
    quantiles = np.full((*shape, len(QUANTILES), steps), np.nan)
    for place in product(range(len(worlds)), range(len(planners))):
        files = [curve_file(out, *place, first) for first in firsts]
        if all(file.exists() for file in files):
            curves = np.concatenate([np.load(file, allow_pickle=False) for file in files]).astype(np.float64)
            count[place] = len(curves)
            mean[place], std[place] = curves.mean(0), curves.std(0, ddof=min(1, len(curves) - 1))
            quantiles[place] = np.quantile(curves, QUANTILES, axis=0)
    half = Z95 * std / np.sqrt(np.maximum(count, 1))[..., None]
    with replacing(out / BANDS) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(
            stream, worlds=np.array(worlds), planners=np.array(planners), episodes=count,
            seconds=np.arange(steps) * CONTROL_PERIOD, mean=mean, std=std, mean_low=mean - half,
            mean_high=mean + half, levels=np.array(QUANTILES), quantiles=quantiles,
        )  # fmt: skip
