"""The learning curve of a skill, as a picture."""

from __future__ import annotations

import json
from pathlib import Path

from matplotlib.figure import Figure

from hpp_framework.training.ppo import CURVE

PICTURE = "learning_curve.png"


def draw_learning_curve(out: Path) -> Path:
    """Draw success, touching and the share of worlds in use over the steps of a training.

    Args:
        out: folder of the training; its ``curve.jsonl`` is read.

    Returns:
        The picture.
    """
    rows = [json.loads(line) for line in (out / CURVE).read_text().splitlines()]
    # an interrupted training may have gone over some steps twice; the last time counts
    by_steps = {row["steps"]: row for row in rows}
    steps = sorted(by_steps)
    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.subplots()
    for name, label, color, style in (
        ("success", "success, last 2,000 episodes", "tab:blue", "-"),
        ("touch_share", "share of steps in contact", "tab:red", "-"),
        ("worlds", "share of worlds, easiest first", "0.6", "--"),
    ):
        axes.plot(
            [step / 1e6 for step in steps], [by_steps[step][name] for step in steps], style, color=color,
            label=label,
        )  # fmt: skip
    axes.set(xlabel="million control steps", ylim=(0, 1.02), title=f"learning curve, {out.name}")
    axes.grid(alpha=0.3)
    axes.legend(loc="center right")
    file = out / PICTURE
    figure.savefig(file, dpi=120)
    return file
