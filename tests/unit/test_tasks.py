"""Bundled tasks: each is fulfilled where it should be, and robots are sent to targets of their own."""

from __future__ import annotations

import math

import pytest
import torch

from hpp_framework.config.task_file import make_task
from hpp_framework.core.planner import PlannerContext
from hpp_framework.core.predictor import Predictor
from hpp_framework.core.types import Observation, Trajectories
from hpp_framework.planning.baselines.centralized import midpoint
from hpp_framework.planning.hpp.lattice import LatticeConfig, LatticePlanner
from hpp_framework.planning.hpp.planner import HppConfig, HppPlanner
from hpp_framework.planning.targets import own_target
from hpp_framework.plugins.build import parse_team
from hpp_framework.utils.seeding import EpisodeRng

LEFT, RIGHT = 0.0, math.pi


@pytest.fixture(scope="module")
def team():
    return parse_team("alice=fetch,bob=freight")


class Straight(Predictor):
    """Each robot drives straight to its goal at 1 m/s; one second per step."""

    def rollout(self, observation, goals, horizon):
        times = torch.arange(1.0, horizon + 1)
        here = observation.team_poses[:, None, None, :, :2]
        offset = goals[:, :, None, None] - here
        distance = offset.norm(dim=-1, keepdim=True).clamp(min=1e-6)
        xy = here + offset / distance * torch.minimum(times[:, None, None], distance)
        return Trajectories(torch.nn.functional.pad(xy, (0, 1), value=math.nan), times)


def seen(poses, agent=0):
    poses = torch.tensor([poses]).float()
    return Observation(
        agent, poses[:, None].expand(-1, 4, -1, -1), torch.full((1, 4, 222), 9.0), poses[:, 0, :2]
    )


@pytest.mark.parametrize(
    ("task", "met", "unmet"),
    [
        ("formation", [[0.6, 5, 2], [-0.7, 5, 0]], [[0, 0.6, 0], [0, -0.6, 0]]),
        ("formation:turn=true", [[0, 0.6, 0], [0, -0.6, 0]], [[0, 2, 0], [0, -2, 0]]),
        ("formation:roles=fixed", [[-0.6, 0, 0], [0.6, 0, 0]], [[0.6, 0, 0], [-0.6, 0, 0]]),
        ("formation:offsets=[[0, 0], [0, 3]]", [[1, 4, 0], [1, 1, 0]], [[0, 0, 0], [3, 0, 0]]),
        ("region:x=2:y=3", [[2, 3.5, 0], [2, 2.5, 0]], [[2, 3.5, 0], [-2, 2.5, 0]]),
        ("handover", [[0, 0, LEFT], [1.1, 0, RIGHT]], [[0, 0, LEFT], [1.1, 0, LEFT]]),
        ("handover:first=bob:second=alice", [[0, 0, LEFT], [1.1, 0, RIGHT]], [[0, 0, LEFT], [2, 0, RIGHT]]),
        ("dispersion", [[-3, 0, 0], [3.1, 0, 0]], [[-2, 0, 0], [3, 0, 0]]),
        ("follow", [[0, 0, 0], [0, 1.5, 0]], [[0, 0, 0], [0, 0.7, 0]]),
        ("pursuit:stranger=bob", [[0, 0, 0], [0, 1.1, 0]], [[0, 0, 0], [0, 1.3, 0]]),
    ],
)
def test_where_a_task_is_fulfilled(team, task, met, unmet):
    task = make_task(task, team.robots, team.ids)
    poses, still = torch.tensor([met, unmet]).float(), torch.zeros(2, 2, 2)
    assert task.success(poses).tolist() == task.success(poses, still).tolist() == [True, False]
    reward = task.reward(poses)
    assert reward[0] == 0 > reward[1]
    # where one robot drives and the other stands, only tasks on the move are fulfilled
    driving = torch.tensor([0.5, 0.0]) * torch.tensor([[1.0], [0.0]])
    assert task.success(poses[:1], driving[None]).tolist() == [not task.halts]


def test_tasks_of_two_need_two(fetch):
    for name in ("handover", "follow", "pursuit"):
        with pytest.raises(Exception, match="two robots"):
            make_task(name, [fetch])


@pytest.mark.parametrize("preset", ["paper", "best", "centralized-mp"])
@pytest.mark.parametrize("agent", [0, 1])
def test_planners_send_each_robot_to_its_own_target(team, preset, agent):
    task = make_task("formation:spacing=2", team.robots)
    observation = seen([[-2, 1, 0], [2, 1, 0]], agent)
    if preset == "paper":
        planner = HppPlanner(Straight(), task, HppConfig())
    elif preset == "best":
        planner = LatticePlanner(Straight(), task, LatticeConfig(horizon=5, occlusion_penalty=0.0))
    else:
        planner = midpoint(PlannerContext(team=team, agent=agent, task=task))
    decision = planner.plan(observation, None, EpisodeRng([0]))
    goal, belief = decision.goal, decision.belief
    offset = torch.tensor([[-1.0, 0.0], [1.0, 0.0]])[agent]
    assert goal[0].tolist() == pytest.approx((belief.goal[0] + offset).tolist(), abs=1e-5)
    if belief.imagination is not None:
        # each is imagined on its offset to its own place, not to the shared goal
        imagined = belief.imagination
        ends = imagined.trajectories.poses[0, :, -1, :, :2]
        places = imagined.goals[0, :, None] + torch.tensor([[-1.0, 0.0], [1.0, 0.0]])
        near = (places - observation.team_poses[0, :, :2]).norm(dim=-1) < 5
        assert near.any()
        assert ends[near].allclose(places[near], atol=1e-4)


def test_shared_goals_stay_shared_without_targets(team):
    task = make_task("rendezvous", team.robots)
    goal = torch.tensor([[1.0, 2.0]])
    assert own_target(task, goal, torch.zeros(1, 2, 3), 0) is goal
    planner = LatticePlanner(Straight(), task, LatticeConfig(horizon=5, occlusion_penalty=0.0))
    decision = planner.plan(seen([[-2, 1, 0], [2, 1, 0]]), None, EpisodeRng([0]))
    assert decision.goal is decision.belief.goal


@pytest.mark.parametrize("name", ["formation", "dispersion:least=3"])
def test_episodes_end_with_the_task_fulfilled(play, empty_world, name):
    team = parse_team("fetch,freight", skill="pure-pursuit")
    task = make_task(name, team.robots)
    starts = torch.tensor([[[-1.0, 0.5, 0.0], [1.0, -0.5, 1.0]]])
    episodes = play(team, task, [empty_world], starts)
    assert episodes.done_step.item() > 0
    assert task.success(episodes.poses[:, -1]).tolist() == [True]
