"""Builds the agents of a team."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hpp_framework.agents.hierarchical import HierarchicalAgent
from hpp_framework.agents.policy import PolicyAgent
from hpp_framework.agents.scheduled import ScheduledAgent
from hpp_framework.config.control_choice import make_control
from hpp_framework.config.planner_choice import make_planner, make_policy, parse_planner
from hpp_framework.core.agent import Agent
from hpp_framework.core.control import ControlStack
from hpp_framework.core.planner import MetaPlanner, PlannerContext
from hpp_framework.core.schedule import Schedule
from hpp_framework.core.task import Task
from hpp_framework.core.team import Team
from hpp_framework.plugins.build import make_skills
from hpp_framework.plugins.builtin import DEFAULT_CONTROL

Bounds = tuple[float, float, float, float]
"""x_min, y_min, x_max, y_max of a world, metres."""


MakePlanner = Callable[[PlannerContext], MetaPlanner]


@dataclass(frozen=True, kw_only=True)
class AgentConfig:
    """What an agent is made of, unless its robot's entry in the team says otherwise.

    Attributes:
        planner: registered planner or policy, with settings of its own or without; or a factory of one.
        control: control stack; see :mod:`hpp_framework.config.control_choice`.
        preset: of the planner.
        weights: extra folders searched for weights of predictors and policies.
        settings: of planners that have parameters, by dotted name; not of planners that the team names.
    """

    planner: str | MakePlanner
    control: str = DEFAULT_CONTROL
    preset: str = "best"
    weights: tuple[Path, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=lambda: dict[str, Any]())


def build_agents(
    team: Team, task: Task, config: AgentConfig | Sequence[AgentConfig], bounds: Bounds
) -> list[Agent]:
    """Give each robot of a team its planner, skill and control stack.

    Args:
        team: all robots.
        task: the shared objective.
        config: what agents are made of; the same for all, or one for each robot.
        bounds: of the world, metres.
    """
    configs = [config] * len(team) if isinstance(config, AgentConfig) else list(config)

    def control(index: int) -> ControlStack:
        text = team.members[index].control or configs[index].control
        return make_control(text, team.robots, index, task)

    agents: list[Agent] = []
    for index, (member, skill) in enumerate(zip(team.members, make_skills(team), strict=True)):
        own = configs[index]
        context = PlannerContext(
            team=team, agent=index, task=task, preset=own.preset, bounds=bounds, weights=own.weights,
            settings=own.settings if member.planner is None else {}, control=control,
        )  # fmt: skip
        named = member.planner or own.planner
        if not isinstance(named, str):
            agents.append(HierarchicalAgent(named(context), skill, control(index), index))
        elif parse_planner(named).is_policy:
            agents.append(PolicyAgent(make_policy(named, context), control(index)))
        else:
            agents.append(HierarchicalAgent(make_planner(named, context), skill, control(index), index))
    return agents


def build_scheduled_agents(
    team: Team, schedule: Schedule, config: AgentConfig | Sequence[AgentConfig], bounds: Bounds
) -> list[Agent]:
    """Give each robot its agent; those of a team that changes take part when the schedule says.

    Args:
        team: all robots.
        schedule: who takes part when, with their task.
        config: what agents are made of; the same for all, or one for each robot.
        bounds: of the world, metres.
    """
    configs = [config] * len(team) if isinstance(config, AgentConfig) else list(config)
    built = [
        build_agents(team.part(stage.present), stage.task, [configs[i] for i in stage.present], bounds)
        for stage in schedule
    ]
    if len(schedule) == 1:
        return built[0]
    return [
        ScheduledAgent(
            [
                (stage, agents[stage.present.index(index)] if index in stage.present else None)
                for stage, agents in zip(schedule, built, strict=True)
            ]
        )
        for index in range(len(team))
    ]
