"""Tasks as experiments name them: registered, with settings or without, or a YAML file of terms.

``"rendezvous"``, ``"formation:shape=line:spacing=1.2"`` and ``"my_task.yaml"`` all name a task. The format of
files is described in ``docs/tasks.md``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, cast

import torch
from pydantic import ConfigDict, model_validator

from hpp_framework.config.settings import call_with, parse_settings
from hpp_framework.config.yaml_files import FileModel, checked, is_yaml, read_yaml
from hpp_framework.core.composition import ComposedTask, Limit, Rules, Weighed
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.task import Task
from hpp_framework.core.term import Term
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import ConfigError, HppError
from hpp_framework.utils.validation import LISTED, Count, Flag, NonNegative, Positive, Text, filled, mistake

is_task_file = is_yaml


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


def task_name(text: str) -> str:
    """Return what a task is called for short: its registered name, or its file without folder and suffix."""
    return Path(text.strip()).stem if is_task_file(text) else text.partition(":")[0]


class Part(FileModel):
    """A term, by name, with its settings beside it.

    Attributes:
        term: registered name.
    """

    model_config = ConfigDict(extra="allow")
    term: Text

    @model_validator(mode="before")
    @classmethod
    def _names_a_term(cls, value: Any) -> Any:
        if not isinstance(value, dict) or "term" not in value:
            raise mistake("names no term", f"Write '- {{term: spread, {list(cls.model_fields)[-1]}: 1.0}}'.")
        return cast("Any", value)


class RewardPart(Part):
    """A term of the reward; see :class:`Weighed`."""

    weight: NonNegative = 1.0


class SuccessPart(Part):
    """A condition of success; see :class:`Limit`."""

    at_most: NonNegative = 0.0


class TaskFile(FileModel):
    """A task file: its terms, and when it is fulfilled as :class:`Rules` say."""

    reward: Annotated[
        tuple[RewardPart, ...], LISTED, filled("List at least one term: '- {term: spread, weight: 1.0}'.")
    ]
    success: Annotated[
        tuple[SuccessPart, ...], LISTED, filled("List at least one term: '- {term: spread, at_most: 1.0}'.")
    ]
    sustain_steps: Count = Rules().sustain_steps
    rest_speed: Positive | None = Rules().rest_speed
    halts: Flag = Rules().halts


def _read(file: Path, told: Mapping[str, Any]) -> ComposedTask:
    found = checked(TaskFile, read_yaml(file, kind="task", least="reward: [{term: spread}]"), file)
    rules = Rules(sustain_steps=found.sustain_steps, rest_speed=found.rest_speed, halts=found.halts)
    rewards = [
        Weighed(_term(part, told, f"{file}: 'reward[{i}]'"), part.weight)
        for i, part in enumerate(found.reward)
    ]
    success = [
        Limit(_term(part, told, f"{file}: 'success[{i}]'"), part.at_most)
        for i, part in enumerate(found.success)
    ]
    return ComposedTask(rewards, success, rules)


def _term(part: Part, told: Mapping[str, Any], where: str) -> Term:
    try:
        factory = hub().terms.entry(part.term).factory()
        return call_with(factory, told, part.model_extra or {}, f"term '{part.term}'")
    except HppError as error:
        raise ConfigError(f"{where}: {error}") from error
