"""What an onboarding is about: a newcomer, who it drives with, and how much is trained."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import combinations_with_replacement
from typing import Any

from hpp_framework.core.team import Team
from hpp_framework.onboarding.scale import Scale
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class Onboarding:
    """A robot or a skill that teams are to work with.

    Attributes:
        newcomer: registered robot or skill.
        teammates: registered robots; a new robot drives with each and with another of its kind, a new skill
            drives all of them in all pairs.
        skill: of every robot; a new skill itself.
        predictor: registered predictor to train.
        scale: how much.
        seed: of everything.
        init: robot whose weights a skill training starts from, ``"auto"`` for a teammate with as many beams,
            ``"none"`` for none.
    """

    newcomer: str
    teammates: tuple[str, ...]
    skill: str
    predictor: str = "far-sighted"
    scale: Scale
    seed: int = 0
    init: str = "auto"

    @property
    def is_robot(self) -> bool:
        """Whether the newcomer is a robot, and no skill."""
        return self.newcomer in hub().robots

    @property
    def robots(self) -> tuple[str, ...]:
        """All robots that drive, the newcomer first."""
        return tuple(dict.fromkeys((self.newcomer, *self.teammates))) if self.is_robot else self.teammates

    def pairs(self) -> Iterator[tuple[str, str]]:
        """Give all pairs whose motion is learnt, those of two kinds first."""
        if self.is_robot:
            yield from ((self.newcomer, mate) for mate in self.robots[1:])
            yield self.newcomer, self.newcomer
            return
        yield from sorted(combinations_with_replacement(self.robots, 2), key=lambda pair: pair[0] == pair[1])

    def team(self, *robots: str) -> Team:
        """Return a team of robots with the skill that all have."""
        return parse_team(",".join(robots), skill=self.skill)

    def record(self) -> dict[str, Any]:
        """Return what a folder of this onboarding says of itself (JSON-compatible)."""
        return {**asdict(self), "scale": {**asdict(self.scale), "worlds": list(self.scale.worlds)}}


def make_onboarding(
    newcomer: str, teammates: tuple[str, ...], skill: str, scale: Scale, **others: Any
) -> Onboarding:
    """Look up everything that an onboarding names.

    Args:
        newcomer: registered robot or skill.
        teammates: registered robots.
        skill: of every robot, if the newcomer is a robot.
        scale: how much.
        others: see :class:`Onboarding`.

    Raises:
        UnknownNameError: if a name is not registered.
        ConfigError: if the newcomer is both robot and skill, or a skill has no robot to drive.
    """
    robot, own_skill = newcomer in hub().robots, newcomer in hub().skills
    if robot and own_skill:
        raise ConfigError(
            f"'{newcomer}' is both a robot and a skill. Write PACKAGE/{newcomer}, or rename one of them."
        )
    if not robot and not own_skill:
        # says which names there are
        hub().robots.entry(newcomer)
    if not robot and not teammates:
        raise ConfigError(f"name the robots that skill '{newcomer}' must drive, e.g. --with fetch,freight.")
    for name in teammates:
        hub().robots.entry(name)
    onboarding = Onboarding(
        newcomer=newcomer, teammates=teammates, skill=skill if robot else newcomer, scale=scale, **others
    )
    hub().skills.entry(onboarding.skill)
    hub().predictors.entry(onboarding.predictor)
    if onboarding.init not in ("auto", "none"):
        hub().robots.entry(onboarding.init)
    return onboarding
