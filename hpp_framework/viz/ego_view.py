"""One robot's own view: what it saw, which goals it weighed, and how it imagined the team's motion."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from hpp_framework.viz import marks
from hpp_framework.viz.backdrop import Image
from hpp_framework.viz.decisions import imagined
from hpp_framework.viz.record import AgentRecord, EpisodeRecord, Plan
from hpp_framework.viz.topdown import TopDown

SHOWN = 6
"""Candidates whose imagined motion is drawn pale, beside the chosen one's."""


class EgoView:
    """Draws the view of one agent of an episode.

    Obstacles are a hint for the viewer: the agent knows its scan only. Its own imagined motion is solid, that
    of the others dashed, each in its robot's colour; that for the chosen goal is thick.

    Args:
        record: the episode.
        agent: whose view; its place in the team.
        size: width and height in pixels.
        view: (x_min, y_min, x_max, y_max) to show in metres.
    """

    def __init__(
        self,
        record: EpisodeRecord,
        agent: int,
        *,
        size: tuple[int, int],
        view: tuple[float, float, float, float],
    ) -> None:
        self.record = record
        self.agent = agent
        self.view = TopDown(record.ground, record.robots, size=size, view=view, faint=True)
        self.canvas, self.colors = self.view.canvas, self.view.colors
        self._drawn: tuple[Plan | None, Image] | None = None

    @property
    def own(self) -> AgentRecord:
        """What the agent saw and decided."""
        return self.record.agents[self.agent]

    def still(self, step: int) -> Image:
        """Draw all that stays the same during a control step: candidates, imagination, belief, scan."""
        image = self._weighed(self.own.plan_at(step)).copy()
        pose, color = self.own.seen[step, self.agent], self.colors[self.agent]
        marks.draw_scans(image, self.canvas, pose[None], [self.own.scans[step]], [self.own.robot], [color])
        return image

    def frame(self, still: Image, seen: npt.NDArray[np.floating], step: int) -> Image:
        """Draw the team where the agent sees it, and its goal, onto a copy of :meth:`still`.

        Args:
            still: of this step.
            seen: (n, 3) poses of the team.
            step: control step.
        """
        image = still.copy()
        for i, (robot, pose, color) in enumerate(zip(self.record.robots, seen, self.colors, strict=True)):
            marks.draw_robot(image, self.canvas, robot, pose, color, hollow=i != self.agent)
        marks.draw_goal(image, self.canvas, self.own.goals[step], self.colors[self.agent])
        return image

    def _weighed(self, plan: Plan | None) -> Image:
        """Draw what a plan weighed; the same for all steps until the next plan."""
        if self._drawn is None or self._drawn[0] is not plan:
            image = self.view.empty()
            if plan is not None:
                marks.draw_belief(image, self.canvas, plan.mean, plan.std, self.colors[self.agent])
                self._draw_imagined(image, plan)
                marks.draw_candidates(image, self.canvas, plan.candidates, plan.scores)
            self._drawn = (plan, image)
        return self._drawn[1]

    def _draw_imagined(self, image: Image, plan: Plan) -> None:
        chosen = plan.chosen()
        pale = image.copy()
        for g in reversed([g for g in plan.order() if g != chosen][:SHOWN]):
            for i, color in enumerate(self.colors):
                marks.draw_path(pale, self.canvas, plan.paths[g, :, i], color, dashed=i != self.agent)
        cv2.addWeighted(pale, 0.45, image, 0.55, 0, image)
        path = imagined(plan, self.own.seen[plan.step, :, :2])
        if path is None:
            return
        width = max(2, self.canvas.stroke(0.055))
        for i, color in enumerate(self.colors):
            marks.draw_path(image, self.canvas, path[1][:, i], color, width, dashed=i != self.agent)
