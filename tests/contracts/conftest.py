"""A team that needs no weights: it turns towards its goal, then drives straight at it."""

from __future__ import annotations

import pytest
import torch

from hpp_framework.geometry import polar
from hpp_framework.registry import hub
from hpp_framework.skill import Skill
from hpp_framework.team import Team, parse_team

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
