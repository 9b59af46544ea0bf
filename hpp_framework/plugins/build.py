"""Builds things that are named: teams, skills, options."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

from hpp_framework.core.option import BUDGET, Option
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.skill import Skill
from hpp_framework.core.team import Member, Team
from hpp_framework.plugins.builtin import DEFAULT_SKILL
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import ConfigError

MakeOption = Callable[[RobotSpec], Option]
"""Builds an option for a robot."""


def make_option(given: str | MakeOption, robot: RobotSpec, budget: int = BUDGET) -> Option:
    """Build an option for a robot.

    Args:
        given: a registered skill, which may then be started anywhere and is over at the goal; or a function
            that builds an option, whose own budget counts.
        robot: that it drives.
        budget: of a registered skill, control steps.

    Raises:
        UnknownNameError: if there is no such skill.
    """
    if callable(given):
        return given(robot)
    return Option(name=given, skill=hub().skills.create(given, robot), budget=budget)


def parse_team(text: str, *, skill: str = DEFAULT_SKILL) -> Team:
    """Read a team from ``"fetch,freight"`` or ``"alice=fetch,bob=freight"``.

    Robots without an id are called after their model, numbered when a model occurs more than once.

    Args:
        text: comma-separated robots, each optionally ``id=robot``.
        skill: registered skill of every robot.

    Raises:
        ConfigError: if the team is empty, an item is empty, or an id is used twice.
        UnknownNameError: if a robot or the skill is not registered.
    """
    items = [item.strip() for item in text.split(",")]
    if not text.strip() or not all(items):
        raise ConfigError(
            f"team '{text}' has an empty entry; write robots separated by commas, e.g. 'fetch,freight'."
        )
    hub().skills.entry(skill)
    pairs = [
        tuple(part.strip() for part in item.split("=", 1)) if "=" in item else ("", item) for item in items
    ]
    if any("=" in item and not all(pair) for item, pair in zip(items, pairs, strict=True)):
        raise ConfigError(f"team '{text}': write 'id=robot', e.g. 'alice=fetch'.")
    models = Counter(model for given, model in pairs if not given)
    seen: Counter[str] = Counter()
    members: list[Member] = []
    for given, model in pairs:
        seen[model] += not given
        automatic = f"{model}-{seen[model]}" if models[model] > 1 else model
        members.append(Member(id=given or automatic, robot=hub().robots.create(model), skill=skill))
    return Team(tuple(members))


def make_skills(team: Team) -> list[Skill]:
    """Build the skill of each robot of a team, in team order."""
    return [hub().skills.create(member.skill, member.robot) for member in team.members]
