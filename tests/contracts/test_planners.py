"""What must hold of every meta-planner: decentralised, repeatable, batched equals looped."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from hpp_framework.core.disturbances import NoiseModel
from hpp_framework.core.planner import PRESETS, PlannerContext
from hpp_framework.core.predictor import Predictor
from hpp_framework.core.types import Trajectories
from hpp_framework.evaluation.rollout import build_agents
from hpp_framework.perception.sensing import Sensing
from hpp_framework.planning.hpp.lattice import LatticeConfig, LatticePlanner
from hpp_framework.planning.hpp.planner import PRESETS as hpp_presets
from hpp_framework.planning.hpp.planner import HppConfig, HppPlanner
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import hub
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.seeding import torch_rng
from hpp_framework.worlds.generators.training import training
from hpp_framework.worlds.spawn import spawn_poses

CASES = [
    ("hpp", "paper"), ("hpp", "best"), ("centralized-mp", "best"), ("centralized-oa", "best"),
    ("centralized-rp", "best"), ("rrt-mp", "paper"), ("rrt-mp", "best"), ("rrt-oa", "best"),
    ("rrt-cem", "paper"), ("rrt-cem", "best"), ("maddpg", "best"), ("hpp-options", "best"),
]  # fmt: skip


@pytest.fixture(scope="module")
def team():
    return parse_team("fetch,freight")


@pytest.fixture(scope="module")
def sensed(team):
    """Four episodes, a few steps in."""
    from hpp_framework.utils.seeding import numpy_rng

    rng = numpy_rng(5, "planners")
    worlds = [training(rng) for _ in range(4)]
    starts = torch.stack([torch.from_numpy(spawn_poses(w, team.robots, rng)).float() for w in worlds])
    simulator = BatchSimulator(team.robots)
    sensing = Sensing(team.robots, NoiseModel(), torch_rng(0, "none"))
    sensing.reset(simulator.reset(worlds, starts))
    for _ in range(6):
        sensing.update(simulator.step(torch.tensor([0.5, 0.3]).expand(4, 2, 2)))
    return sensing


def make(team, name, preset, agent=0):
    task = hub().tasks.create("rendezvous", team.robots)
    return hub().planners.create(name, PlannerContext(team=team, agent=agent, task=task, preset=preset))


@pytest.mark.parametrize(("name", "preset"), CASES)
def test_another_robots_lidar_changes_nothing(team, sensed, name, preset):
    """Agent 0 plans from its own observation: blind agent 1, and the plan of agent 0 stays the same."""
    planner = make(team, name, preset)
    goal, _ = planner.plan(sensed.observe(0), None, torch_rng(1, "a"))
    seen = sensed._scans[1].clone()
    try:
        sensed._scans[1].fill_(0.05)
        again, _ = planner.plan(sensed.observe(0), None, torch_rng(1, "a"))
    finally:
        sensed._scans[1] = seen
    assert torch.equal(goal, again)


def test_whole_episode_of_an_agent_ignores_the_other_lidar(team, sensed):
    task = hub().tasks.create("rendezvous", team.robots)
    first, second = (build_agents(team, "hpp", task, seed=3)[0] for _ in range(2))
    observation = sensed.observe(0)
    expected = [first.act(observation) for _ in range(12)]
    sensed_other = replace(sensed.observe(1), scans=torch.full_like(sensed.observe(1).scans, 1.0))
    assert sensed_other.agent == 1
    assert all(torch.equal(a, second.act(observation)) for a in expected)


@pytest.mark.parametrize(("name", "preset"), CASES)
def test_repeatable_and_finite(team, sensed, name, preset):
    planner = make(team, name, preset)
    goal, belief = planner.plan(sensed.observe(0), None, torch_rng(1, "a"))
    again, _ = planner.plan(sensed.observe(0), None, torch_rng(1, "a"))
    assert torch.equal(goal, again)
    assert torch.isfinite(goal).all()
    assert torch.isfinite(belief.mean).all()
    assert (belief.std >= 0).all()
    following, _ = planner.plan(sensed.observe(0), belief, torch_rng(1, "a"))
    assert following.shape == goal.shape


@pytest.mark.parametrize(
    ("name", "preset"),
    [c for c in CASES if c[1] != "paper" and c[0] != "centralized-rp" and not c[0].startswith("rrt-")],
)
def test_batched_equals_looped(team, sensed, name, preset):
    """Planners without randomness: each episode of a batch gets the plan it would get alone."""
    planner = make(team, name, preset)
    observation = sensed.observe(0)
    goals, _ = planner.plan(observation, None, torch_rng(1, "a"))
    for row in range(4):
        alone = observation.episodes(slice(row, row + 1))
        goal, _ = planner.plan(alone, None, torch_rng(1, "a"))
        assert torch.allclose(goal[0], goals[row], atol=1e-4)


class Arrives(Predictor):
    """Everybody is at the goal at once, except that goals left of the y axis cannot be reached."""

    def rollout(self, observation, goals, horizon):
        reach = (goals[..., :1] > 0).float()
        start = observation.team_poses[:, None, None]
        there = torch.cat([goals, torch.zeros_like(goals[..., :1])], -1)[:, :, None, None]
        poses = reach[:, :, None, None] * there + (1 - reach[:, :, None, None]) * start
        return Trajectories(poses.expand(-1, -1, horizon, -1, -1), torch.arange(1.0, horizon + 1))


@pytest.mark.parametrize("kind", ["cem", "lattice"])
def test_avoids_goals_that_cannot_be_reached(team, sensed, kind):
    task = hub().tasks.create("rendezvous", team.robots)
    planner = (
        HppPlanner(Arrives(), task, HppConfig())
        if kind == "cem"
        else LatticePlanner(Arrives(), task, LatticeConfig())
    )
    poses = torch.zeros(4, 5, 2, 3)
    poses[..., 0, 1], poses[..., 1, 1] = -2.0, 2.0
    goal, _ = planner.plan(replace(sensed.observe(0), poses=poses), None, torch_rng(0, "a"))
    assert (goal[:, 0] > 0).all()


def test_lattice_is_the_same_for_everybody(team, sensed):
    """Small disagreement about poses must not shift the candidates: they are anchored in the world."""
    planner = make(team, "hpp", "best")
    mine = planner.candidates(sensed.observe(0))
    moved = replace(sensed.observe(0), poses=sensed.observe(0).poses + 0.01)
    theirs = planner.candidates(moved)
    for row in range(4):
        a = {tuple(p) for p in mine[row].round(decimals=3).tolist()}
        b = {tuple(p) for p in theirs[row].round(decimals=3).tolist()}
        assert len(a & b) > 0.7 * len(a)


def test_a_good_goal_is_kept(team, sensed):
    task = hub().tasks.create("rendezvous", team.robots)
    planner = LatticePlanner(Arrives(), task, LatticeConfig(evidence=0.0))
    goal, belief = planner.plan(sensed.observe(0), None, torch_rng(0, "a"))
    again, _ = planner.plan(sensed.observe(0), belief, torch_rng(0, "a"))
    assert torch.equal(goal, again)


class Walks(Predictor):
    """Everybody walks 1 m towards the goal in the first second and is there in the next."""

    def rollout(self, observation, goals, horizon):
        start = observation.team_poses[:, None, :, :2]
        towards = goals[:, :, None] - start
        first = start + towards / towards.norm(dim=-1, keepdim=True).clamp(min=1.0)
        there = goals[:, :, None].expand_as(first)
        xy = torch.stack([first, *[there] * (horizon - 1)], 2)
        return Trajectories(
            torch.cat([xy, torch.zeros_like(xy[..., :1])], -1), torch.arange(1.0, horizon + 1)
        )


def north_and_south(sensed, **config):
    """Plan twice around a robot that walks north while its mate does, or the mate alone walks south."""
    task = hub().tasks.create("rendezvous", parse_team("fetch,freight").robots)
    planner = LatticePlanner(Walks(), task, LatticeConfig(keep=0.0, **config))
    poses = torch.zeros(4, 5, 2, 3)
    poses[..., 0, 0], poses[..., 1, 0] = -0.4, 0.4
    before = replace(sensed.observe(0), poses=poses, keyframes=None)
    _, belief = planner.plan(before, None, torch_rng(0, "a"))

    def after(own, mate):
        moved = poses.clone()
        moved[..., 0, 1], moved[..., 1, 1] = own, mate
        return planner.plan(replace(before, poses=moved), belief, torch_rng(0, "a"))[0]

    return after


def test_motion_is_evidence_of_goals(team, sensed):
    """Whoever sees everybody walk north wants to meet in the north, though all goals score alike."""
    goal = north_and_south(sensed, evidence=10.0, respond=False)(1.0, 1.0)
    assert (goal[:, 1] > 1.5).all()
    assert (goal[:, 0].abs() < 1.0).all()


def test_a_response_follows_the_others_and_not_oneself(team, sensed):
    """Having walked north alone is no reason to go on while the mate walks south."""
    goal = north_and_south(sensed, evidence=10.0)(1.0, -1.0)
    assert (goal[:, 1] < 0.0).all()


def test_shadows_cost_the_more_the_longer_a_team_has_not_met(team, sensed):
    task = hub().tasks.create("rendezvous", team.robots)
    config = LatticeConfig(shadow=8.0, patience=10.0, respond=False, evidence=0.0)
    planner = LatticePlanner(Walks(), task, config, team.robots[0].lidar)
    without = LatticePlanner(Walks(), task, replace(config, shadow=0.0), team.robots[0].lidar)
    seen = sensed.observe(0)
    _, belief = planner.plan(seen, None, torch_rng(0, "a"))

    def cost(plans):
        before = replace(belief, plans=plans)
        scores = [p.plan(seen, before, torch_rng(0, "a"))[1].imagination.scores for p in (without, planner)]
        return (scores[0] - scores[1]).amax().item()

    # a plan a second: half of the cost after 5 s, all of it from 10 s on
    assert [cost(plans) for plans in (0, 5, 10, 30)] == pytest.approx([0.0, 4.0, 8.0, 8.0], abs=1e-4)
    assert belief.plans == 1


@pytest.mark.parametrize("off", ["shared", "mixture", "respond"])
def test_every_switch_leaves_a_planner_that_plans(team, sensed, off):
    task = hub().tasks.create("rendezvous", team.robots)
    planner = LatticePlanner(Arrives(), task, LatticeConfig(**{off: False}))
    _, belief = planner.plan(sensed.observe(0), None, torch_rng(0, "a"))
    goal, belief = planner.plan(sensed.observe(0), belief, torch_rng(0, "a"))
    assert goal.isfinite().all()
    assert (belief.std > 0).all()


def test_a_lattice_of_ones_own_moves_with_oneself(team, sensed):
    task = hub().tasks.create("rendezvous", team.robots)
    planner = LatticePlanner(Arrives(), task, LatticeConfig(shared=False))
    seen = sensed.observe(0)
    moved = replace(seen, poses=seen.poses + torch.tensor([0.3, 0.0, 0.0]))
    shift = planner.candidates(moved) - planner.candidates(seen)
    assert torch.allclose(shift, torch.tensor([0.3, 0.0]).expand_as(shift), atol=1e-5)


def test_random_point_is_shared_and_fixed(team, sensed):
    task = hub().tasks.create("rendezvous", team.robots)
    agents = build_agents(team, "centralized-rp", task, seed=9)
    goals = [agent.plan(sensed.observe(i)).goal for i, agent in enumerate(agents)]
    assert torch.equal(goals[0], goals[1])
    assert torch.equal(agents[0].plan(sensed.observe(0)).goal, goals[0])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("spacing", 0.0), ("reach", -1.0), ("surprise", 0.0), ("temperature", 0.0), ("spacing", float("nan")),
        ("shadow", -1.0), ("shadow_depth", 0.0), ("patience", -1.0),
        ("horizon", 0), ("plan_every", 0), ("memory", 1.1), ("memory", -0.1), ("keep", -0.1),
        ("evidence", -1.0), ("reach", float("inf")), ("terminal", 1.1), ("doubt", -0.1), ("hypotheses", 0),
    ],
)  # fmt: skip
def test_unusable_parameters_of_the_lattice_are_refused(name, value):
    with pytest.raises(ConfigError, match=name):
        LatticeConfig(**{name: value})


def test_commands_offer_the_presets_that_there_are():
    assert set(PRESETS) == set(hpp_presets)
