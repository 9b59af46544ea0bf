"""Chosen episodes of a comparison from above: films, and pictures of the paths of many others.

A cell that is shown runs once more, exactly as it was; what was seen is kept in ``report/episodes/`` of the
reproduction, so that writing the report again takes seconds.
"""

from __future__ import annotations

import base64
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float

from hpp_framework.evaluation import folder
from hpp_framework.evaluation.experiment import Experiment, read_experiment
from hpp_framework.evaluation.replay import Replay, replay
from hpp_framework.evaluation.rows import EpisodeRow
from hpp_framework.evaluation.saving import CHOICES
from hpp_framework.evaluation.table import read_rows
from hpp_framework.reproduction.report.names import anchor, name_of, planner_label, privileged, world_label
from hpp_framework.reproduction.report.results import Ran
from hpp_framework.utils.run_folder import replacing
from hpp_framework.viz import marks
from hpp_framework.viz.backdrop import Image
from hpp_framework.viz.record import EpisodeRecord
from hpp_framework.viz.record_file import load_record, save_record
from hpp_framework.viz.topdown import TopDown, close_view
from hpp_framework.viz.video import write_video
from hpp_framework.worlds.loader import resolve_world

REPORT, EPISODES, PATHS = "report", "episodes", "paths.npy"
RANKS = ("best", "worst", "median")
"""An episode that has several ranks is shown once, for the first."""
PATHS_SHOWN = 40
"""Episodes whose paths are drawn over each other; more would hide the floor."""
FILM_SIDE, PATHS_SIDE = 320, 480
"""Pixels of a film, and of a picture of paths."""
FASTER, LAST_FRAMES = 2, 10
"""Films run so many times as fast as the robots, and show their last frame so often."""
AROUND = 1.6
"""Ground shown around the robots, metres."""
STILL_QUALITY, PALER = 82, 0.25

Paths = Float[np.ndarray, "e t n 2"]
Say = Callable[[str], None]


class Picture(NamedTuple):
    """A film, or a still if it has no poster: its address, which holds it, and what is said of it."""

    source: str
    rank: str
    caption: str
    alt: str
    poster: str = ""


class Shown(NamedTuple):
    """The pictures of one planner in one world: paths first, then films."""

    world: str
    title: str
    pictures: list[Picture]


def shown_cells(ran: Ran, out: Path, say: Say) -> list[Shown]:
    """Return the cells whose episodes are shown: the first planner and the best baseline of each world.

    Args:
        ran: the main comparison.
        out: folder of the reproduction.
        say: called with a line for each cell that runs once more.
    """
    rows = read_rows(ran.folder / folder.EPISODES, EpisodeRow)
    experiment = read_experiment(ran.folder / folder.CONFIG, folder.EVALUATE)
    cells: list[Shown] = []
    for world in ran.worlds:
        for planner in _chosen_planners(ran, world):
            own = [row for row in rows if (row.world, row.planner) == (world, planner)]
            if own:
                only = replace(experiment, worlds=(world,), planners=(planner,), episodes=len(own))
                place = out / REPORT / EPISODES / anchor(f"{world} {planner}")
                records, paths = _records(only, ranked(own), place, say)
                title = f"{planner_label(planner)} in {world_label(world)}"
                films = [_film(rank, record, title) for rank, record in records.items()]
                still = _draw_paths(paths, next(iter(records.values())), title)
                cells.append(Shown(world, title, [still, *films]))
    return cells


def ranked(rows: Sequence[EpisodeRow]) -> dict[str, int]:
    """Return the number of the best, the median and the worst episode; each episode has one rank only."""
    found: dict[str, int] = {}
    for rank in RANKS:
        number = CHOICES[rank](rows)[0].episode
        found |= {rank: number} if number not in found.values() else {}
    return dict(sorted(found.items()))


def _chosen_planners(ran: Ran, world: str) -> list[str]:
    """Return the first planner, and the baseline with the most successes, then the best RPL."""
    first = ran.planners[0]
    baselines = [
        cell
        for cell in ran.rows("cells", world=world)
        if not privileged(cell["planner"]) and name_of(cell["planner"]) != name_of(first)
    ]
    best = max(baselines, key=lambda cell: (cell["success"], cell["rpl"] or 0), default=None)
    return [first, best["planner"]] if best else [first]


def _records(
    experiment: Experiment, numbers: dict[str, int], place: Path, say: Say
) -> tuple[dict[str, EpisodeRecord], Paths]:
    """Return chosen episodes by rank and the paths of many, from their files or by running them once more."""
    world, planner = experiment.worlds[0], experiment.planners[0]
    files = {rank: place / f"{number:05d}.npz" for rank, number in numbers.items()}
    if not (place / PATHS).exists() or not all(file.exists() for file in files.values()):
        say(f"running {planner} in {world} once more to film it")
        about = {"world": world, "planner": planner, "preset": experiment.preset, "team": experiment.team,
                 "backend": experiment.backend, "seed": experiment.seed}  # fmt: skip
        for batch in replay(experiment, resolve_world(world), list(numbers.values())):
            for number in batch.recorders:
                save_record(place / f"{number:05d}.npz", batch.record(number, {**about, "episode": number}))
            with replacing(place / PATHS) as temporary, temporary.open("wb") as stream:
                np.save(stream, _paths(batch), allow_pickle=False)
    return {rank: load_record(file) for rank, file in files.items()}, np.load(place / PATHS)


def _paths(batch: Replay) -> Paths:
    """Return the team's positions in the first episodes that have the same world; NaN after their end."""
    first, *others = batch.worlds.values()
    same = [0, *(i for i, world in enumerate(others, 1) if world == first)][:PATHS_SHOWN]
    poses = batch.episodes.poses[same, :, :, :2].numpy().astype(np.float32)
    after = np.arange(poses.shape[1]) > batch.episodes.last_step()[same].numpy()[:, None]
    poses[after] = np.nan
    return poses


def _film(rank: str, record: EpisodeRecord, title: str) -> Picture:
    """Film every control step, and the last one for longer."""
    about, number = record.about, record.about["episode"]
    ended = f"met after {about['time_s']:.1f} s" if about["success"] else "did not meet"
    view = close_view(record.ground, record.poses, AROUND)
    top = TopDown(record.ground, record.robots, size=(FILM_SIDE, FILM_SIDE), view=view)
    frames = [
        top.frame(
            poses,
            goals=goals,
            trails=record.poses[: step + 1],
            clock=step * record.period,
            people=None if record.people is None else record.people[step],
            moving=None if record.moving is None else record.moving[step],
        )
        for step, (poses, goals) in enumerate(zip(record.poses, record.goals(), strict=True))
    ]
    with tempfile.TemporaryDirectory() as place:
        held = frames + frames[-1:] * LAST_FRAMES
        film = write_video(Path(place) / "film.mp4", held, FASTER / record.period).read_bytes()
    alt = f"Film from above: {rank} episode of {title}, number {number}; the robots {ended}."
    return Picture(_uri(film, "video/mp4"), rank, f"{ended}, episode {number}", alt, _still(frames[-1]))


def _draw_paths(paths: Paths, record: EpisodeRecord, title: str) -> Picture:
    """Draw where robots drove in all episodes that have the same world."""
    view = close_view(record.ground, paths[np.isfinite(paths)].reshape(-1, 2), AROUND)
    top = TopDown(record.ground, record.robots, size=(PATHS_SIDE, PATHS_SIDE), view=view)
    image = top.empty()
    for episode in paths:
        for place, color in enumerate(top.colors):
            path = episode[np.isfinite(episode[:, place, 0]), place].astype(np.float64)
            marks.draw_path(image, top.canvas, path, marks.mix(color, PALER), 2)
            end = [round(each) for each in (top.canvas.pixels(path[-1]) / (1 << top.canvas.SHIFT)).tolist()]
            cv2.circle(image, end, 4, marks.mix(color, -PALER), -1, cv2.LINE_AA)
    alt = f"The paths of {len(paths)} episodes of {title} from above; dots mark where robots ended."
    return Picture(_still(image), "paths", f"of {len(paths)} episodes, ends as dots", alt)


def _still(image: Image) -> str:
    encoded = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, STILL_QUALITY])[1]
    return _uri(encoded.tobytes(), "image/jpeg")


def _uri(content: bytes, kind: str) -> str:
    """Return a file as an address that holds it, e.g. of kind ``"image/png"``."""
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"
