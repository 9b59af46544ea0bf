"""Disturbances and estimators as experiments name them: ``"field:command_delay=0.4"``, ``"tracker"``."""

from __future__ import annotations

from collections.abc import Sequence

from hpp_framework.config.planner_choice import parameters
from hpp_framework.config.settings import altered, parse_settings
from hpp_framework.core.disturbances import PROFILES, Disturbances
from hpp_framework.core.estimator import Estimator, EstimatorContext
from hpp_framework.core.robot import RobotSpec
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import ConfigError, unknown_name


def parse_disturbances(text: str) -> Disturbances:
    """Read disturbances.

    Args:
        text: a profile, with settings after colons or without, e.g. ``"field:nan_beams=0.01"``.

    Raises:
        ConfigError: if a setting is unknown or out of range.
        UnknownNameError: if there is no such profile.
    """
    name, *pairs = text.strip().split(":")
    if name not in PROFILES:
        raise unknown_name("profile of disturbances", name, PROFILES)
    owner = f"disturbances '{text}'"
    return altered(PROFILES[name], parse_settings(pairs, owner), owner)


def make_estimators(
    text: str, robots: Sequence[RobotSpec], disturbances: Sequence[Disturbances]
) -> list[Estimator]:
    """Build the estimators of a team's agents.

    Args:
        text: a registered estimator, with settings after colons or without, e.g. ``"tracker:noise=2"``.
        robots: the team, in team order.
        disturbances: of each robot: what a calibration of it would find.

    Raises:
        ConfigError: if a setting is wrong, or the estimator has none.
        UnknownNameError: if there is no such estimator.
    """
    name, *pairs = text.strip().split(":")
    settings = parse_settings(pairs, f"estimator '{text}'")
    estimators: list[Estimator] = []
    for agent in range(len(robots)):
        context = EstimatorContext(robots=robots, agent=agent, disturbances=disturbances, settings=settings)
        estimators.append(hub().estimators.create(name, context))
    if settings and parameters(estimators[0]) is None:
        raise ConfigError(f"estimator '{name}' has no settings, but '{text}' gives it some.")
    return estimators
