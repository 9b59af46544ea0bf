"""Oracles know what they claim to know, decide for all robots at once, and refuse to work in the dark."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
import torch

from hpp_framework.agents.build import AgentConfig
from hpp_framework.agents.hierarchical import HierarchicalAgent
from hpp_framework.config.control_choice import make_control
from hpp_framework.core.control import ControlLayer
from hpp_framework.core.planner import Decision, MetaPlanner, PlannerContext, certain
from hpp_framework.core.predictor import Predictor
from hpp_framework.core.types import Privileged, Trajectories
from hpp_framework.episodes.core import EpisodeBatch
from hpp_framework.evaluation.experiment import Experiment, draw_episode, run_drawn, run_experiment
from hpp_framework.planning.oracles import perfect_model as perfect_model_module
from hpp_framework.planning.oracles.oracle import PooledPredictor, full_communication, perfect_model
from hpp_framework.planning.oracles.perfect_model import PerfectModel
from hpp_framework.plugins.build import make_skills
from hpp_framework.plugins.builtin import DEFAULT_CONTROL
from hpp_framework.plugins.registry import hub
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.seeding import EpisodeRng, numpy_rng
from hpp_framework.worlds.generators.training import training
from hpp_framework.worlds.loader import resolve_world
from hpp_framework.worlds.spawn import spawn_poses

EPISODES = 3


class Whole(MetaPlanner):
    """Sends all robots to one place."""

    plan_every = 5

    def __init__(self, goal):
        self.goal = goal

    def plan(self, observation, belief, rng):
        return Decision(self.goal, certain(self.goal))


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


@pytest.fixture
def batch(straight_team):
    """Episodes in different rooms, a second under way."""
    rng = numpy_rng(11, "oracles")
    worlds = [training(rng) for _ in range(EPISODES)]
    starts = [torch.from_numpy(spawn_poses(world, straight_team.robots, rng)).float() for world in worlds]
    batch = EpisodeBatch(BatchSimulator(straight_team.robots, threads=1))
    batch.begin(worlds, torch.stack(starts), range(EPISODES))
    for _ in range(5):
        batch.step(torch.tensor([0.6, 0.4]).expand(EPISODES, 2, 2))
    return batch


@pytest.fixture
def seen(batch):
    """What both agents observe, and what only an oracle knows; the last episode is decided."""
    batch.done_step[-1] = 5
    return batch.observe_all()


@pytest.fixture
def context(straight_team, task):
    settings = {"predictor": "constant-velocity", "horizon": 5, "reach": 1.0}
    return PlannerContext(team=straight_team, agent=0, task=task, settings=settings)


@pytest.fixture
def model(straight_team, task):
    def control(index):
        return make_control(DEFAULT_CONTROL, straight_team.robots, index, task)

    return PerfectModel(PlannerContext(team=straight_team, agent=0, task=task, control=control), Every(), 5)


def test_the_perfect_model_is_right(straight_team, model, batch):
    """What it says of a goal is what happens when all robots drive there, contacts and rest included."""
    seen = batch.observe_all()
    goals = batch.state.poses[..., :2].mean(1)[:, None] + torch.tensor(
        [[[0.0, 0.0], [1.0, -1.0], [3.0, 1.0]]]
    )
    found = model.rollout(seen[0], goals, 20)
    assert found.poses.shape == (EPISODES, 3, 20, 2, 3)
    agents = [
        HierarchicalAgent(Whole(goals[:, 1]), skill, control, index)
        for index, (skill, control) in enumerate(zip(make_skills(straight_team), model.control, strict=True))
    ]
    for agent in agents:
        agent.reset(range(EPISODES))
    for step in range(1, 41):
        batch.step(torch.stack([agent.act(batch.observe(i)) for i, agent in enumerate(agents)], 1))
        if step % 2 == 0:
            assert torch.equal(found.poses[:, 1, step // 2 - 1], batch.state.poses)


def test_waypoints_are_redirected_as_often_as_the_team_plans(model, seen):
    class Counts(ControlLayer):
        asked = 0

        def redirect(self, observation, goal, waypoint):
            Counts.asked += 1
            return waypoint

    model.control = [Counts(), Counts()]
    model.rollout(seen[0], torch.full((EPISODES, 1, 2), 5.0), 5)
    # 10 control steps, plans every 5, two robots
    assert Counts.asked == 2 * 2


def test_decided_episodes_stand_still(model, seen):
    found = model.rollout(seen[0], torch.zeros(EPISODES, 1, 2), 5).poses
    state = seen[0].privileged.state
    assert torch.equal(found[-1, 0, -1], state.poses[-1])
    assert not torch.equal(found[0, 0, -1], state.poses[0])


def test_chunks_and_rest_change_no_prediction(model, seen, monkeypatch):
    """Episodes are imagined in chunks, and dropped as soon as they stand."""
    goals = torch.randn(EPISODES, 7, 2, generator=torch.Generator().manual_seed(3))
    whole = model.rollout(seen[0], goals, 30).poses
    monkeypatch.setattr(perfect_model_module, "ROWS", 4)
    monkeypatch.setattr(perfect_model_module, "LOOK", 1000)
    torch.testing.assert_close(model.rollout(seen[0], goals, 30).poses, whole)


def test_every_robot_is_predicted_by_itself(seen):
    predictor = PooledPredictor([Every(), Every()])
    found = predictor.rollout(seen[0], torch.zeros(EPISODES, 4, 2), 2).poses
    assert (found[..., 0, :] == 0).all()
    assert (found[..., 1, :] == 1).all()


@pytest.mark.parametrize("make", [full_communication, perfect_model])
def test_all_agents_get_one_goal_and_belief(make, context, seen):
    planners = [make(replace(context, agent=i)) for i in range(2)]
    first, second = (
        planner.plan(own, None, EpisodeRng(range(EPISODES)))
        for planner, own in zip(planners, seen, strict=True)
    )
    assert first.goal is second.goal
    assert first.belief is second.belief


@pytest.mark.parametrize("make", [full_communication, perfect_model])
def test_an_oracle_does_not_plan_without_the_true_state(make, context, batch):
    with pytest.raises(ConfigError, match="needs the true state"):
        make(context).plan(batch.observe(0), None, EpisodeRng(range(EPISODES)))


def test_what_is_known_of_some_episodes_is_theirs(seen):
    first: Privileged = seen[0].privileged.episodes(slice(1))
    assert len(first.worlds) == len(first.state.poses) == len(first.running) == 1
    assert torch.equal(first.observations[1].scans, seen[1].scans[:1])
    assert first.once("question", lambda: "its own") == "its own"
    assert seen[0].privileged.once("question", lambda: "that of all") == "that of all"
    assert seen[1].privileged.once("question", lambda: "of no robot") == "that of all"


def test_oracles_take_settings(context):
    settings = {**context.settings, "plan_every": 3}
    assert perfect_model(context).plan_every == 10
    assert perfect_model(replace(context, settings=settings)).plan_every == 3
    assert full_communication(replace(context, settings=settings)).config.plan_every == 3


def test_oracles_do_not_guess_what_they_know(context):
    found = full_communication(context).config
    assert not found.respond
    assert found.likelihood_weight == 0
    paper = {"predictor": "constant-velocity"}
    assert full_communication(replace(context, preset="paper", settings=paper)).config.horizon == 5


def test_a_lone_robot_has_nothing_to_talk_about(play, straight_team):
    """For a team of one the oracle is the planner itself."""
    from hpp_framework.plugins.build import parse_team

    team = parse_team("fetch", skill="test-straight")
    world = training(numpy_rng(2, "alone"))
    start = torch.from_numpy(spawn_poses(world, team.robots, numpy_rng(2, "alone"))).float()[None]
    alone = hub().tasks.create("rendezvous", team.robots)
    settings = {"predictor": "constant-velocity", "horizon": 5, "reach": 1.0, "likelihood_weight": 0}
    settings["respond"] = False
    goals = []
    for name in ("hpp", "full-communication"):
        config = AgentConfig(planner=name, settings=settings)
        goals.append(play(team, alone, [world], start, config, steps=8).goals)
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


@pytest.mark.slow
def test_the_perfect_model_imagines_people_side_by_side_as_alone():
    base = Experiment(worlds=("crowd:people=3",), planners=("perfect-model",), episodes=2, seed=3, people=1)
    drawn = {0: draw_episode(base, "crowd", resolve_world("crowd:people=3"), 0)}
    drawn[1] = draw_episode(replace(base, people=0), "simple", resolve_world("simple"), 1)
    bounds = drawn[1][0].bounds
    drawn[0] = (replace(drawn[0][0], bounds=bounds), drawn[0][1])
    together = run_drawn(base, "perfect-model", "crowd:people=3", drawn)
    alone = run_drawn(base, "perfect-model", "crowd:people=3", {0: drawn[0]})
    steps = alone.poses.shape[1]
    assert torch.equal(together.poses[0, :steps], alone.poses[0])
