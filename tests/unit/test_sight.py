"""Two robots that see each other meet between them, whatever goals their planners have."""

from __future__ import annotations

import math

import pytest
import torch

from hpp_framework.agents.hierarchical import make_agent
from hpp_framework.control.safety_filter import Guard
from hpp_framework.control.terminal_approach import STRAIGHT, STRAIGHT_OF_TWO, Docking
from hpp_framework.core.disturbances import NoiseModel
from hpp_framework.core.world import Box, World
from hpp_framework.evaluation.rollout import build_agents
from hpp_framework.perception.sensing import Sensing
from hpp_framework.perception.visibility import GAP, in_the_way, see_each_other
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import hub
from hpp_framework.sim.batch.simulator import BatchSimulator

EMPTY = World(name="room")
WALL = World(name="wall", boxes=(Box(center=(0.0, 0.0), size=(0.2, 3.0)),))
FAR_FROM_EACH_OTHER = [[-4.0, -0.5, 0.3], [4.0, 0.5, -2.8]]
NEAR_EACH_OTHER = [[-1.3, 0.0, 0.4], [1.3, 0.0, 2.8]]


def observed(starts, world=EMPTY, agent=0):
    """Return the team, and what a robot of it knows at its start."""
    team = parse_team(",".join((["fetch", "freight"] * len(starts))[: len(starts)]))
    sensing = Sensing(team.robots, NoiseModel(), torch.Generator())
    sensing.reset(BatchSimulator(team.robots).reset([world], torch.tensor([starts])))
    return team, sensing.observe(agent)


def docking_of(team, agent=0):
    task = hub().tasks.create("rendezvous", team.robots)
    return Docking(team.robots, agent, Guard(team.robots[agent]), task)


@pytest.mark.parametrize(
    ("point", "blocks"),
    [
        ((1.0, 0.0), True),
        ((1.0, 0.3 + GAP - 0.01), True),
        ((1.0, 0.3 + GAP + 0.01), False),
        ((-0.1, 0.0), False),
        ((2.0 + 0.3, 0.0), True),
        ((2.0 + 0.3 + GAP + 0.01, 0.0), False),
    ],
)
def test_what_lies_within_the_width_of_the_way_is_in_the_way(point, blocks):
    pose, spot = torch.tensor([[0.0, 0.0, 1.0]]), torch.tensor([[2.0, 0.0]])
    points = torch.tensor([[point]])
    assert bool(in_the_way(pose, spot, points, torch.tensor([[True]]), 0.3)) is blocks
    assert not bool(in_the_way(pose, spot, points, torch.tensor([[False]]), 0.3))


@pytest.mark.parametrize("agent", [0, 1])
def test_both_know_whether_they_see_each_other(agent):
    team, seen = observed(FAR_FROM_EACH_OTHER, agent=agent)
    assert bool(see_each_other(seen, team.robots[agent]))
    team, seen = observed(FAR_FROM_EACH_OTHER, WALL, agent)
    assert not bool(see_each_other(seen, team.robots[agent]))


@pytest.mark.parametrize("agent", [0, 1])
@pytest.mark.parametrize("away", [0, 1])
def test_one_that_looks_away_sees_nobody(agent, away):
    starts = [list(each) for each in FAR_FROM_EACH_OTHER]
    starts[away][2] += math.pi
    team, seen = observed(starts, agent=agent)
    assert not bool(see_each_other(seen, team.robots[agent]))


def test_two_that_see_each_other_drive_at_each_other_whatever_their_skills_want():
    skill, spot = torch.tensor([[0.3, 1.0]]), torch.tensor([[-4.0, 3.0]])
    team, seen = observed([[-4.0, -0.5, 0.1], [4.0, 0.5, -2.8]])
    command = docking_of(team)(seen, spot, skill)[0]
    assert float(command[0]) == pytest.approx(team.robots[0].drive.speed[1])
    assert abs(float(command[1])) < 0.2, "it faces its mate"
    for starts, world in ((FAR_FROM_EACH_OTHER, WALL), ([*FAR_FROM_EACH_OTHER, [0.0, 5.0, 0.0]], EMPTY)):
        team, seen = observed(starts, world)
        torch.testing.assert_close(docking_of(team)(seen, spot, skill), skill)


def test_from_afar_two_do_not_slow_down_to_turn_to_each_other():
    team, seen = observed([[-4.0, -0.5, 1.7], [4.0, 0.5, -2.8]])
    command = docking_of(team)(seen, torch.tensor([[-4.0, 3.0]]), torch.zeros(1, 2))[0]
    assert float(command[0]) == pytest.approx(team.robots[0].drive.speed[1])
    assert float(command[1]) < -1.0


def test_near_each_other_two_drive_to_their_middle_and_turn_meanwhile():
    team, seen = observed(NEAR_EACH_OTHER)
    docking = docking_of(team)
    stance, near = docking.stance_among(seen, torch.tensor([[-9.0, -9.0]]))
    assert bool(near)
    assert stance[0, :2].tolist() == pytest.approx([0.0, 0.0], abs=1e-5)
    assert docking.straight == STRAIGHT_OF_TWO > STRAIGHT
    command = docking(seen, torch.tensor([[-9.0, -9.0]]), torch.zeros(1, 2))[0]
    assert command[0] > 0
    assert command[1] < 0, "it looks to the left of its mate"


def test_a_wall_before_the_other_counts_as_much_as_one_before_oneself():
    beside = World(name="wall", boxes=(Box(center=(0.75, 0.0), size=(0.1, 3.0)),))
    team, seen = observed(NEAR_EACH_OTHER, beside)
    assert not bool(docking_of(team).stance_among(seen, torch.tensor([[-9.0, -9.0]]))[1])


def test_two_have_no_spots_to_dock_at():
    team, seen = observed([[-4.0, -0.5, 0.3], [4.0, 0.5, -2.8]], WALL)
    assert not bool(docking_of(team).stance_among(seen, seen.pose[:, :2])[1])


def test_meeting_in_sight_goes_with_the_guide(fixed_goal):
    team, _ = observed(FAR_FROM_EACH_OTHER)
    task = hub().tasks.create("rendezvous", team.robots)
    skill = hub().skills.create("p2p", team.robots[0])
    for guide in (True, False):
        agent = make_agent(0, skill, fixed_goal(-4.0, 3.0), task, team.robots, 0, guide=guide)
        assert (agent.docking is not None) is guide


@pytest.mark.parametrize("task", ["handover", "formation", "dispersion", "region"])
def test_tasks_in_which_two_do_not_meet_anywhere_send_nobody_to_the_other(task):
    team, seen = observed(FAR_FROM_EACH_OTHER)
    objective = hub().tasks.create(task, team.robots)
    docking = build_agents(team, "centralized-mp:guide=true", objective)[0].docking
    skill = torch.tensor([[0.3, 1.0]])
    assert docking is None or torch.equal(docking(seen, torch.tensor([[-4.0, 3.0]]), skill), skill)


def test_formations_are_left_to_the_skill():
    for count in (2, 3):
        team = parse_team(",".join(["fetch"] * count))
        agents = build_agents(team, "centralized-mp:guide=true", hub().tasks.create("formation", team.robots))
        assert [agent.docking for agent in agents] == [None] * count
