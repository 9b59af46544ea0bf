"""The film of an episode: the true world, and beside it what each robot sees, weighs and imagines."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
import numpy.typing as npt

from hpp_framework.viz.decisions import Decision, decisions, goal_disagreement
from hpp_framework.viz.ego_view import EgoView
from hpp_framework.viz.lettering import PAPER, legend, strip, strip_height
from hpp_framework.viz.marks import robot_colors
from hpp_framework.viz.record import EpisodeRecord
from hpp_framework.viz.topdown import TopDown, close_view

FRAMES_PER_STEP = 2
LAST_FRAMES = 15
HEIGHT = 800
"""Pixels of the views with their captions, the legend below left out."""

SHARED_WIDTH = 720
MINDS_WIDTH = 1200
CAPTION_LINES, BORDER = 2, 2
MOST_MINDS = 6
"""Robots whose own view is shown; more would not be readable."""

AROUND = 2.2
"""Ground shown beyond where robots ever were, metres."""

Frame = npt.NDArray[np.uint8]
Poses = npt.NDArray[np.floating]


Camera = Callable[[Poses, Poses, Poses | None, float], Frame]
"""Draws the true world at poses (n, 3) with all goals (n, 2), people (p, 4) and a time in seconds."""

CameraMaker = Callable[[tuple[int, int]], Camera | None]
"""Makes a camera for pictures of (width, height), or none if there is no way to draw in 3-D."""


def frame_count(record: EpisodeRecord) -> int:
    """Return how many frames the film of an episode has."""
    return FRAMES_PER_STEP * (len(record.poses) - 1) + 1 + LAST_FRAMES


def frames(record: EpisodeRecord, make_camera: CameraMaker = lambda _: None) -> Iterator[Frame]:
    """Yield the frames of an episode, :data:`FRAMES_PER_STEP` a control step.

    Args:
        record: the episode.
        make_camera: for the shared view; without a camera it is seen from above.
    """
    film = _Film(record, make_camera)
    frame: Frame | None = None
    last = len(record.poses) - 1
    for step in range(last + 1):
        stills = [ego.still(step) for ego in film.views]
        for part in range(FRAMES_PER_STEP if step < last else 1):
            frame = film.frame(step, part / FRAMES_PER_STEP, stills)
            yield frame
    if frame is not None:
        yield from [frame] * LAST_FRAMES


class _Film:
    """Everything that is made once for a film."""

    def __init__(self, record: EpisodeRecord, make_camera: CameraMaker) -> None:
        self.record = record
        self.colors = robot_colors(record.robots)
        self.view = close_view(record.ground, record.poses, AROUND, record.goals())
        shared = (SHARED_WIDTH, HEIGHT - strip_height(CAPTION_LINES))
        self.camera = make_camera(shared)
        self.top = TopDown(record.ground, record.robots, size=shared, view=self.view)
        shown = min(len(record.agents), MOST_MINDS)
        self.columns, self.rows = _grid(shown)
        width = min(MINDS_WIDTH, HEIGHT * self.columns) // self.columns
        height = HEIGHT // self.rows - strip_height(CAPTION_LINES)
        self.views = [EgoView(record, i, size=(width, height), view=self.view) for i in range(shown)]
        spare = shown < self.columns * self.rows
        self.above = (
            TopDown(record.ground, record.robots, size=(width, height), view=self.view) if spare else None
        )
        self.goals = record.goals()
        self.legend = legend(SHARED_WIDTH + width * self.columns)
        self.decided = {(d.agent, d.plan.step): d for d in decisions(record)}

    def frame(self, step: int, share: float, stills: list[Frame]) -> Frame:
        """Draw one moment between a step and the next."""
        poses = _between(self.record.poses, step, share)
        pairs = zip(self.views, stills, strict=True)
        tiles = [self._ego_view(ego, still, step, share) for ego, still in pairs]
        tiles += [self._spare(poses, step, share, tiles[0])] * (self.columns * self.rows - len(tiles))
        rows = [np.hstack(tiles[r * self.columns : (r + 1) * self.columns]) for r in range(self.rows)]
        picture = np.hstack([self._shared(poses, step, share), np.vstack(rows)])
        return np.vstack([picture, self.legend])

    def _shared(self, poses: Poses, step: int, share: float) -> Frame:
        goals = self.goals[step]
        if self.camera is None:
            image = self._above(self.top, poses, step, share)
        else:
            people = None if self.record.people is None else _between(self.record.people, step, share)
            image = self.camera(poses, goals, people, (step + share) * self.record.period)
        return np.vstack([strip(SHARED_WIDTH, self._shared_lines(poses, step, share)), image])

    def _above(self, view: TopDown, poses: Poses, step: int, share: float) -> Frame:
        """Draw all that is true from above."""
        record = self.record
        return view.frame(
            poses, goals=self.goals[step], trails=record.poses[: step + 1],
            people=None if record.people is None else _between(record.people, step, share),
            moving=None if record.moving is None else record.moving[step],
        )  # fmt: skip

    def _spare(self, poses: Poses, step: int, share: float, like: Frame) -> Frame:
        """Draw the team from above where a panel is free."""
        if self.above is None:
            return np.full_like(like, 255)
        image = self._above(self.above, poses, step, share)
        return np.vstack([strip(image.shape[1], ["team", "true poses and all goals"]), image])

    def _shared_lines(self, poses: Poses, step: int, share: float) -> list[str]:
        about, seconds = self.record.about, (step + share) * self.record.period
        lines = [f"{seconds:4.1f} s    {about['planner']} ({about['preset']}) in {about['world']}"]
        if len(self.record.agents) > 1:
            gaps = np.linalg.norm(poses[:, None, :2] - poses[None, :, :2], axis=-1)
            apart = gaps.sum() / (len(poses) * (len(poses) - 1))
            lines.append(
                f"robots {apart:.1f} m apart, their goals {goal_disagreement(self.record, step):.1f} m"
            )
        else:
            lines.append("")
        if step == len(self.record.poses) - 1:
            lines[1] += ": met" if about["success"] else ": out of time"
        hidden = len(self.record.agents) - len(self.views)
        lines[0] += f"    ({hidden} more robots not shown at the right)" if hidden else ""
        return lines

    def _ego_view(self, ego: EgoView, still: Frame, step: int, share: float) -> Frame:
        image = ego.frame(still, _between(ego.own.seen, step, share), step)
        lines = self._ego_lines(ego, step)
        image[:, :BORDER] = image[:, -BORDER:] = PAPER
        return np.vstack([strip(image.shape[1], lines, self.colors[ego.agent]), image])

    def _ego_lines(self, ego: EgoView, step: int) -> list[str]:
        plan = ego.own.plan_at(step)
        decision = self.decided.get((ego.agent, plan.step)) if plan is not None else None
        if decision is None:
            return [f"{ego.own.id}: has no goal yet", ""]
        deed = "stands" if ego.own.resting[step] else _deed(decision)
        return [f"{ego.own.id} {deed}", _scores(decision)]


def _deed(decision: Decision) -> str:
    x, y = decision.plan.goal
    place = f"({x:.1f}, {y:.1f})"
    return {
        "first": f"goes for {place}",
        "kept": f"keeps {place}",
        "changed": f"turns to {place}, {decision.moved:.1f} m from its goal before",
    }[decision.kind]


def _scores(decision: Decision) -> str:
    plan, chosen = decision.plan, decision.plan.chosen()
    if chosen is None or not decision.top:
        return decision.why
    score, best = plan.scores[chosen], plan.scores[decision.top[0]]
    return f"score {score:.2f}, best of {len(plan.scores)} candidates {best:.2f}"


def _grid(count: int) -> tuple[int, int]:
    """Return columns and rows for so many views."""
    rows = 1 if count <= 2 else 2
    return math.ceil(count / rows), rows


def _between(poses: Poses, step: int, share: float) -> npt.NDArray[np.float64]:
    """Return poses (n, 3) between a control step and the next."""
    now = np.asarray(poses[step], np.float64)
    change = np.asarray(poses[min(step + 1, len(poses) - 1)], np.float64) - now
    change[:, 2] = (change[:, 2] + np.pi) % (2 * np.pi) - np.pi
    return now + share * change
