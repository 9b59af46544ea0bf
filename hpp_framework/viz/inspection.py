"""A saved episode decision by decision: a picture each, and one page to step through them."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from string import Template
from typing import Any

import cv2
import numpy as np

from hpp_framework.utils.run_folder import write_bytes
from hpp_framework.viz import marks
from hpp_framework.viz.backdrop import INK, Image
from hpp_framework.viz.decisions import HORIZONS, Decision, imagined
from hpp_framework.viz.ego_view import EgoView
from hpp_framework.viz.lettering import FONT, legend, strip
from hpp_framework.viz.record import EpisodeRecord
from hpp_framework.viz.topdown import TopDown, close_view

SIDE = 640
"""Pixels of each of a picture's two maps."""

AROUND = 2.0
"""Ground shown beyond where robots ever were, metres."""

PAGE = "inspect.html"
TEMPLATE = Path(__file__).with_name("inspect_template.html")


def picture_name(number: int) -> str:
    """Return the file name of a decision's picture."""
    return f"decision-{number:03d}.png"


def errors_text(record: EpisodeRecord, decision: Decision, horizon: int) -> str:
    """Return all robots' prediction errors at one of ``HORIZONS``, own first, in metres; a dash for none."""
    others = [i for i in range(len(record.agents)) if i != decision.agent]
    errors = [decision.errors[horizon, i] for i in (decision.agent, *others)]
    return " / ".join("-" if np.isnan(error) else f"{error:.2f}" for error in errors)


def top_text(decision: Decision) -> list[str]:
    """Return the best candidates, one text each: place and score."""
    plan = decision.plan
    return [
        f"({plan.candidates[g][0]:.1f}, {plan.candidates[g][1]:.1f})  {plan.scores[g]:.2f}"
        for g in decision.top
    ]


class Inspection:
    """Draws the decisions of one episode.

    Args:
        record: the episode.
        found: its decisions.
    """

    def __init__(self, record: EpisodeRecord, found: Sequence[Decision]) -> None:
        self.record = record
        self.found = list(found)
        view, size = close_view(record.ground, record.poses, AROUND, record.goals()), (SIDE, SIDE)
        self.views = [EgoView(record, i, size=size, view=view) for i in range(len(record.agents))]
        self.truth = TopDown(record.ground, record.robots, size=size, view=view)

    def picture(self, number: int) -> Image:
        """Draw a decision: at the left what the agent saw and weighed, at the right what came of it.

        Args:
            number: of the decision.

        Returns:
            (height, width, 3) RGB.
        """
        decision = self.found[number]
        gap = np.full((SIDE, 4, 3), 255, np.uint8)
        maps = np.hstack([self._ego_view(decision), gap, self._truth(decision)])
        width = maps.shape[1]
        color = self.truth.colors[decision.agent]
        head = strip(width, self._head(number, decision), color)
        return np.vstack([head, maps, legend(width), strip(width, self._foot(decision))])

    def _ego_view(self, decision: Decision) -> Image:
        ego, plan = self.views[decision.agent], decision.plan
        image = ego.frame(ego.still(plan.step), ego.own.seen[plan.step], plan.step)
        ego.canvas.label(image, "what it saw and weighed", (12, 12), INK)
        corners = ego.canvas.pixels(plan.candidates[list(decision.top)]) >> ego.canvas.SHIFT
        for rank, (x, y) in enumerate(corners.tolist(), start=1):
            if 0 <= x < SIDE - 30 and 20 < y < SIDE:
                for ink, stroke in ((marks.WHITE, 4), (INK, 1)):
                    cv2.putText(image, str(rank), (x + 7, y - 5), FONT, 0.5, ink, stroke, cv2.LINE_AA)
        return image

    def _truth(self, decision: Decision) -> Image:
        record, plan, canvas = self.record, decision.plan, self.truth.canvas
        last = min(plan.step + round(HORIZONS[-1] / record.period), len(record.poses) - 1)
        image = self.truth.empty()
        for i, color in enumerate(self.truth.colors):
            true = record.poses[plan.step : last + 1, i, :2]
            marks.draw_path(image, canvas, true, marks.mix(color, 0.6), canvas.stroke(0.2))
        if record.moving is not None:
            marks.draw_moving(image, canvas, record.moving[plan.step])
        if record.people is not None:
            marks.draw_people(image, canvas, record.people[plan.step])
        self._compare(image, decision)
        poses = record.poses[plan.step]
        for robot, pose, color in zip(record.robots, poses, self.truth.colors, strict=True):
            marks.draw_robot(image, canvas, robot, pose, color)
        for agent, color in zip(record.agents, self.truth.colors, strict=True):
            marks.draw_goal(image, canvas, agent.goals[plan.step], color)
        canvas.label(image, "imagined (thin), and the next 5 s as they were (wide)", (12, 12), INK)
        return image

    def _compare(self, image: Image, decision: Decision) -> None:
        """Draw the imagined paths, and a line from imagined to true place at each horizon."""
        record, plan, canvas = self.record, decision.plan, self.truth.canvas
        ahead = imagined(plan, record.agents[decision.agent].seen[plan.step, :, :2])
        if ahead is None:
            return
        times, paths = ahead
        for i, color in enumerate(self.truth.colors):
            dark = marks.mix(color, -0.3)
            marks.draw_path(image, canvas, paths[:, i], dark, 2, dashed=i != decision.agent)
            for h, seconds in enumerate(HORIZONS):
                if np.isnan(decision.errors[h, i]):
                    continue
                true = record.poses[plan.step + round(seconds / record.period), i, :2]
                guess = np.array([np.interp(seconds, times, paths[:, i, axis]) for axis in (0, 1)])
                marks.draw_path(image, canvas, np.stack([guess, true]), INK)
                for place, fill in ((guess, marks.WHITE), (true, dark)):
                    center = canvas.pixels(place).tolist()
                    for radius, ink in ((5, dark), (3.2, fill)):
                        fixed = round(radius * (1 << canvas.SHIFT))
                        cv2.circle(image, center, fixed, ink, -1, cv2.LINE_AA, canvas.SHIFT)

    def _head(self, number: int, decision: Decision) -> list[str]:
        plan, own = decision.plan, self.record.agents[decision.agent]
        x, y = plan.goal
        return [
            f"{number}    {decision.time:.1f} s    {own.id}: {decision.kind} goal ({x:.1f}, {y:.1f})",
            decision.why,
        ]

    def _foot(self, decision: Decision) -> list[str]:
        record = self.record
        names = [
            record.agents[decision.agent].id,
            *(a.id for i, a in enumerate(record.agents) if i != decision.agent),
        ]
        errors = "    ".join(
            f"{seconds:g} s: {errors_text(record, decision, h)} m" for h, seconds in enumerate(HORIZONS)
        )
        top = "    ".join(f"{rank}: {text}" for rank, text in enumerate(top_text(decision), start=1))
        return [
            f"best candidates, with scores    {top or 'none: nothing was weighed'}",
            f"prediction error ({' / '.join(names)})    {errors}",
            f"the robots' goals are {decision.disagreement:.2f} m apart",
        ]


def write_pictures(inspection: Inspection, numbers: Sequence[int], out: Path) -> Iterator[Path]:
    """Write pictures of decisions, yielding each file.

    Args:
        inspection: of the episode.
        numbers: of the decisions.
        out: folder; made if need be.

    Raises:
        ConfigError: if a file cannot be written.
    """
    for number in numbers:
        encoded = cv2.imencode(
            ".png", inspection.picture(number)[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9]
        )
        yield _write(out / picture_name(number), encoded[1].tobytes())


def write_page(inspection: Inspection, out: Path) -> Path:
    """Write a page with all decisions, which needs nothing but itself, from pictures already in ``out``.

    Args:
        inspection: of the episode.
        out: folder with the pictures of all decisions.

    Raises:
        ConfigError: if the page cannot be written.
    """
    record = inspection.record
    about = record.about
    title = f"{about['planner']} ({about['preset']}) in {about['world']}, seed {about['seed']}"
    ended = f"met after {about['time_s']} s" if about["success"] else "did not meet"
    colors = [f"rgb({r}, {g}, {b})" for r, g, b in inspection.truth.colors]
    steps: list[dict[str, Any]] = [
        {
            "picture": base64.b64encode((out / picture_name(number)).read_bytes()).decode(),
            "agent": record.agents[decision.agent].id,
            "color": colors[decision.agent],
            "cells": _cells(record, decision),
            "why": decision.why,
        }
        for number, decision in enumerate(inspection.found)
    ]
    heads = ["time", "goal", "", "moved", "score", *(f"error {s:g} s" for s in HORIZONS), "goals apart"]
    # a closing tag within the data would end the script
    data = json.dumps({"heads": heads, "steps": steps}).replace("<", "\\u003c")
    page = Template(TEMPLATE.read_text(encoding="utf-8")).substitute(
        title=html.escape(title), ended=html.escape(ended), data=data
    )
    return _write(out / PAGE, page.encode())


def _cells(record: EpisodeRecord, decision: Decision) -> list[str]:
    """Return a decision's row of the page's table."""
    plan, chosen = decision.plan, decision.plan.chosen()
    return [
        f"{decision.time:.1f} s",
        f"({plan.goal[0]:.1f}, {plan.goal[1]:.1f})",
        decision.kind,
        f"{decision.moved:.2f} m" if decision.kind == "changed" else "",
        "" if chosen is None else f"{plan.scores[chosen]:.2f}",
        *(errors_text(record, decision, h) for h in range(len(HORIZONS))),
        f"{decision.disagreement:.2f} m",
    ]


def _write(file: Path, content: bytes) -> Path:
    return write_bytes(file, content, failed=f"'{file}' could not be written")
