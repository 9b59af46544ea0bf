"""Ceilings know what they claim to know, decide for everybody at once, and refuse to work in the dark."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
import torch
from hpp_framework.core.privileged import Truth

from hpp_framework.agents.hierarchical import Agent
from hpp_framework.control.stop_on_success import Rest
from hpp_framework.core.disturbances import NoiseModel
from hpp_framework.core.planner import Belief, MetaPlanner, PlannerContext
from hpp_framework.core.predictor import Predictor
from hpp_framework.core.types import Trajectories
from hpp_framework.evaluation.experiment import Experiment, run_experiment
from hpp_framework.evaluation.rollout import build_agents, run_episodes
from hpp_framework.perception.sensing import Sensing
from hpp_framework.planning.oracles.oracle import PooledPredictor, full_communication, perfect_model
from hpp_framework.planning.oracles.perfect_model import TruePredictor
from hpp_framework.plugins.build import make_skills
from hpp_framework.plugins.registry import hub
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.seeding import numpy_rng, torch_rng
from hpp_framework.worlds.generators.training import training
from hpp_framework.worlds.spawn import spawn_poses

EPISODES = 3


class Whole(MetaPlanner):
    """Sends everybody to one place."""

    def __init__(self, goal):
        self.goal = goal

    def plan(self, observation, belief, rng):
        return self.goal, Belief(self.goal, self.goal, torch.zeros_like(self.goal))


class Every(Predictor):
    """Knows times only: every 0.4 s."""

    def rollout(self, observation, goals, horizon):
        poses = torch.full(
            (*goals.shape[:2], horizon, observation.poses.shape[2], 3), float(observation.agent)
        )
        return Trajectories(poses, 0.4 * torch.arange(1, horizon + 1))


@pytest.fixture(scope="module")
def task(straight_team):
    return hub().tasks.create("rendezvous", straight_team.robots)


@pytest.fixture(scope="module")
def truth(straight_team):
    """Episodes in different rooms, a second under way; the last one is decided."""
    rng = numpy_rng(11, "ceilings")
    worlds = [training(rng) for _ in range(EPISODES)]
    starts = [torch.from_numpy(spawn_poses(world, straight_team.robots, rng)).float() for world in worlds]
    simulator = BatchSimulator(straight_team.robots, threads=1)
    sensing = Sensing(straight_team.robots, NoiseModel(), torch_rng(0, "none"))
    state = simulator.reset(worlds, torch.stack(starts))
    sensing.reset(state)
    for _ in range(5):
        state = simulator.step(torch.tensor([0.6, 0.4]).expand(EPISODES, 2, 2))
        sensing.update(state)
    running = torch.arange(EPISODES) < EPISODES - 1
    return Truth(worlds, state, [sensing.observe(i) for i in range(2)], running), simulator, sensing


@pytest.fixture
def context(straight_team, task):
    settings = {"predictor": "constant-velocity", "horizon": 5, "reach": 1.0}
    return PlannerContext(team=straight_team, agent=0, task=task, settings=settings)


def test_the_true_predictor_is_right(straight_team, task, truth):
    """What it says of a goal is what happens when everybody drives there, contacts and rest included."""
    seen, simulator, sensing = truth
    predictor = TruePredictor(straight_team, task, Every())
    predictor.truth = replace(seen, running=torch.ones(EPISODES, dtype=torch.bool))
    goals = seen.state.poses[..., :2].mean(1)[:, None] + torch.tensor([[[0.0, 0.0], [1.0, -1.0], [3.0, 1.0]]])
    found = predictor.rollout(seen.observations[0], goals, 20)
    assert found.poses.shape == (EPISODES, 3, 20, 2, 3)
    agents = [
        Agent(skill, Whole(goals[:, 1]), Rest(task, straight_team.robots), torch_rng(0, "a"))
        for skill in make_skills(straight_team)
    ]
    for step in range(1, 41):
        commands = torch.stack([agent.act(sensing.observe(i)) for i, agent in enumerate(agents)], 1)
        state = simulator.step(commands)
        sensing.update(state)
        if step % 2 == 0:
            torch.testing.assert_close(found.poses[:, 1, step // 2 - 1], state.poses, atol=1e-3, rtol=0)


def test_decided_episodes_stand_still(straight_team, task, truth):
    seen, _, _ = truth
    predictor = TruePredictor(straight_team, task, Every())
    predictor.truth = seen
    goals = torch.zeros(EPISODES, 1, 2)
    found = predictor.rollout(seen.observations[0], goals, 5).poses
    assert torch.equal(found[-1, 0, -1], seen.state.poses[-1])
    assert not torch.equal(found[0, 0, -1], seen.state.poses[0])


def test_chunks_and_rest_change_no_prediction(straight_team, task, truth, monkeypatch):
    """Episodes are imagined in chunks, and dropped as soon as they stand."""
    from hpp_framework.planning.oracles import perfect_model as true_predictor

    seen, _, _ = truth
    predictor = TruePredictor(straight_team, task, Every())
    predictor.truth = seen
    goals = torch.randn(EPISODES, 7, 2, generator=torch_rng(3, "goals"))
    whole = predictor.rollout(seen.observations[0], goals, 30).poses
    monkeypatch.setattr(true_predictor, "ROWS", 4)
    monkeypatch.setattr(true_predictor, "LOOK", 1000)
    torch.testing.assert_close(predictor.rollout(seen.observations[0], goals, 30).poses, whole)


def test_every_robot_is_predicted_by_itself(truth):
    seen, _, _ = truth
    predictor = PooledPredictor([Every(), Every()])
    predictor.truth = seen
    found = predictor.rollout(seen.observations[0], torch.zeros(EPISODES, 4, 2), 2).poses
    assert (found[..., 0, :] == 0).all()
    assert (found[..., 1, :] == 1).all()


@pytest.mark.parametrize("make", [full_communication, perfect_model])
def test_all_agents_get_one_goal_and_belief(make, context, truth):
    seen, _, _ = truth
    # a truth of one's own: answers are remembered in it
    told = Truth(seen.worlds, seen.state, seen.observations, seen.running)
    planners = [make(replace(context, agent=i)) for i in range(2)]
    answers = []
    for i, planner in enumerate(planners):
        planner.witness(told)
        answers.append(planner.plan(told.observations[i], None, torch_rng(i, "plan")))
    assert answers[0][0] is answers[1][0]
    assert answers[0][1] is answers[1][1]


@pytest.mark.parametrize("make", [full_communication, perfect_model])
def test_a_ceiling_does_not_plan_without_the_truth(make, context, truth):
    with pytest.raises(ConfigError, match="needs the true state"):
        make(context).plan(truth[0].observations[0], None, torch_rng(0, "plan"))


def test_ceilings_take_settings(context):
    settings = {**context.settings, "plan_every": 3}
    assert perfect_model(context).plan_every == 10
    assert perfect_model(replace(context, settings=settings)).plan_every == 3
    assert full_communication(replace(context, settings=settings)).config.plan_every == 3


def test_ceilings_do_not_guess_what_they_know(context):
    found = full_communication(context).config
    assert not found.respond
    assert found.evidence == 0
    paper = {"predictor": "constant-velocity"}
    assert full_communication(replace(context, preset="paper", settings=paper)).config.horizon == 5


def test_a_lone_robot_has_nothing_to_talk_about(task):
    """For a team of one the twin is the planner itself."""
    from hpp_framework.plugins.build import parse_team

    team = parse_team("fetch", skill="test-straight")
    world = training(numpy_rng(2, "alone"))
    start = torch.from_numpy(spawn_poses(world, team.robots, numpy_rng(2, "alone"))).float()[None]
    alone = hub().tasks.create("rendezvous", team.robots)
    settings = {"predictor": "constant-velocity", "horizon": 5, "reach": 1.0, "evidence": 0, "respond": False}
    goals = []
    for name in ("hpp", "full-communication"):
        agents = build_agents(team, name, alone, settings=settings)
        goals.append(run_episodes(BatchSimulator(team.robots), [world], start, agents, alone, steps=8).goals)
    assert torch.equal(*goals)


def test_an_experiment_says_where_success_was_lost(tmp_path):
    experiment = Experiment(
        worlds=("simple",), planners=("hpp", "full-communication", "perfect-model"), skill="test-straight",
        episodes=4, seed=5, settings={"predictor": "constant-velocity", "horizon": 5, "reach": 1.0},
    )  # fmt: skip
    summary = run_experiment(experiment, tmp_path)
    (blame,) = summary["blame"]
    cells = {row["planner"]: row["success"] for row in summary["cells"]}
    assert blame["silence"][0] == pytest.approx(cells["full-communication"] - cells["hpp"])
    assert blame["predictor"][0] == pytest.approx(cells["perfect-model"] - cells["full-communication"])
    assert blame["skill"][0] == pytest.approx(1 - cells["perfect-model"])
    total = blame["success"] + sum(blame[part][0] for part in ("silence", "predictor", "skill"))
    assert total == pytest.approx(1)
    assert all(row["plan_ms_median"] is None for row in summary["cells"][1:])
    assert json.loads((tmp_path / "summary.json").read_text()) == summary
