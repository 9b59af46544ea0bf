"""Episodes from above, as the report shows them: small films, and pictures of all ways."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from hpp_framework.reproduction.report_episodes import ShownCell
from hpp_framework.reproduction.report_html import Markup, data_uri, join, tag
from hpp_framework.reproduction.report_names import planner_label, world_label
from hpp_framework.viz import marks
from hpp_framework.viz.backdrop import Image
from hpp_framework.viz.record import EpisodeRecord
from hpp_framework.viz.topdown import TopDown, close_view
from hpp_framework.viz.video import write_video

SIDE = 320
"""Pixels of a film."""
WAYS_SIDE = 480
FASTER = 2
"""Films run so many times as fast as the robots."""
LAST_FRAMES = 10
AROUND = 1.6
"""Ground shown around the robots, metres."""
STILL_QUALITY = 82
PALER = 0.25


def films(cell: ShownCell) -> Markup:
    """Return the ways of a cell's episodes, and films of the best, the median and the worst."""
    shown = [_ways(cell), *(_film(rank, record) for rank, record in cell.records.items())]
    title = f"{planner_label(cell.planner)} in {world_label(cell.world)}"
    return tag("div", tag("h4", title), tag("div", join(*shown), class_="films"))


def _film(rank: str, record: EpisodeRecord) -> Markup:
    about = record.about
    ended = f"met after {about['time_s']:.1f} s" if about["success"] else "did not meet"
    frames = list(_frames(record))
    alt = (
        f"Film from above: {rank} episode of {planner_label(about['planner'])} in "
        f"{world_label(about['world'])}, number {about['episode']}; the robots {ended}."
    )
    video = tag(
        "video", src=data_uri(_encoded(frames, FASTER / record.period), "video/mp4"),
        poster=_picture(frames[-1]), width=str(SIDE), height=str(SIDE), controls=True, muted=True, loop=True,
        playsinline=True, preload="metadata", aria_label=alt,
    )  # fmt: skip
    return tag("figure", video, tag("figcaption", tag("b", rank), f" {ended}, episode {about['episode']}"))


def _frames(record: EpisodeRecord) -> Iterator[Image]:
    """Draw every control step, and the last one for longer."""
    view = close_view(record.ground, record.poses, AROUND)
    top = TopDown(record.ground, record.robots, size=(SIDE, SIDE), view=view)
    goals = record.goals()
    frame: Image | None = None
    for step, poses in enumerate(record.poses):
        frame = top.frame(
            poses, goals=goals[step], trails=record.poses[: step + 1], clock=step * record.period
        )
        yield frame
    if frame is not None:
        yield from [frame] * LAST_FRAMES


def _ways(cell: ShownCell) -> Markup:
    """Draw where everybody drove in all episodes that have the same world."""
    record = next(iter(cell.records.values()))
    every = cell.ways[np.isfinite(cell.ways)].reshape(-1, 2)
    view = close_view(record.ground, every, AROUND)
    top = TopDown(record.ground, record.robots, size=(WAYS_SIDE, WAYS_SIDE), view=view)
    image = top.empty()
    for episode in cell.ways:
        for place, color in enumerate(top.colors):
            path = episode[np.isfinite(episode[:, place, 0]), place].astype(np.float64)
            marks.draw_path(image, top.canvas, path, marks.mix(color, PALER), 2)
            end = [round(each) for each in (top.canvas.pixels(path[-1]) / (1 << top.canvas.SHIFT)).tolist()]
            cv2.circle(image, end, 4, marks.mix(color, -PALER), -1, cv2.LINE_AA)
    count = len(cell.ways)
    alt = (
        f"The ways of {count} episodes of {planner_label(cell.planner)} in {world_label(cell.world)} from "
        "above; dots mark where robots ended."
    )
    picture = tag("img", src=_picture(image), alt=alt, width=str(WAYS_SIDE), height=str(WAYS_SIDE))
    return tag("figure", picture, tag("figcaption", tag("b", "ways"), f" of {count} episodes, ends as dots"))


def _picture(image: Image) -> str:
    encoded = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, STILL_QUALITY])[1]
    return data_uri(encoded.tobytes(), "image/jpeg")


def _encoded(frames: list[Image], fps: float) -> bytes:
    with tempfile.TemporaryDirectory() as place:
        return write_video(Path(place) / "film.mp4", frames, fps).read_bytes()
