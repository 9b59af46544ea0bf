"""Checks for authors of plugins: each says what is wrong, why it matters and what to write instead.

In a plugin's own tests::

    from hpp_framework.testing import check_skill

    def test_my_skill():
        check_skill("my-skill")

``hpp check my-package`` runs the right ones over everything that a distribution registers.
"""

from hpp_framework.testing.layer import check_layer
from hpp_framework.testing.planner import check_planner
from hpp_framework.testing.predictor import check_predictor
from hpp_framework.testing.report import CheckError, Finding, Rule
from hpp_framework.testing.robot import check_robot
from hpp_framework.testing.skill import check_skill
from hpp_framework.testing.task import check_task
from hpp_framework.testing.world import check_world

__all__ = [
    "CheckError",
    "Finding",
    "Rule",
    "check_layer",
    "check_planner",
    "check_predictor",
    "check_robot",
    "check_skill",
    "check_task",
    "check_world",
]
