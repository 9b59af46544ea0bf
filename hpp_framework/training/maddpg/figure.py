"""The training curve of MADDPG, as in the paper's appendix C.2: the spread over seeds, and the best one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from hpp_framework.evaluation.figures import save_figure

BEST, SPREAD = "#1868c4", "#e377a2"


def plot_seeds(file: Path, card: Mapping[str, Any]) -> Path:
    """Draw return and success in unseen worlds over the steps of all seeds.

    Args:
        file: the picture; its suffix chooses the format.
        card: of the best seed's weights, as :func:`hpp_framework.training.maddpg.seeds.keep_best` writes it.

    Raises:
        HppError: if the file cannot be written.
    """
    curves: dict[str, Sequence[Mapping[str, float]]] = card["curves"]
    best = str(card["run"]["seed"])
    steps = np.array([row["steps"] for row in curves[best]]) / 1e6
    figure = Figure(figsize=(9.0, 3.6), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    for axes, name, label in zip(
        figure.subplots(1, 2), ("judged_return", "success"), ("return of an episode", "success"), strict=True
    ):
        rows = np.array([[row[name] for row in curve] for curve in curves.values()])
        mean, std = rows.mean(0), rows.std(0)
        if len(rows) > 1:
            axes.plot(steps, rows.T, color=SPREAD, alpha=0.35, linewidth=0.8)
            axes.fill_between(steps, mean - std, mean + std, color=SPREAD, alpha=0.25, linewidth=0)
            axes.plot(
                steps, mean, color=SPREAD, linewidth=2, label=f"mean of {len(rows)} seeds, one deviation"
            )
        own = [row[name] for row in curves[best]]
        axes.plot(steps, own, color=BEST, linewidth=2, label=f"seed {best}, the best")
        axes.plot(card["judged"]["steps"] / 1e6, card["judged"][name], "o", color=BEST, label="kept")
        axes.set(xlabel="million control steps", ylabel=label)
        axes.grid(alpha=0.3)
        axes.legend(loc="lower right", fontsize=8)
    figure.suptitle(f"MADDPG, {' and '.join(card['robots'])}, without noise in unseen worlds")
    return save_figure(figure, file)
