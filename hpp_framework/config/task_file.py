"""Tasks as experiments name them: registered, with settings or without, or a YAML file of terms.

``"rendezvous"``, ``"formation:shape=line:spacing=1.2"`` and ``"my_task.yaml"`` all name a task. The format of
files is described in ``docs/tasks.md``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch

from hpp_framework.config.fields import Source, read_yaml
from hpp_framework.config.settings import call_with, parse_settings
from hpp_framework.core.composition import ComposedTask, Limit, Rules, Weighed
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.task import Task
from hpp_framework.core.term import Term
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import ConfigError, HppError

SUFFIXES = (".yaml", ".yml")

_TASK = ("reward", "success", "sustain_steps", "rest_speed", "halts")
_LEAST = "reward: [{term: spread}]"


def make_task(text: str, robots: Sequence[RobotSpec], ids: Sequence[str] = ()) -> Task:
    """Build a task for a team.

    Args:
        text: a registered name, then settings, all separated by colons; or a path ending in .yaml or .yml.
        robots: the team.
        ids: of the robots, by which tasks with roles know them; without, they are called by their index.

    Raises:
        ConfigError: if a setting or the file is wrong, the task is none for this team, or what it answers has
            another shape than it should.
        UnknownNameError: if there is no such task.
    """
    told = {"robots": tuple(robots), "ids": tuple(ids) or tuple(map(str, range(len(robots))))}
    if is_task_file(text):
        return _read(Path(text.strip()), told)
    name, *pairs = text.split(":")
    settings = parse_settings(pairs, f"task '{text}'")
    task: Task = call_with(hub().tasks.entry(name).factory(), told, settings, f"task '{name}'")
    _check_shapes(name, task, len(robots))
    return task


def _check_shapes(name: str, task: Task, robots: int) -> None:
    """Ask a task about a few poses, as planners will about many.

    Raises:
        ConfigError: if it does not answer with one value a team.
    """
    poses = torch.arange(2 * 5 * robots * 3, dtype=torch.float32).reshape(2, 5, robots, 3)
    of_poses = f"of poses of shape (2, 5, {robots}, 3)"
    for method in ("reward", "success"):
        try:
            answer = getattr(task, method)(poses.clone())
        except Exception as error:
            raise ConfigError(
                f"task '{name}': {method}() {of_poses} raises {type(error).__name__}: {error}. "
                "It must take any leading dimensions; `hpp check` says more."
            ) from error
        shape = tuple(getattr(answer, "shape", ()))
        if shape != (2, 5):
            remedy = "Sum over robots: .sum(-1). " if shape == (2, 5, robots) and method == "reward" else ""
            raise ConfigError(
                f"task '{name}': {method}() {of_poses} must be one value a team, of shape (2, 5), "
                f"but is of shape {shape}. {remedy}`hpp check` says more."
            )


def is_task_file(text: str) -> bool:
    """Return whether a task is named by its file."""
    return text.strip().lower().endswith(SUFFIXES)


def task_name(text: str) -> str:
    """Return what a task is called for short: its registered name, or its file without folder and suffix."""
    return Path(text.strip()).stem if is_task_file(text) else text.partition(":")[0]


def _read(file: Path, told: Mapping[str, Any]) -> ComposedTask:
    source = Source(file)
    content = source.mapping(
        "", read_yaml(file, kind="task", least=_LEAST), _TASK, required=("reward", "success")
    )
    rewards = [
        Weighed(term, weight) for term, weight in _terms(source, content, "reward", told, "weight", 1.0)
    ]
    success = [Limit(term, most) for term, most in _terms(source, content, "success", told, "at_most", 0.0)]
    return ComposedTask(rewards, success, _rules(source, content))


def _rules(source: Source, content: Mapping[str, Any]) -> Rules:
    rules = Rules()
    steps = source.number("sustain_steps", content.get("sustain_steps", rules.sustain_steps), low=1)
    if steps != int(steps):
        raise source.error("sustain_steps", f"must be a whole number, got {steps:g}", "Control steps: 5.")
    speed = content.get("rest_speed", rules.rest_speed)
    return Rules(
        sustain_steps=int(steps),
        rest_speed=None if speed is None else source.number("rest_speed", speed, positive=True),
        halts=source.flag("halts", content.get("halts", rules.halts)),
    )


def _terms(
    source: Source, content: Mapping[str, Any], part: str, told: Mapping[str, Any], own: str, default: float
) -> list[tuple[Term, float]]:
    """Return the terms of one part of the file, each with the number that the part adds to it.

    Args:
        source: the file.
        content: what it holds.
        part: ``"reward"`` or ``"success"``.
        told: what every term is told.
        own: name of the number.
        default: its value where it is left out.
    """
    entries = source.items(part, content[part])
    if not entries:
        raise source.error(part, "is empty", f"List at least one term: '- {{term: spread, {own}: 1.0}}'.")
    found: list[tuple[Term, float]] = []
    for i, entry in enumerate(entries):
        key = f"{part}[{i}]"
        if not isinstance(entry, dict) or "term" not in entry:
            raise source.error(key, "names no term", f"Write '- {{term: spread, {own}: 1.0}}'.")
        settings: dict[str, Any] = {str(name): value for name, value in entry.items()}
        name = source.text(f"{key}.term", settings.pop("term"))
        number = source.number(f"{key}.{own}", settings.pop(own, default), low=0)
        try:
            factory = hub().terms.entry(name).factory()
            found.append((call_with(factory, told, settings, f"term '{name}'"), number))
        except HppError as error:
            raise ConfigError(f"{source.file}: '{key}': {error}") from error
    return found
