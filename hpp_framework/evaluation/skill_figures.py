"""The picture of competence maps. Drawn without a display or global state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from hpp_framework.evaluation.competence import TRUSTED_EPISODES, TRUSTED_SHARE, CompetenceBin
from hpp_framework.evaluation.figures import save_figure
from hpp_framework.evaluation.navigation_tasks import CLEARANCES, DISTANCES
from hpp_framework.utils.errors import ConfigError

PANEL = (4.6, 3.3)
"""Inches a map."""
LEGEND = 0.9
"""Inches above and under the maps."""
LINE = 64
"""Letters of the title that fit above a map."""
SHADES = "YlGnBu"
DARK = 0.6
"""Success from which a cell's text is white."""


def plot_competence(
    file: Path, maps: Mapping[tuple[str, str], Sequence[CompetenceBin]], *, title: str = ""
) -> Path:
    """Draw a heat map of the success for each skill (row) and world (column).

    A cell says its success and, below, how many episodes that is of. Cells that are not trusted are hatched.

    Args:
        file: the picture; its suffix chooses the format. Its folder is made if need be.
        maps: by skill and world.
        title: above it all.

    Returns:
        The file.

    Raises:
        ConfigError: if there is no map to draw, or no such format.
        HppError: if the file cannot be written.
    """
    if not maps:
        raise ConfigError("plot_competence: there is no map to draw.")
    skills, worlds = list(dict.fromkeys(s for s, _ in maps)), list(dict.fromkeys(w for _, w in maps))
    size = PANEL[0] * len(worlds) + 0.6, PANEL[1] * len(skills) + LEGEND
    figure = Figure(figsize=size, dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    panels: Any = figure.subplots(len(skills), len(worlds), squeeze=False)
    for row, skill in zip(panels, skills, strict=True):
        for axes, world in zip(row, worlds, strict=True):
            _draw(axes, maps[skill, world])
            axes.set_title(f"{skill} in {world}", fontsize=10)
    rule = f"hatched: not trusted (fewer than {TRUSTED_EPISODES} episodes, or success below {TRUSTED_SHARE})"
    figure.suptitle(fill(title, LINE * len(worlds)), fontsize=10)
    figure.supxlabel(f"success over episodes; {rule}", fontsize=8, color="#4a4f59")
    return save_figure(figure, file)


def _draw(axes: Any, bins: Sequence[CompetenceBin]) -> None:
    shades = colormaps[SHADES]
    for each in bins:
        column, row = DISTANCES.index(each.distance_low), CLEARANCES.index(each.clearance_low)
        place = (column, row)
        if each.success is None:
            axes.add_patch(Rectangle(place, 1, 1, facecolor="#f4f5f7", edgecolor="white"))
            continue
        color = shades(0.08 + 0.82 * each.success)
        axes.add_patch(Rectangle(place, 1, 1, facecolor=color, edgecolor="white"))
        ink = "white" if each.success > DARK else "#20242c"
        if not each.trusted:
            axes.add_patch(
                Rectangle(place, 1, 1, facecolor="none", edgecolor=ink, hatch="////", alpha=0.3, linewidth=0)
            )
        middle = column + 0.5
        axes.text(middle, row + 0.6, f"{each.success:.2f}", ha="center", va="center", color=ink, fontsize=10)
        axes.text(middle, row + 0.25, f"{each.episodes}", ha="center", va="center", color=ink, fontsize=7)
    axes.set(xlim=(0, len(DISTANCES) - 1), ylim=(0, len(CLEARANCES) - 1))
    axes.set_xticks(range(len(DISTANCES)), [f"{edge:g}" for edge in DISTANCES])
    axes.set_yticks(range(len(CLEARANCES)), [f"{edge:g}" for edge in CLEARANCES[:-1]] + ["∞"])
    axes.set_xlabel("distance to the goal [m]", fontsize=9)
    axes.set_ylabel("clearance of the task [m]", fontsize=9)
    axes.tick_params(length=0, labelsize=8)
    axes.spines[:].set_visible(False)
