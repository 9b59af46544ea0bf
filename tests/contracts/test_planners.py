"""What must hold of every planner and policy: decentralised, repeatable, batched equals looped."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from hpp_framework.agents.build import AgentConfig, build_agents
from hpp_framework.core.disturbances import Disturbances
from hpp_framework.core.planner import PRESETS, Decision, MetaPlanner, PlannerContext, certain
from hpp_framework.core.predictor import Predictor
from hpp_framework.core.skill import Skill
from hpp_framework.core.team import Team
from hpp_framework.core.types import Trajectories
from hpp_framework.episodes.core import EpisodeBatch
from hpp_framework.planning.hpp.lattice import LatticeConfig, LatticePlanner
from hpp_framework.planning.hpp.planner import PRESETS as hpp_presets
from hpp_framework.planning.hpp.planner import HppConfig, HppPlanner
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import hub
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.seeding import EpisodeRng, numpy_rng
from hpp_framework.worlds.generators.training import training
from hpp_framework.worlds.spawn import spawn_poses

CASES = [
    ("hpp", "paper"), ("hpp", "best"), ("centralized-mp", "best"), ("centralized-oa", "best"),
    ("centralized-rp", "best"), ("rrt-mp", "paper"), ("rrt-mp", "best"), ("rrt-oa", "best"),
    ("rrt-cem", "paper"), ("rrt-cem", "best"), ("hpp-options", "best"),
]  # fmt: skip


@pytest.fixture(scope="module")
def team():
    return parse_team("fetch,freight")


@pytest.fixture(scope="module")
def sensed(team):
    """Four episodes, a few steps in."""
    rng = numpy_rng(5, "planners")
    worlds = [training(rng) for _ in range(4)]
    starts = torch.stack([torch.from_numpy(spawn_poses(w, team.robots, rng)).float() for w in worlds])
    batch = EpisodeBatch(BatchSimulator(team.robots))
    batch.begin(worlds, starts, range(4))
    for _ in range(6):
        batch.step(torch.tensor([0.5, 0.3]).expand(4, 2, 2))
    return batch


def make(team, name, preset, agent=0):
    task = hub().tasks.create("rendezvous", team.robots)
    return hub().planners.create(name, PlannerContext(team=team, agent=agent, task=task, preset=preset))


def rng():
    return EpisodeRng(range(4))


class Spies(MetaPlanner):
    """Goes where the next robot's lidar sees the farthest, which no robot can know."""

    plan_every = 5

    def plan(self, observation, belief, rng):
        farthest = observation.privileged.observations[1].scan.argmax(1)
        goal = observation.pose[:, :2] + torch.stack([farthest / 50, 1 - farthest / 100], -1)
        return Decision(goal, certain(goal))


def commands_of_the_first(team, agents, steps, *, blind):
    """Return what robot 0 is sent in each step, and all poses; robot 1's lidar may see nothing at all."""
    worlds = [training(numpy_rng(6, "disturbed", row)) for row in range(2)]
    starts = [spawn_poses(world, team.robots, numpy_rng(6, "starts")) for world in worlds]
    noise = [Disturbances(), Disturbances(lost_beams=float(blind))]
    batch = EpisodeBatch(BatchSimulator(team.robots), disturbances=noise)
    batch.begin(worlds, torch.from_numpy(np.stack(starts)).float(), range(2))
    for agent in agents:
        agent.reset(range(2))
    commands, poses = [], [batch.state.poses]
    for _ in range(steps):
        seen = batch.observe_all()
        sent = torch.stack([agent.act(own) for agent, own in zip(agents, seen, strict=True)], 1)
        commands.append(sent[:, 0])
        poses.append(batch.step(sent).poses)
    return torch.stack(commands, 1), torch.stack(poses, 1)


def check_decentralised(team, config, steps):
    """Fail if robot 0 does anything else because robot 1's lidar is disturbed for a whole episode.

    Once robot 1 has gone elsewhere for that, robot 0 may notice it by the poses that it hears of. So each
    episode counts until the poses of the two runs differ.
    """
    task = hub().tasks.create("rendezvous", team.robots)
    agents = build_agents(team, task, config, (-10, -10, 10, 10))
    commands, poses = commands_of_the_first(team, agents, steps, blind=False)
    disturbed, there = commands_of_the_first(team, agents, steps, blind=True)
    compared = 0
    for row in range(len(poses)):
        same = (poses[row] == there[row]).flatten(1).all(1)[:-1].to(torch.int64).cumprod(0).bool()
        assert torch.equal(commands[row, same], disturbed[row, same])
        compared += int(same.sum())
    return compared


STILL = "test-still"


@pytest.fixture(scope="module")
def half_still():
    """Return a team whose second robot stands, so that its poses never tell what it sees."""
    if STILL not in hub().skills:
        hub().skills.add(STILL, lambda robot: Stands())
    first, second = parse_team("fetch,freight").members
    # there are motion models of the shipped skill only
    wrong = {second.id: second}
    return Team(
        (replace(first, believes=wrong), replace(second, skill=STILL, control="none", believes=wrong))
    )


class Stands(Skill):
    def act(self, observation, goal):
        return torch.zeros_like(observation.velocity)


# a planner that chooses its skills drives the second robot too
@pytest.mark.parametrize(("name", "preset"), [case for case in CASES if case[0] != "hpp-options"])
def test_another_robots_lidar_changes_nothing(half_still, name, preset):
    """Robot 1 stands, with its lidar disturbed for an episode: robot 0 drives on as it does anyway."""
    # nothing else may cut the comparison short
    steps = 12
    compared = check_decentralised(half_still, AgentConfig(planner=name, preset=preset), steps)
    assert compared == 2 * steps


@pytest.mark.parametrize("name", ["hpp", "maddpg", "hpp-options"])
def test_another_moving_robots_lidar_changes_nothing_before_its_poses_tell(team, name):
    assert check_decentralised(team, AgentConfig(planner=name), 8) >= 2


def test_a_planner_that_reads_another_robots_lidar_is_caught(half_still):
    with pytest.raises(AssertionError):
        check_decentralised(half_still, AgentConfig(planner=lambda context: Spies()), 12)


@pytest.mark.parametrize(("name", "preset"), CASES)
def test_repeatable_and_finite(team, sensed, name, preset):
    planner = make(team, name, preset)
    decision = planner.plan(sensed.observe(0), None, rng())
    again = planner.plan(sensed.observe(0), None, rng())
    assert torch.equal(decision.goal, again.goal)
    assert torch.isfinite(decision.goal).all()
    assert torch.isfinite(decision.belief.mean).all()
    assert (decision.belief.std >= 0).all()
    following = planner.plan(sensed.observe(0), decision.belief, rng())
    assert following.goal.shape == decision.goal.shape


@pytest.mark.parametrize(("name", "preset"), CASES)
def test_batched_equals_looped(team, sensed, name, preset):
    """Each episode of a batch gets the plan that it would get alone, bit for bit."""
    planner = make(team, name, preset)
    observation = sensed.observe(0)
    together = planner.plan(observation, None, rng()).goal
    for row in range(4):
        alone = planner.plan(observation.episodes(slice(row, row + 1)), None, EpisodeRng([row])).goal
        assert torch.equal(alone[0], together[row])


class Arrives(Predictor):
    """All are at the goal at once, except that goals left of the y axis cannot be reached."""

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
    goal = planner.plan(replace(sensed.observe(0), poses=poses), None, rng()).goal
    assert (goal[:, 0] > 0).all()


def test_lattice_is_the_same_for_all(team, sensed):
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
    planner = LatticePlanner(Arrives(), task, LatticeConfig(likelihood_weight=0.0))
    first = planner.plan(sensed.observe(0), None, rng())
    again = planner.plan(sensed.observe(0), first.belief, rng())
    assert torch.equal(first.goal, again.goal)


class Walks(Predictor):
    """All walk 1 m towards the goal in the first second and is there in the next."""

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
    planner = LatticePlanner(Walks(), task, LatticeConfig(hysteresis=0.0, **config))
    poses = torch.zeros(4, 5, 2, 3)
    poses[..., 0, 0], poses[..., 1, 0] = -0.4, 0.4
    before = replace(sensed.observe(0), poses=poses, keyframes=None)
    belief = planner.plan(before, None, rng()).belief

    def after(own, mate):
        moved = poses.clone()
        moved[..., 0, 1], moved[..., 1, 1] = own, mate
        return planner.plan(replace(before, poses=moved), belief, rng()).goal

    return after


def test_motion_is_evidence_of_goals(team, sensed):
    """A robot that sees all walk north wants to meet in the north, though all goals score alike."""
    goal = north_and_south(sensed, likelihood_weight=10.0, respond=False)(1.0, 1.0)
    assert (goal[:, 1] > 1.5).all()
    assert (goal[:, 0].abs() < 1.0).all()


def test_a_response_follows_the_others_and_not_oneself(team, sensed):
    """Having walked north alone is no reason to go on while the mate walks south."""
    goal = north_and_south(sensed, likelihood_weight=10.0)(1.0, -1.0)
    assert (goal[:, 1] < 0.0).all()


def test_shadows_cost_the_more_the_longer_a_team_has_not_met(team, sensed):
    task = hub().tasks.create("rendezvous", team.robots)
    config = LatticeConfig(occlusion_penalty=8.0, patience=10.0, respond=False, likelihood_weight=0.0)
    planner = LatticePlanner(Walks(), task, config, team.robots[0].lidar)
    without = LatticePlanner(Walks(), task, replace(config, occlusion_penalty=0.0), team.robots[0].lidar)
    seen = sensed.observe(0)
    belief = planner.plan(seen, None, rng()).belief

    def cost(plans):
        before = replace(belief, plans=plans)
        scores = [p.plan(seen, before, rng()).belief.imagination.scores for p in (without, planner)]
        return (scores[0] - scores[1]).amax().item()

    # one plan per second: half of the cost after 5 s, all of it from 10 s on
    assert [cost(plans) for plans in (0, 5, 10, 30)] == pytest.approx([0.0, 4.0, 8.0, 8.0], abs=1e-4)
    assert belief.plans == 1


@pytest.mark.parametrize("off", ["shared", "mixture", "respond"])
def test_every_switch_leaves_a_planner_that_plans(team, sensed, off):
    task = hub().tasks.create("rendezvous", team.robots)
    planner = LatticePlanner(Arrives(), task, LatticeConfig(**{off: False}))
    belief = planner.plan(sensed.observe(0), None, rng()).belief
    again = planner.plan(sensed.observe(0), belief, rng())
    assert again.goal.isfinite().all()
    assert (again.belief.std > 0).all()


def test_a_lattice_of_ones_own_moves_with_oneself(team, sensed):
    task = hub().tasks.create("rendezvous", team.robots)
    planner = LatticePlanner(Arrives(), task, LatticeConfig(shared=False))
    seen = sensed.observe(0)
    moved = replace(seen, poses=seen.poses + torch.tensor([0.3, 0.0, 0.0]))
    shift = planner.candidates(moved) - planner.candidates(seen)
    assert torch.allclose(shift, torch.tensor([0.3, 0.0]).expand_as(shift), atol=1e-5)


def test_random_point_is_shared_and_fixed(team, sensed):
    task = hub().tasks.create("rendezvous", team.robots)
    agents = build_agents(team, task, AgentConfig(planner="centralized-rp"), (-10, -10, 10, 10))
    for agent in agents:
        agent.reset(range(4))
    goals = [agent.plan(sensed.observe(i)).goal for i, agent in enumerate(agents)]
    assert torch.equal(goals[0], goals[1])
    assert torch.equal(agents[0].plan(sensed.observe(0)).goal, goals[0])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("spacing", 0.0), ("reach", -1.0), ("surprise", 0.0), ("temperature", 0.0), ("spacing", float("nan")),
        ("occlusion_penalty", -1.0), ("occlusion_depth", 0.0), ("patience", -1.0),
        ("horizon", 0), ("plan_every", 0), ("forgetting_factor", 1.1), ("forgetting_factor", -0.1),
        ("hysteresis", -0.1),
        ("likelihood_weight", -1.0), ("reach", float("inf")), ("terminal", 1.1),
        ("uncertainty_penalty", -0.1), ("hypotheses", 0),
    ],
)  # fmt: skip
def test_unusable_parameters_of_the_lattice_are_refused(name, value):
    with pytest.raises(ConfigError, match=name):
        LatticeConfig(**{name: value})


def test_commands_offer_the_presets_that_there_are():
    assert set(PRESETS) == set(hpp_presets)
