"""The competence map: how well a skill does by goal distance and clearance, and where it may be trusted."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from hpp_framework.evaluation.navigation_tasks import CLEARANCES, DISTANCES, bin_of
from hpp_framework.evaluation.skill_score import SkillRow, score
from hpp_framework.utils.run_folder import write_csv

TRUSTED_SHARE, TRUSTED_EPISODES = 0.85, 20
"""PRM-RL connects two places if the skill gets from one to the other in at least 17 of 20 tries, success 0.85
(Faust et al. 2018). Here: a bin is trusted if its share of successes is at least 0.85, over 20 episodes or
more. Touching something is no failure; the share of clean successes stands beside it."""


@dataclass(frozen=True, kw_only=True)
class CompetenceBin:
    """Episodes of similar difficulty.

    Attributes:
        distance_low, distance_high: straight distance from start to goal in metres, the upper edge excluded.
        clearance_low, clearance_high: clearance in metres, the upper edge excluded; None for no upper edge.
        episodes: how many. The rest is None if there are none.
        success, success_low, success_high: share that succeeded, with its 95 % Wilson bounds.
        clean: share that succeeded without touching anything.
        collision: share that touched something.
        freeze: share that failed and stood still.
        spl: mean success weighted by path length.
        time_ratio: median of the successes' times over the time bound.
        trusted: whether at least 85 % of at least 20 episodes succeeded.
    """

    distance_low: float
    distance_high: float
    clearance_low: float
    clearance_high: float | None
    episodes: int
    success: float | None = None
    success_low: float | None = None
    success_high: float | None = None
    clean: float | None = None
    collision: float | None = None
    freeze: float | None = None
    spl: float | None = None
    time_ratio: float | None = None
    trusted: bool = False


def competence_map(rows: Sequence[SkillRow]) -> list[CompetenceBin]:
    """Sort episodes into bins, all of them, from near to far and, within that, from narrow to wide.

    Episodes nearer or farther than all bins are left out.

    Args:
        rows: of one skill, from however many worlds.
    """
    distance = np.array([row.distance_m for row in rows])
    clearance = np.array([row.clearance_m for row in rows])
    places = list(zip(*(part.tolist() for part in bin_of(distance, clearance)), strict=True))
    return [
        _bin(i, j, [row for row, place in zip(rows, places, strict=True) if place == (i, j)])
        for i in range(len(DISTANCES) - 1)
        for j in range(len(CLEARANCES) - 1)
    ]


def _bin(i: int, j: int, rows: Sequence[SkillRow]) -> CompetenceBin:
    edges: dict[str, Any] = {
        "distance_low": DISTANCES[i],
        "distance_high": DISTANCES[i + 1],
        "clearance_low": CLEARANCES[j],
        "clearance_high": CLEARANCES[j + 1] if math.isfinite(CLEARANCES[j + 1]) else None,
    }
    if not rows:
        return CompetenceBin(**edges, episodes=0)
    total = score(rows)
    return CompetenceBin(
        **edges, episodes=len(rows), success=_short(total.success), success_low=_short(total.success_low),
        success_high=_short(total.success_high), clean=_short(total.clean),
        collision=_short(total.collision), freeze=_short(total.freeze), spl=_short(total.spl),
        time_ratio=None if total.time_ratio_median is None else _short(total.time_ratio_median),
        trusted=len(rows) >= TRUSTED_EPISODES and total.success >= TRUSTED_SHARE,
    )  # fmt: skip


def _short(value: float) -> float:
    return round(value, 4)


def competence_card(rows: Sequence[SkillRow]) -> dict[str, Any]:
    """Return what the card beside a skill's weights carries; ``json.dumps`` takes it as it is.

    To make one, drive navigation tasks that fill the map and hand the episodes over::

        trial = Trial(episodes=600, goal_distance=(1.0, 15.0), clearance=0.05, draw="even", seed=seed)
        card = competence_card(skill_episodes(skill, robot, trial))

    Args:
        rows: of one skill and robot.

    Returns:
        ``"summary"``: the fields of :class:`SkillScore`; ``"worlds"``: their names; ``"trusted"``: the accept
        rule, share and episodes; ``"bins"``: the fields of each :class:`CompetenceBin` that has episodes.
    """
    summary = asdict(score(rows))
    return {
        "summary": {k: _short(v) if isinstance(v, float) else v for k, v in summary.items()},
        "worlds": sorted({row.world for row in rows}),
        "trusted": {"success": TRUSTED_SHARE, "episodes": TRUSTED_EPISODES},
        "bins": [asdict(each) for each in competence_map(rows) if each.episodes],
    }


def write_competence(file: Path, maps: Mapping[tuple[str, str], Sequence[CompetenceBin]]) -> None:
    """Write maps as one table, a row a bin; what a bin does not have is left empty.

    Args:
        file: the CSV file.
        maps: by skill and world.

    Raises:
        ConfigError: if the file cannot be written.
    """
    columns = ["skill", "world", *(field.name for field in fields(CompetenceBin))]
    rows = (
        {"skill": skill, "world": world, **asdict(each), "trusted": int(each.trusted)}
        for (skill, world), bins in maps.items()
        for each in bins
    )
    write_csv(file, columns, rows)
