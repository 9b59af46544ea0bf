"""Control stacks as experiments name them, e.g. ``"terminal-approach:near=1.2,safety-filter"``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hpp_framework.config.planner_choice import parameters
from hpp_framework.config.settings import parse_settings
from hpp_framework.core.control import ControlContext, ControlLayer, ControlStack
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.task import Task
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import ConfigError

NONE = "none"
"""Names an empty stack."""


@dataclass(frozen=True, kw_only=True)
class LayerChoice:
    """A registered layer and its settings.

    Attributes:
        name: registered.
        settings: by dotted name.
    """

    name: str
    settings: Mapping[str, Any]


def parse_control(text: str) -> tuple[LayerChoice, ...]:
    """Read a control stack.

    Args:
        text: registered layers from the skill outwards, separated by commas, each with settings after colons;
            or ``"none"``.

    Raises:
        ConfigError: if an entry is empty, a layer comes twice, or a setting is malformed.
        UnknownNameError: if there is no such layer.
    """
    if text.strip() == NONE:
        return ()
    found: list[LayerChoice] = []
    for item in (part.strip() for part in text.split(",")):
        name, *pairs = item.split(":")
        if not name:
            raise ConfigError(
                f"control stack '{text}' has an empty entry; separate layers by single commas, or write "
                f"'{NONE}'."
            )
        hub().layers.entry(name)
        if any(choice.name == name for choice in found):
            raise ConfigError(f"control stack '{text}' names layer '{name}' twice.")
        found.append(LayerChoice(name=name, settings=parse_settings(pairs, f"layer '{item}'")))
    return tuple(found)


def make_control(text: str, robots: Sequence[RobotSpec], agent: int, task: Task) -> ControlStack:
    """Build the control stack of one robot.

    Args:
        text: as :func:`parse_control` reads it.
        robots: the team, in team order.
        agent: index of the robot.
        task: the shared objective.

    Raises:
        ConfigError: if a setting is wrong.
        UnknownNameError: if there is no such layer.
    """
    layers: list[ControlLayer] = []
    for choice in parse_control(text):
        context = ControlContext(robots=robots, agent=agent, task=task, settings=choice.settings)
        layer: ControlLayer = hub().layers.create(choice.name, context)
        if choice.settings and parameters(layer) is None:
            raise ConfigError(f"layer '{choice.name}' has no settings, but '{text}' gives it some.")
        layers.append(layer)
    return ControlStack(layers)
