"""Teams of robots that coordinate without communication, by hierarchical predictive planning.

A *team* of *robots* in a *world* pursues a *task*. Each robot's *agent* turns what it senses into an estimate
of the team, its *meta-planner* asks its *predictors* "where would we all be if we shared this goal?", scores
the answer with the *task reward*, keeps a *belief* over goals and hands the best goal to a *skill*, whose
command passes through the robot's *control layers* to the wheels.

The names below are the public API; everything else may move between versions. They are loaded when they are
first used. What can be chosen by name is in :func:`hpp_framework.hub`.
"""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hpp_framework.core.agent import Agent
    from hpp_framework.core.control import ControlLayer, ControlStack
    from hpp_framework.core.planner import Belief, Decision, MetaPlanner
    from hpp_framework.core.policy import Policy
    from hpp_framework.core.predictor import Predictor
    from hpp_framework.core.robot import RobotSpec
    from hpp_framework.core.skill import Skill
    from hpp_framework.core.task import Task
    from hpp_framework.core.team import Team
    from hpp_framework.core.types import Observation, Trajectories
    from hpp_framework.core.world import World
    from hpp_framework.envs.team import TeamEnv
    from hpp_framework.evaluation.experiment import Experiment
    from hpp_framework.evaluation.experiment import run_experiment as evaluate
    from hpp_framework.plugins.build import parse_team
    from hpp_framework.plugins.registry import hub

__version__ = version("hpp-framework")

__all__ = [
    "Agent", "Belief", "ControlLayer", "ControlStack", "Decision", "Experiment", "MetaPlanner", "Observation",
    "Policy", "Predictor", "RobotSpec", "Skill", "Task", "Team", "TeamEnv", "Trajectories", "World",
    "evaluate", "hub", "parse_team",
]  # fmt: skip

_HOMES = {
    "agent": "Agent", "control": "ControlLayer ControlStack", "planner": "Belief Decision MetaPlanner",
    "policy": "Policy", "predictor": "Predictor", "robot": "RobotSpec", "skill": "Skill", "task": "Task",
    "team": "Team", "types": "Observation Trajectories", "world": "World",
}  # fmt: skip
_ELSEWHERE = {
    "TeamEnv": ("envs.team", "TeamEnv"), "Experiment": ("evaluation.experiment", "Experiment"),
    "evaluate": ("evaluation.experiment", "run_experiment"), "parse_team": ("plugins.build", "parse_team"),
    "hub": ("plugins.registry", "hub"),
}  # fmt: skip


def __getattr__(name: str) -> Any:
    """Load a name of the public API when it is first used."""
    homes = {each: (f"core.{module}", each) for module, names in _HOMES.items() for each in names.split()}
    found = {**homes, **_ELSEWHERE}.get(name)
    if found is None:
        raise AttributeError(f"module 'hpp_framework' has no attribute '{name}'")
    return getattr(import_module(f"hpp_framework.{found[0]}"), found[1])
