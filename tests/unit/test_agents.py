"""Agents: who drives where, what layers make of it, and what the agents of a team are made of."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from hpp_framework.agents.build import AgentConfig, build_agents
from hpp_framework.agents.hierarchical import HierarchicalAgent
from hpp_framework.agents.policy import PolicyAgent, one_second_ahead
from hpp_framework.control.rotate_to_path import RotateToPath
from hpp_framework.control.safety_filter import SafetyFilter
from hpp_framework.control.stop_on_success import StopOnSuccess
from hpp_framework.core.control import ControlLayer, ControlStack
from hpp_framework.core.option import Option
from hpp_framework.core.planner import Decision, MetaPlanner, certain
from hpp_framework.core.policy import Policy
from hpp_framework.core.skill import Skill
from hpp_framework.core.team import Team
from hpp_framework.core.types import Observation
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import hub

BOUNDS = (-10.0, -10.0, 10.0, 10.0)


def observation(count=1, agent=0):
    return Observation(
        agent, torch.zeros(count, 5, 2, 3), torch.full((count, 5, 222), 9.0), torch.zeros(count, 2)
    )


class Notes(Skill):
    """Keeps where it was sent, and drives at one speed."""

    def __init__(self, speed=0.5):
        self.speed, self.sent = speed, []

    def act(self, observation, goal):
        self.sent.append(goal)
        return torch.tensor([self.speed, 0.0]).expand(len(goal), 2)


class Aside(ControlLayer):
    """Moves waypoints, halves commands, and counts how often it is asked."""

    def __init__(self):
        self.asked = 0

    def redirect(self, observation, goal, waypoint):
        self.asked += 1
        return waypoint + 1.0

    def filter(self, observation, waypoint, command):
        return command / 2


class Moving(MetaPlanner):
    """Moves its goal in every second control step between plans."""

    plan_every = 4

    def __init__(self):
        self.goals = torch.arange(40.0)[:, None, None].expand(-1, 1, 2).unbind(0)
        self.plans, self.follows = 0, 0

    def plan(self, observation, belief, rng):
        self.plans += 1
        return Decision(self.goals[10 * self.plans], certain(self.goals[10 * self.plans]))

    def follow(self, observation, decision):
        self.follows += 1
        if self.follows % 2:
            return decision
        return Decision(decision.goal + 0.25, decision.belief)


def agent_of(planner, skill=None, *layers):
    agent = HierarchicalAgent(planner, skill or Notes(), ControlStack(layers), 0)
    agent.reset([3])
    return agent


def test_skills_are_sent_where_layers_redirect_and_agents_keep_the_goal(fixed_goal):
    skill, layer = Notes(), Aside()
    agent = agent_of(fixed_goal(-5.0, 0.0), skill, layer)
    for _ in range(7):
        assert agent.act(observation()).tolist() == agent.command.tolist() == [[0.25, 0.0]]
    assert agent.goal.tolist() == [[-5.0, 0.0]]
    assert [sent.tolist() for sent in skill.sent] == [[[-4.0, 1.0]]] * 7
    # plans come every 5 control steps; while the goal stays, nothing is redirected between them
    assert layer.asked == 2


def test_layers_are_asked_after_each_plan_also_where_the_goal_stays():
    """A robot that was sent back along its path must not be left there."""

    class Stays(MetaPlanner):
        plan_every = 3
        decision = Decision(torch.zeros(1, 2), certain(torch.zeros(1, 2)))

        def plan(self, observation, belief, rng):
            return self.decision

    layer = Aside()
    agent = agent_of(Stays(), None, layer)
    for step in range(1, 8):
        agent.act(observation())
        assert layer.asked == (step + 2) // 3


def test_layers_are_asked_where_a_planner_moves_the_goal_between_plans():
    planner, layer = Moving(), Aside()
    agent = agent_of(planner, None, layer)
    for _ in range(4):
        agent.act(observation())
    assert (planner.plans, planner.follows, layer.asked) == (1, 3, 2)
    assert agent.waypoint.tolist() == [[11.25, 11.25]]
    assert agent.goal.tolist() == [[10.0, 10.0]]


def test_layers_follow_one_another():
    class Double(ControlLayer):
        def redirect(self, observation, goal, waypoint):
            return 2 * waypoint

        def filter(self, observation, waypoint, command):
            return command + 1.0

    one, other = ControlStack([Aside(), Double()]), ControlStack([Double(), Aside()])
    zero, ones = torch.zeros(1, 2), torch.ones(1, 2)
    assert one.redirect(observation(), zero, zero).tolist() == [[2.0, 2.0]]
    assert other.redirect(observation(), zero, zero).tolist() == [[1.0, 1.0]]
    assert one.filter(observation(), zero, ones).tolist() == [[1.5, 1.5]]
    assert other.filter(observation(), zero, ones).tolist() == [[1.0, 1.0]]
    assert ControlStack().filter(observation(), zero, ones) is ones


def test_a_reset_agent_begins_as_a_new_one():
    planner = Moving()
    agent = agent_of(planner)
    agent.act(observation())
    first = agent.rng.uniform(3)
    agent.reset([3])
    assert agent.belief is None
    assert torch.equal(agent.rng.uniform(3), first)
    agent.act(observation())
    assert planner.plans == 2


def test_agents_have_randomness_of_their_own_unless_the_planner_shares_it():
    team = parse_team("fetch,freight")
    task = hub().tasks.create("rendezvous", team.robots)
    for planner, shared in (("wander", False), ("centralized-rp", True)):
        first, second = build_agents(team, task, AgentConfig(planner=planner), BOUNDS)
        for agent in (first, second):
            agent.reset([1, 2])
        assert torch.equal(first.rng.uniform(4), second.rng.uniform(4)) is shared


@pytest.mark.parametrize(("chosen", "speeds"), [([0, 1], [0.2, 0.8]), ([1, -1], [0.8, 0.0])])
def test_options_drive_where_a_planner_chooses_them(chosen, speeds):
    class Chooses(MetaPlanner):
        options = tuple(Option(name=str(speed), skill=Notes(speed)) for speed in (0.2, 0.8))

        def plan(self, observation, belief, rng):
            goal = torch.zeros(2, 2)
            return Decision(goal, certain(goal), torch.tensor(chosen))

    agent = HierarchicalAgent(Chooses(), Notes(0.5), ControlStack(), 0)
    agent.reset([0, 1])
    assert agent.act(observation(2))[:, 0].tolist() == pytest.approx(speeds)


def test_policies_drive_by_themselves_and_layers_have_the_last_word():
    class Circles(Policy):
        def act(self, observation):
            return torch.tensor([[1.0, 0.5]])

    agent = PolicyAgent(Circles(), ControlStack([Aside()]))
    agent.reset([0])
    assert agent.act(observation()).tolist() == [[0.5, 0.25]]
    assert torch.equal(agent.goal, one_second_ahead(observation(), torch.tensor([[1.0, 0.5]])))
    assert torch.equal(agent.waypoint, agent.goal + 1.0)
    assert agent.plan_seconds(observation(), 3) == []


def test_a_member_of_the_team_may_have_a_control_stack_of_its_own():
    alice, bob = parse_team("fetch,freight").members
    team = Team((alice, replace(bob, control="stop-on-success:beyond=0")))
    task = hub().tasks.create("rendezvous", team.robots)
    first, second = build_agents(team, task, AgentConfig(planner="hpp", control="safety-filter"), BOUNDS)
    assert [type(layer) for layer in first.control.layers] == [SafetyFilter]
    assert [type(layer) for layer in second.control.layers] == [StopOnSuccess]
    assert second.control.layers[0].config.beyond == 0.0


def test_all_planners_and_policies_get_the_same_control_stack():
    team = parse_team("fetch,freight")
    task = hub().tasks.create("rendezvous", team.robots)
    for planner in ("hpp", "centralized-oa", "stubborn", "route", "maddpg"):
        for agent in build_agents(team, task, AgentConfig(planner=planner), BOUNDS):
            kinds = [type(layer) for layer in agent.control.layers]
            assert (kinds[0], kinds[3], len(kinds)) == (RotateToPath, StopOnSuccess, 7), planner
        bare = build_agents(team, task, AgentConfig(planner=planner, control="none"), BOUNDS)
        assert [agent.control.layers for agent in bare] == [(), ()]
