"""Pictures about predictors: errors by horizon and world, calibration, losses. Drawn without a display."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from hpp_framework.evaluation.figures import save_figure
from hpp_framework.evaluation.predictor_score import ALL, ALL_WORLDS, LEVELS, ErrorRow, coverage
from hpp_framework.evaluation.predictor_trials import Misses

COLORS = ("#2364aa", "#d1495b", "#3a9d23", "#8e5ea2", "#ea7317", "#00798c", "#6b4226")
PLAIN = {"constant-velocity": ("#8a8f99", "--"), "empty-world": ("#20242c", ":")}
"""Colour and line of models that have learnt nothing."""
PANEL = (5.2, 4.1)
"""Inches per panel."""
ROLES = {"self": "of itself", "other": "of the other robot"}
BAR_SECONDS = 5.0
"""Horizon of the bars by world, or the nearest that a predictor has."""
Row = ErrorRow


def plot_horizons(file: Path, rows: Sequence[Row], *, title: str = "") -> Path:
    """Draw the mean error over the horizon, with its 95 % interval, a panel a role.

    Args:
        file: the picture; its suffix chooses the format.
        rows: of all predictors; those of single robots are left out.
        title: above it all.

    Raises:
        HppError: if the file cannot be written, as in the other pictures.
    """
    pooled = [row for row in rows if row.agent == ALL]
    world = ALL_WORLDS if any(row.world == ALL_WORLDS for row in pooled) else pooled[0].world
    pooled = [row for row in pooled if row.world == world]
    figure, panels = _panels(len(_roles(pooled)), title)
    styles = _styles(pooled)
    for axes, role in zip(panels, _roles(pooled), strict=True):
        for name, (color, line) in styles.items():
            own = [row for row in pooled if (row.predictor, row.role) == (name, role)]
            seconds = [row.seconds for row in own]
            axes.plot(seconds, [row.mean_m for row in own], line, color=color, label=name, marker=_dot(own))
            low, high = [row.mean_low_m for row in own], [row.mean_high_m for row in own]
            axes.fill_between(seconds, low, high, color=color, alpha=0.15, linewidth=0)
        axes.set(title=f"prediction {ROLES[role]}, {world}", xlabel="seconds ahead", yscale="log")
        axes.set_ylabel("mean position error [m]")
        axes.grid(which="major", alpha=0.3)
    _legend(figure, panels[0])
    return save_figure(figure, file)


def plot_worlds(file: Path, rows: Sequence[Row], *, title: str = "") -> Path:
    """Draw the mean error at :data:`BAR_SECONDS` by world; arguments as :func:`plot_horizons`."""
    pooled = [row for row in rows if row.agent == ALL and row.world != ALL_WORLDS]
    worlds = list(dict.fromkeys(row.world for row in pooled))
    figure, panels = _panels(len(_roles(pooled)), title)
    styles = _styles(pooled)
    width = 0.8 / len(styles)
    for axes, role in zip(panels, _roles(pooled), strict=True):
        for place, (name, (color, _)) in enumerate(styles.items()):
            bars = [_nearest(pooled, name, role, world) for world in worlds]
            at = [index + (place - (len(styles) - 1) / 2) * width for index in range(len(worlds))]
            spread = [
                [row.mean_m - row.mean_low_m for row in bars],
                [row.mean_high_m - row.mean_m for row in bars],
            ]
            axes.bar(at, [row.mean_m for row in bars], width, color=color, label=name, yerr=spread,
                     error_kw={"linewidth": 0.8, "ecolor": "#20242c"})  # fmt: skip
        seconds = sorted({_nearest(pooled, name, role, worlds[0]).seconds for name in styles})
        axes.set_title(f"prediction {ROLES[role]}, {' and '.join(f'{s:g}' for s in seconds)} s ahead")
        axes.set_xticks(range(len(worlds)), [Path(world).stem for world in worlds])
        axes.set_ylabel("mean position error [m]")
        axes.grid(axis="y", alpha=0.3)
    _legend(figure, panels[0])
    return save_figure(figure, file)


def plot_calibration(file: Path, found: Mapping[tuple[str, str, str], Misses], *, title: str = "") -> Path:
    """Draw how often the truth lay in regions of nominal probability, a panel a role.

    Args:
        file: the picture; its suffix chooses the format.
        found: misses by predictor, world and role; predictors without deviations are left out.
        title: above it all.
    """
    world = ALL_WORLDS if any(key[1] == ALL_WORLDS for key in found) else next(iter(found))[1]
    shown = {k: miss for k, miss in found.items() if k[1] == world and miss.std is not None}
    roles = list(dict.fromkeys(role for _, _, role in shown))
    figure, panels = _panels(len(roles), title)
    for axes, role in zip(panels, roles, strict=True):
        axes.plot([0, 1], [0, 1], "--", color="#8a8f99", linewidth=1, label="as sure as right")
        mine = [(key[0], miss) for key, miss in shown.items() if key[2] == role]
        for color, (name, miss) in zip(COLORS, mine, strict=False):
            shares = [float(coverage(miss, level).mean()) for level in LEVELS]
            axes.plot(LEVELS, shares, color=color, marker=".", label=name)
        axes.set(title=f"prediction {ROLES[role]}, {world}", xlim=(0, 1), ylim=(0, 1), aspect="equal")
        axes.set(xlabel="probability that the region should hold", ylabel="share of true positions in it")
        axes.grid(alpha=0.3)
    panels[0].legend(fontsize=8, frameon=False)
    return save_figure(figure, file)


def plot_losses(file: Path, cards: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> Path | None:
    """Draw the training losses that cards hold, one panel per kind, as figure 10 of the paper.

    Args:
        file: the picture; its suffix chooses the format.
        cards: by kind and model.

    Returns:
        The file, or None if no card holds a curve.
    """
    curves = {
        kind: {model: card["curve"] for model, card in models.items() if card.get("curve")}
        for kind, models in cards.items()
    }
    curves = {kind: models for kind, models in curves.items() if models}
    if not curves:
        return None
    figure, panels = _panels(len(curves), "training loss, each point a mean over 500 gradient steps")
    for axes, (kind, models) in zip(panels, curves.items(), strict=True):
        for color, (model, curve) in zip(COLORS, sorted(models.items(), reverse=True), strict=False):
            axes.plot([p[0] for p in curve], [p[1] for p in curve], color=color, label=model)
        axes.set(title=kind, xlabel="gradient step", ylabel="loss, in the kind's own units")
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8, frameon=False)
    return save_figure(figure, file)


def _panels(count: int, title: str) -> tuple[Figure, list[Any]]:
    figure = Figure(figsize=(PANEL[0] * count, PANEL[1]), dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=10)
    panels: Any = figure.subplots(1, count, squeeze=False)
    for axes in panels[0]:
        axes.tick_params(labelsize=8)
        axes.spines[["top", "right"]].set_visible(False)
    return figure, list(panels[0])


def _legend(figure: Figure, axes: Any) -> None:
    """Write what the panels' colours mean below them all."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=8, frameon=False)


def _roles(rows: Sequence[Row]) -> list[str]:
    return [role for role in ROLES if any(row.role == role for row in rows)]


def _styles(rows: Sequence[Row]) -> dict[str, tuple[str, str]]:
    """Return a colour and one line per predictor."""
    names = list(dict.fromkeys(row.predictor for row in rows))
    learned = [name for name in names if name not in PLAIN]
    styles = {name: (COLORS[index % len(COLORS)], "-") for index, name in enumerate(learned)}
    return {name: styles.get(name) or PLAIN[name] for name in names}


def _dot(rows: Sequence[Row]) -> str | None:
    return "." if len(rows) <= 20 else None


def _nearest(rows: Sequence[Row], name: str, role: str, world: str) -> Row:
    own = [row for row in rows if (row.predictor, row.role, row.world) == (name, role, world)]
    return min(own, key=lambda row: abs(row.seconds - BAR_SECONDS))
