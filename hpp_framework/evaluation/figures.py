"""Figures: distance over time. Drawn without a display or global state."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from hpp_framework.utils.errors import ConfigError, HppError
from hpp_framework.utils.run_folder import ROOM, replacing

COLORS = ("#f26a1b", "#1868c4", "#26965a", "#aa3ca0", "#c8a014", "#14a0aa", "#c8323c", "#6e5ac8")


def plot_distance(
    file: Path,
    times: npt.ArrayLike,
    distances: Mapping[str, npt.ArrayLike],
    threshold: float | None,
    *,
    title: str = "",
    ylabel: str = "distance between agents [m]",
) -> Path:
    """Plot the distance between agents over time: mean and inter-quartile band of each label's episodes.

    Args:
        file: the picture; its suffix chooses the format. Its folder is made if need be.
        times: (t,) seconds.
        distances: label to (episodes, t) or (t,) metres; NaN where an episode has ended.
        threshold: distance that counts as success, metres; None draws no line.
        title: above the plot.
        ylabel: of the vertical axis.

    Returns:
        The file.

    Raises:
        ConfigError: if nothing is to be plotted or a shape does not match ``times``.
        HppError: if the file cannot be written.
    """
    seconds = np.asarray(times, np.float64)
    if not distances:
        raise ConfigError("plot_distance: there is nothing to plot; give at least one label.")
    figure = Figure(figsize=(6.4, 4.0), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for index, (label, values) in enumerate(distances.items()):
        episodes = np.atleast_2d(np.asarray(values, np.float64))
        if episodes.ndim != 2 or episodes.shape[1] != len(seconds):
            raise ConfigError(
                f"plot_distance: '{label}' has shape {episodes.shape}, expected (episodes, {len(seconds)})."
            )
        color = COLORS[index % len(COLORS)]
        mean, low, high = _summary(episodes)
        axes.plot(seconds, mean, color=color, linewidth=2, label=label)
        if len(episodes) > 1:
            axes.fill_between(seconds, low, high, color=color, alpha=0.18, linewidth=0)
    if threshold is not None:
        axes.axhline(
            threshold,
            color="#30343c",
            linewidth=1.2,
            linestyle=(0, (4, 3)),
            label=f"success below {threshold:.2f} m",
        )
    axes.set(xlabel="time [s]", ylabel=ylabel, title=title)
    axes.set_xlim(float(seconds.min()), max(float(seconds.max()), float(seconds.min()) + 0.1))
    axes.set_ylim(bottom=0)
    axes.grid(color="#e4e7eb")
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
    return save_figure(figure, Path(file))


def _summary(
    episodes: npt.NDArray[np.float64],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return mean and quartiles over the episodes that still run; NaN where none does."""
    running = np.isfinite(episodes).any(0)
    result = np.full((3, episodes.shape[1]), np.nan)
    if running.any():
        result[0, running] = np.nanmean(episodes[:, running], 0)
        result[1:, running] = np.nanquantile(episodes[:, running], (0.25, 0.75), 0)
    return result[0], result[1], result[2]


def save_figure(figure: Figure, file: Path) -> Path:
    """Write a picture, completely or not at all; returns the file.

    Raises:
        ConfigError: if there is no such format.
        HppError: if the file cannot be written.
    """
    failed = f"picture '{file}' could not be written"
    try:
        with replacing(file, failed=failed, remedy=ROOM, error=HppError) as temporary:
            figure.savefig(temporary, format=file.suffix[1:] or "png")
    except ValueError as error:
        raise ConfigError(f"picture '{file}': {error}. Use .png, .svg or .pdf.") from error
    return file
