"""Results in the layout of marl-eval (Gorsane et al. 2022), the common tool for cooperative MARL results.

"Towards a Standardised Performance Evaluation Protocol for Cooperative MARL", NeurIPS 2022;
https://github.com/instadeepai/marl-eval.
"""

from __future__ import annotations

import math
from typing import Any

from hpp_framework.evaluation.rows import EpisodeRow
from hpp_framework.evaluation.summary import Results

METRICS = (
    "success", "rpl", "first_contact", "collided", "final_distance_m", "goal_gap_m", "side_flips", "chase"
)  # fmt: skip
"""Columns of ``episodes.csv`` that every episode has a number for."""


def marl_eval_layout(results: Results, task: str) -> dict[str, Any]:
    """Return results as ``{environment: {task: {algorithm: {run: {...}}}}}``.

    The environment is the framework's task, tasks are worlds, algorithms are planners. Each episode is a
    run: nothing is trained in an evaluation, so what is independent, and may be drawn again, is an episode.
    Its one step of training, 0, and the absolute metrics are the same.

    Args:
        results: all episodes.
        task: of the team, the name of the environment.
    """
    metrics = [name for name in METRICS if all(math.isfinite(getattr(row, name)) for row in results.rows)]
    return {
        task: {
            world: {
                planner: {
                    f"episode_{row.episode}": _run(row, metrics) for row in results.cell(world, planner)
                }
                for planner in results.planners
            }
            for world in results.worlds
        }
    }


def _run(row: EpisodeRow, metrics: list[str]) -> dict[str, Any]:
    values = {name: [getattr(row, name)] for name in metrics}
    return {"step_1": {"step_count": 0, **values}, "absolute_metrics": values}
