"""Keeps chosen episodes of an evaluation: run again as they were, and written for ``hpp inspect``."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

from hpp_framework.evaluation import folder
from hpp_framework.evaluation.experiment import Experiment, check_experiment
from hpp_framework.evaluation.replay import describe, replay
from hpp_framework.evaluation.rows import EpisodeRow
from hpp_framework.evaluation.table import read_rows
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.progress import Progress
from hpp_framework.viz.record_file import save_record
from hpp_framework.worlds.loader import resolve_world

SAVED = "saved"
EXTREMES = 3
"""Episodes that ``best`` and ``worst`` keep of each cell."""

Rows = Sequence[EpisodeRow]


def _by_merit(rows: Rows) -> list[EpisodeRow]:
    """Return rows from best to worst: by RPL, failures by how far apart the robots ended."""
    # failures have no time, and NaN has no place in an order
    return sorted(
        rows, key=lambda row: (-row.success, -_known(row.rpl), _known(row.time_s), row.final_distance_m)
    )


def _known(value: float) -> float:
    return 0.0 if math.isnan(value) else value


CHOICES: dict[str, Callable[[Rows], Rows]] = {
    "failures": lambda rows: [row for row in rows if not row.success],
    "touched": lambda rows: [row for row in rows if row.collided],
    "best": lambda rows: _by_merit(rows)[:EXTREMES],
    "median": lambda rows: _by_merit(rows)[len(rows) // 2 :][:1],
    "worst": lambda rows: _by_merit(rows)[::-1][:EXTREMES],
    "all": lambda rows: rows,
}
"""Which episodes of a cell a word stands for."""


def check_choice(text: str, episodes: int) -> None:
    """Refuse what names no episodes, before anything runs.

    Args:
        text: words of :data:`CHOICES` and numbers of episodes, separated by commas.
        episodes: a cell.

    Raises:
        ConfigError: if a word is unknown or there is no such episode.
    """
    for word in text.split(","):
        if word.strip() in CHOICES:
            continue
        if not word.strip().isdecimal():
            raise ConfigError(f"--save '{word}': give episode numbers, or some of {', '.join(CHOICES)}.")
        if int(word) >= episodes:
            raise ConfigError(f"--save {word}: there is no such episode of {episodes}; the first is 0.")


def choose(text: str, rows: Rows) -> list[int]:
    """Return the numbers of the chosen episodes of a cell, in order.

    Args:
        text: as :func:`check_choice` takes it.
        rows: of the cell.
    """
    found: set[int] = set()
    for word in map(str.strip, text.split(",")):
        found |= {row.episode for row in CHOICES[word](rows)} if word in CHOICES else {int(word)}
    return sorted(found)


def save_episodes(
    experiment: Experiment, out: Path, text: str, *, progress: Progress = lambda *_: None
) -> list[Path]:
    """Run the chosen episodes of a finished evaluation again and write those that are not there yet.

    Args:
        experiment: what was evaluated.
        out: its run folder.
        text: as :func:`check_choice` takes it, for each world and planner.
        progress: called with (cell, episodes done, episodes in all).

    Returns:
        The files of all chosen episodes, ``saved/WORLD/PLANNER/NUMBER.npz``.

    Raises:
        ConfigError: if a file cannot be written.
    """
    rows = read_rows(out / folder.EPISODES, EpisodeRow)
    files: list[Path] = []
    for world in experiment.worlds:
        for planner in experiment.planners:
            cell = [row for row in rows if (row.world, row.planner) == (world, planner)]
            cell = [row for row in cell if row.episode < experiment.episodes]
            place = out / SAVED / _file_name(world) / _file_name(planner)
            wanted = {number: place / f"{number:05d}.npz" for number in choose(text, cell)}
            missing = {number: file for number, file in wanted.items() if not file.exists()}
            one = replace(experiment, worlds=(world,), planners=(planner,))
            _save_cell(one, missing, partial(progress, f"saving {world} / {planner}"))
            files += wanted.values()
    return files


def _save_cell(one: Experiment, files: Mapping[int, Path], progress: Callable[[int, int], None]) -> None:
    factory = resolve_world(one.worlds[0])
    configs = check_experiment(one, {one.worlds[0]: factory})
    done = 0
    for shown in replay(one, factory, list(files)):
        for number in shown.recorders:
            which = {"episodes": 1, "episode": number, "of": one.episodes}
            config = folder.record(folder.RUN, {**asdict(one), **which}, configs)
            save_record(files[number], shown.record(number, describe(config)))
            done += 1
        progress(done, len(files))


def _file_name(name: str) -> str:
    """Return a name that every file system takes, e.g. ``hpp-hysteresis=0`` for ``hpp:hysteresis=0``."""
    return re.sub(r"[^A-Za-z0-9._=-]+", "-", name).strip("-.")
