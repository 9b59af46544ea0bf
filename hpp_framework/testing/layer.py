"""``check_layer``: whether a control layer is stateless, batched, and answers with what it should."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch

from hpp_framework.core.control import ControlContext, ControlLayer
from hpp_framework.core.task import Task
from hpp_framework.core.team import Team
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.builtin import DEFAULT_TASK
from hpp_framework.plugins.registry import hub
from hpp_framework.testing.build import build, find_source
from hpp_framework.testing.purity import check_pure, check_rows, check_tensor
from hpp_framework.testing.report import Report
from hpp_framework.testing.scene import EPISODES, find_teams, make_scene

SIGNATURE = "(context: ControlContext) -> ControlLayer"
AGENT = 1
"""The robot that is controlled: a layer that reads the poses of robot 0 controls by the wrong ones."""
ROUNDED = 1e-4
"""Difference between a batch and its members, in m, m/s and rad/s."""


def check_layer(
    layer: str | ControlLayer | Callable[[ControlContext], ControlLayer],
    *,
    team: str | Team | None = None,
    task: str | Task = DEFAULT_TASK,
) -> None:
    """Check both hooks of a control layer on what a driving team observes.

    Args:
        layer: registered name, factory or object.
        team: whose second robot is controlled; None for the first pair of the layer's own distribution or of
            the commands.
        task: of the team, by name or as an object.

    Raises:
        CheckError: if anything is wrong; holds everything that was found.
        UnknownNameError: if nothing has that name.
    """
    source, report = find_source("layer", layer, ControlLayer)
    if team is None:
        team = next(find_teams(source.distribution))
    known = parse_team(team) if isinstance(team, str) else team
    objective = hub().tasks.create(task, known.robots) if isinstance(task, str) else task
    context = ControlContext(robots=known.robots, agent=AGENT, task=objective)
    made = build(source, report, (context,), ControlLayer, SIGNATURE)
    if made is not None:
        _check_hooks(report, made, known)
    report.finish()


@torch.no_grad()
def _check_hooks(report: Report, layer: ControlLayer, team: Team) -> None:
    seen = make_scene(team).observations[AGENT]
    goal = seen.pose[:, :2] + torch.tensor([1.5, 0.5])
    command = torch.tensor([0.6, -0.4]).repeat(EPISODES, 1)
    other = -command
    hooks: dict[str, tuple[Callable[..., Any], str]] = {
        "redirect()": (layer.redirect, "(episodes, [x, y])"),
        "filter()": (layer.filter, "(episodes, [v in m/s, omega in rad/s])"),
    }
    inputs = {"redirect()": (goal, goal.clone()), "filter()": (goal, command)}
    elsewhere = {"redirect()": (-goal, -goal), "filter()": (-goal, other)}
    for name, (hook, meaning) in hooks.items():
        given = inputs[name]
        answer = check_pure(
            report, name, lambda hook=hook, given=given: hook(seen, *given), (),
            lambda hook=hook, name=name: hook(seen, *elsewhere[name]), lent=(seen, *given),
        )  # fmt: skip
        if answer is not None and check_tensor(report, name, answer, (EPISODES, 2), meaning):
            check_rows(
                report, name, answer,
                lambda row, hook=hook, given=given: hook(
                    seen.episodes(slice(row, row + 1)), *(each[row : row + 1] for each in given)
                ),
                (0, EPISODES - 1), ROUNDED,
            )  # fmt: skip
