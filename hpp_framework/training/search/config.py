"""What to search, and how far."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True, kw_only=True)
class SearchConfig:
    """What to search, and how far.

    Attributes:
        skill: registered skill that declares a search.
        robot: registered robot.
        out: folder for trials, journal and report.
        steps: control steps a trial is trained for.
        trials: of each phase, the baseline among them.
        workers: trials side by side, one torch thread each.
        seed: of what is tried, of every training and of the judging.
        settings: of the trainer's recipe by dotted name; where the search starts, or else held.
        init: weights that every trial starts from, or None; then the shape of the network cannot be searched.
        rungs: shares of ``steps`` at which poor trials are stopped, rising; see :meth:`PhaseStudy.reach`.
    """

    skill: str
    robot: str
    out: Path
    steps: int = 1_000_000
    trials: tuple[int, ...] = (12, 8)
    workers: int = 1
    seed: int = 1
    settings: Mapping[str, Any] = field(default_factory=lambda: dict[str, Any]())
    init: Path | None = None
    rungs: tuple[float, ...] = ()
