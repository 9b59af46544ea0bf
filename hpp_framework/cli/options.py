"""Options that several commands share."""

from __future__ import annotations

from dataclasses import fields
from itertools import chain
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from hpp_framework.config.settings import parse_settings
from hpp_framework.utils.errors import ConfigError

if TYPE_CHECKING:
    from hpp_framework.evaluation.experiment import Experiment

Pairs = Annotated[
    tuple[tuple[str, ...], ...], tyro.conf.arg(metavar="NAME=VALUE ..."), tyro.conf.UseAppendAction
]
"""Type of an option ``--set``: one or several pairs, given once or several times."""


def names(text: str, option: str) -> tuple[str, ...]:
    """Split a comma-separated list.

    Raises:
        ConfigError: if an entry is empty or comes twice.
    """
    items = tuple(item.strip() for item in text.split(","))
    if not all(items):
        raise ConfigError(f"{option} '{text}' has an empty entry; separate names by single commas.")
    twice = next((item for item in items if items.count(item) > 1), None)
    if twice:
        raise ConfigError(f"{option} names '{twice}' twice.")
    return items


def to_experiment(
    options: Any, command: str, *, worlds: tuple[str, ...], planners: tuple[str, ...], episodes: int
) -> Experiment:
    """Return the experiment that the options of a command, or its config file, describe.

    Args:
        options: of either command; what both have is read here.
        command: ``"run"`` or ``"evaluate"``.
        worlds: registered worlds or world files.
        planners: registered planners.
        episodes: a world and planner.

    Raises:
        ConfigError: if an option is wrong, or given beside ``--config``.
    """
    from hpp_framework.evaluation.experiment import Experiment, read_experiment

    if options.config is not None:
        only_config(options, type(options)())
        return read_experiment(options.config, command)
    return Experiment(
        worlds=worlds,
        planners=planners,
        team=options.team,
        control=options.control,
        preset=options.preset,
        backend=options.backend,
        episodes=episodes,
        seed=options.seed,
        task=options.task,
        skill=options.skill,
        disturbances=options.disturbances,
        estimator=options.estimator,
        weights=names(options.weights, "--weights") if options.weights else (),
        settings=parse_settings(list(chain(*options.set)), "--set"),
        people=options.people,
    )


def only_config(command: Any, default: Any) -> None:
    """Check that a command with ``--config`` got no other option than ``--out``.

    Args:
        command: a dataclass of options.
        default: the same with every option left out.

    Raises:
        ConfigError: if an option differs from its default; names all that do.
    """
    given = [
        f"--{field.name}"
        for field in fields(command)
        if field.name not in ("config", "out")
        and getattr(command, field.name) != getattr(default, field.name)
    ]
    if given:
        raise ConfigError(
            f"--config repeats what '{command.config}' describes; leave out {', '.join(given)}, "
            "or leave out --config."
        )


def check_positive(**values: int) -> None:
    """Raise :class:`ConfigError` if an option of this name is less than 1."""
    for name, value in values.items():
        if value < 1:
            raise ConfigError(f"--{name} must be at least 1, got {value}.")
