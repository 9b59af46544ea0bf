"""A team that needs no weights: it turns towards its goal, then drives straight at it."""

from __future__ import annotations

import pytest
import torch

from hpp_framework.core.geometry import polar
from hpp_framework.core.skill import Skill
from hpp_framework.core.team import Team
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import hub

STRAIGHT = "test-straight"


class Straight(Skill):
    """Turns on the spot until the goal lies ahead, then drives; blind."""

    def act(self, observation, goal):
        distance, bearing = polar(observation.pose, goal).unbind(-1)
        speed = distance.clamp(0, 1) * (bearing.abs() < 0.5)
        return torch.stack([speed, (2 * bearing).clamp(-3, 3)], -1)


def make_straight_team(text: str = "fetch,freight") -> Team:
    """Register the skill if that has not happened, and build a team that uses it."""
    if STRAIGHT not in hub().skills:
        hub().skills.add(STRAIGHT, lambda robot: Straight())
    return parse_team(text, skill=STRAIGHT)


@pytest.fixture(scope="session")
def straight_team() -> Team:
    """Return Fetch and Freight with the blind skill."""
    return make_straight_team()


@pytest.fixture
def caught():
    """Return a function that runs a check on a broken plugin and looks for a finding of a rule."""
    from hpp_framework.testing import CheckError

    def look(check, plugin, rule, words, **options):
        with pytest.raises(CheckError) as error:
            check(plugin, **options)
        said = [str(finding) for finding in error.value.findings if finding.rule.name == rule]
        assert said, str(error.value)
        assert any(words in finding for finding in said), str(error.value)
        for finding in error.value.findings:
            assert str(finding) in str(error.value)

    return look


@pytest.fixture
def rules_of():
    """Return a function that names the rules of modules of checks."""
    return lambda *modules: {rule.name for module in modules for rule in module.RULES}
