"""Chosen episodes of a comparison: which are shown, their records, and the ways of all others.

A cell that is shown runs once more, exactly as it was; what was seen is kept in ``report/episodes/`` of the
reproduction, so that writing the report again takes seconds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from hpp_framework.config.planner_choice import parse_planner
from hpp_framework.evaluation import folder
from hpp_framework.evaluation.experiment import Experiment, read_experiment
from hpp_framework.evaluation.replay import Replay, replay
from hpp_framework.evaluation.rows import EpisodeRow
from hpp_framework.evaluation.saving import CHOICES
from hpp_framework.reproduction.report_data import REPORT, Ran
from hpp_framework.reproduction.report_html import anchor
from hpp_framework.reproduction.report_names import privileged
from hpp_framework.utils.run_folder import replacing
from hpp_framework.viz.record import EpisodeRecord
from hpp_framework.viz.record_file import load_record, save_record
from hpp_framework.worlds.loader import resolve_world

EPISODES, WAYS = "episodes", "ways.npy"
RANKS = ("best", "median", "worst")
WAYS_SHOWN = 40
"""Episodes whose ways are drawn over each other; more would hide the floor."""

Say = Callable[[str], None]


@dataclass(frozen=True, kw_only=True)
class ShownCell:
    """One planner in one world.

    Attributes:
        world: its name.
        planner: its name.
        records: of the best, median and worst episode.
        ways: where everybody was by control step, of the first episodes; NaN after the end, metres.
    """

    world: str
    planner: str
    records: dict[str, EpisodeRecord]
    ways: Float[np.ndarray, "e t n 2"]


def shown_cells(ran: Ran, out: Path, say: Say) -> list[ShownCell]:
    """Return the cells whose episodes are shown: the first planner and the best baseline of each world.

    Args:
        ran: the main comparison.
        out: folder of the reproduction.
        say: called with a line for each cell that runs once more.
    """
    rows = ran.episodes()
    experiment = read_experiment(ran.folder / folder.CONFIG, folder.EVALUATE)
    cells: list[ShownCell] = []
    for world in ran.worlds:
        for planner in _chosen_planners(ran, world):
            own = [row for row in rows if (row.world, row.planner) == (world, planner)]
            if own:
                only = replace(experiment, worlds=(world,), planners=(planner,), episodes=len(own))
                place = out / REPORT / EPISODES / anchor(f"{world} {planner}")
                cells.append(_cell(only, ranked(own), place, say))
    return cells


def ranked(rows: Sequence[EpisodeRow]) -> dict[str, int]:
    """Return the number of the best, the median and the worst episode; one episode has one rank only."""
    found = {rank: CHOICES[rank](rows)[0].episode for rank in RANKS}
    return {rank: number for rank, number in found.items() if rank == "best" or number != found["best"]}


def _chosen_planners(ran: Ran, world: str) -> list[str]:
    """Return the first planner, and the baseline with the most successes, then the best RPL."""
    first, *others = ran.planners
    method = parse_planner(first).name
    cells = {planner: ran.cell(world, planner) for planner in others if not privileged(planner)}
    baselines = [
        (planner, cell) for planner, cell in cells.items() if cell and parse_planner(planner).name != method
    ]
    best = max(baselines, key=lambda pair: (pair[1]["success"], pair[1]["rpl"] or 0), default=None)
    return [first, best[0]] if best else [first]


def _cell(experiment: Experiment, numbers: dict[str, int], place: Path, say: Say) -> ShownCell:
    world, planner = experiment.worlds[0], experiment.planners[0]
    files = {rank: place / f"{number:05d}.npz" for rank, number in numbers.items()}
    if not (place / WAYS).exists() or not all(file.exists() for file in files.values()):
        say(f"running {planner} in {world} once more to film it")
        about = {"world": world, "planner": planner, "preset": experiment.preset, "team": experiment.team,
                 "backend": experiment.backend, "seed": experiment.seed}  # fmt: skip
        factory = resolve_world(world)
        for batch in replay(experiment, factory, list(numbers.values())):
            for number in batch.recorders:
                save_record(place / f"{number:05d}.npz", batch.record(number, {**about, "episode": number}))
            with replacing(place / WAYS) as temporary, temporary.open("wb") as stream:
                np.save(stream, _ways(batch), allow_pickle=False)
    records = {rank: load_record(file) for rank, file in files.items()}
    return ShownCell(world=world, planner=planner, records=records, ways=np.load(place / WAYS))


def _ways(batch: Replay) -> Float[np.ndarray, "e t n 2"]:
    """Return where everybody was in the first episodes that have the same world; NaN after their end."""
    first, *others = batch.worlds.values()
    same = [0, *(i for i, world in enumerate(others, 1) if world == first)][:WAYS_SHOWN]
    poses = batch.episodes.poses[same, :, :, :2].numpy().astype(np.float32)
    after = np.arange(poses.shape[1]) > batch.episodes.last_step()[same].numpy()[:, None]
    poses[after] = np.nan
    return poses
