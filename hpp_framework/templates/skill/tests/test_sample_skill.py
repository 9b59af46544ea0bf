"""The skill arrives, and touches little on the way."""

from __future__ import annotations

from hpp_framework.evaluation.skill import evaluate_skill
from hpp_framework.plugins.registry import hub
from hpp_framework.testing import check_skill


def test_it_is_a_sound_skill():
    check_skill("my-pkg/sample-skill", robot="freight")


def test_it_arrives_in_most_rooms():
    robot = hub().robots.create("freight")
    skill = hub().skills.create("my-pkg/sample-skill", robot)
    score = evaluate_skill(skill, robot, world="training", episodes=20, seed=1)
    assert score.success >= 0.6
    assert score.collision <= 0.2
