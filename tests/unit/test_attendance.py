"""Robots that join late and drop out, and noise of single robots."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

from hpp_framework.agents.scheduled import PartTimeAgent, attendance, heard
from hpp_framework.core.disturbances import NoiseModel
from hpp_framework.core.world import World
from hpp_framework.evaluation.experiment import Experiment, check_experiment, make_agents
from hpp_framework.evaluation.recorder import Recorder
from hpp_framework.evaluation.replay import Replay, replay
from hpp_framework.evaluation.rollout import run_episodes
from hpp_framework.perception.sensing import Sensing
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.errors import ConfigError
from hpp_framework.worlds.loader import resolve_world

ROOM = World(name="room", bounds=(-10.0, -10.0, 10.0, 10.0))


def experiment(tmp_path, *members, **options) -> Experiment:
    file = tmp_path / "team.yaml"
    file.write_text(yaml.safe_dump({"members": [{"robot": "fetch", **member} for member in members]}))
    default = {"worlds": ("simple",), "planners": ("centralized-mp",), "episodes": 1}
    return Experiment(**{**default, **options}, team=str(file))


def played(shown: Experiment) -> Replay:
    (found,) = replay(shown, resolve_world("simple"), [0], 0)
    return found


def test_shifts_tell_who_takes_part_when(tmp_path):
    shown = experiment(
        tmp_path, {"id": "a"}, {"id": "b", "joins_at": 1.0, "leaves_at": 3.0}, {"id": "c", "leaves_at": 2.0}
    )
    turns = shown.make_turns(shown.make_team())
    assert [(turn.first, turn.present, turn.complete) for turn in turns] == [
        (0, (0, 2), False), (5, (0, 1, 2), True), (10, (0, 1), True), (15, (0,), True),
    ]  # fmt: skip
    radii = [turn.task.radius for turn in turns]
    assert radii[1] > radii[0] == radii[2] > radii[3]
    present = attendance(turns, 20, 3)
    assert present[[0, 5, 10, 15]].tolist() == [
        [True, False, True], [True, True, True], [True, True, False], [True, False, False],
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("members", "options", "message"),
    [
        ([{"leaves_at": 1}, {"joins_at": 2}], {}, "from 1 s on nobody of the team takes part"),
        ([{}, {"joins_at": 20}], {}, "the last robot joins at 20 s, but episodes end after 20 s"),
        ([{}, {"joins_at": 2}], {"planners": ("full-communication",)}, "a ceiling plans for the whole team"),
    ],
)
def test_teams_that_cannot_be_are_refused(tmp_path, members, options, message):
    shown = experiment(tmp_path, *[{"id": f"r{i}", **each} for i, each in enumerate(members)], **options)
    with pytest.raises(ConfigError, match=message):
        check_experiment(shown, {"simple": resolve_world("simple")})


def test_nothing_is_heard_of_those_who_do_not_take_part(tmp_path):
    robots = experiment(tmp_path, {"id": "a"}, {"id": "b"}, {"id": "c"}).make_team().robots
    starts = torch.tensor([[[0.0, 0, 0], [2.0, 0, 0], [4.0, 0, 0]]])
    sensing = Sensing(robots, NoiseModel(), torch.Generator())
    sensing.reset(BatchSimulator(robots).reset([ROOM], starts))
    seen = heard(sensing.observe(2), (0, 2))
    assert seen.agent == 1
    assert seen.pose.tolist() == [[4.0, 0.0, 0.0]]
    assert seen.team_poses[0, :, 0].tolist() == [0.0, 4.0]
    assert seen.keyframes is not None
    assert seen.keyframes.poses.shape[2] == 2
    assert torch.equal(seen.scans, sensing.observe(2).scans)


def test_who_drops_out_stands_and_the_others_succeed_without_it(tmp_path):
    shown = played(
        experiment(tmp_path, {"id": "a"}, {"id": "b"}, {"id": "c", "planner": "stubborn", "leaves_at": 1.0})
    )
    episodes = shown.episodes
    driven = episodes.poses[0].diff(dim=0)[..., :2].norm(dim=-1)
    assert float(driven[:5, 2].sum()) > 0
    # 1 m/s is stopped within a second
    assert float(driven[11:, 2].max()) < 1e-3
    done = int(episodes.done_step[0])
    assert done > 5
    assert bool(shown.task.met(episodes.poses[:1, done, :2])[0])
    apart = (episodes.poses[0, done, 0, :2] - episodes.poses[0, done, 1, :2]).norm()
    assert float(episodes.spread()[0, done]) == pytest.approx(float(apart))
    record = shown.record(0, {})
    assert record.agents[2].goals[-1] == pytest.approx(record.poses[-2, 2, :2], abs=1e-3)


def test_no_episode_is_over_before_everybody_has_joined(tmp_path):
    members = [{"id": "a"}, {"id": "b"}, {"id": "c", "joins_at": 12.0}]
    shown = played(experiment(tmp_path, *members))
    driven = shown.episodes.poses[0].diff(dim=0)[..., :2].norm(dim=-1)
    assert float(driven[:60, 2].max()) == 0.0
    assert float(driven[60:, 2].max()) > 0.05
    contact = int(shown.episodes.contact_step[0])
    assert contact == -1 or contact > 60


def test_a_change_of_the_team_leaves_heedless_planners_alone(tmp_path):
    shown = experiment(
        tmp_path, {"id": "a", "planner": "stubborn"}, {"id": "b"}, {"id": "c", "leaves_at": 0.4}
    )
    team = shown.make_team()
    agents = make_agents(shown, "centralized-mp", team, shown.make_turns(team), ROOM.bounds)
    robots = team.robots
    starts = torch.tensor([[[0.0, 0, 0], [2.0, 0, 0], [4.0, 3.0, 0]]])
    sensing = Sensing(robots, NoiseModel(), torch.Generator())
    sensing.reset(BatchSimulator(robots).reset([ROOM], starts))
    goals = []
    for _ in range(3):
        for index, agent in enumerate(agents):
            assert isinstance(agent, PartTimeAgent)
            agent.act(sensing.observe(index))
        goals.append([agent.goal[0].tolist() for agent in agents])
    assert goals[0][0] == goals[2][0]
    assert goals[0][1] == [2.0, 1.0]
    assert goals[2][1] == [1.0, 0.0]
    assert goals[2][2] == [4.0, 3.0]
    assert [agent.present for agent in agents] == [True, True, False]


def test_noise_of_one_robot_disturbs_what_that_robot_observes(tmp_path):
    shown = experiment(tmp_path, {"id": "a"}, {"id": "b", "noise": {"position_std": 0.5, "delay": 2}})
    team = shown.make_team()
    noises = team.noises(NoiseModel(heading_std=0.01))
    assert noises == [NoiseModel(heading_std=0.01), NoiseModel(heading_std=0.01, position_std=0.5, delay=2)]
    sensing = Sensing(team.robots, team.noises(NoiseModel()), torch.Generator().manual_seed(0))
    simulator = BatchSimulator(team.robots)
    sensing.reset(simulator.reset([ROOM], torch.tensor([[[0.0, 0, 0], [3.0, 0, 0]]])))
    for _ in range(3):
        state = simulator.step(torch.tensor([[[0.5, 0.0], [0.0, 0.0]]]))
        sensing.update(state)
    assert torch.equal(sensing.observe(0).team_poses, state.poses)
    assert not torch.allclose(sensing.observe(1).team_poses, state.poses, atol=0.01)


def test_the_team_of_the_documentation_plays(tmp_path):
    text = (Path(__file__).parents[2] / "docs" / "teams.md").read_text()
    (tmp_path / "team.yaml").write_text(re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)[0])
    shown = Experiment(worlds=("simple",), planners=("hpp",), team=str(tmp_path / "team.yaml"))
    team = shown.make_team()
    turns = shown.make_turns(team)
    assert [(turn.first, turn.present) for turn in turns] == [
        (0, (0, 1, 3)),
        (15, (0, 1, 2, 3)),
        (40, (0, 1, 2)),
    ]
    agents = make_agents(shown, "hpp", team, turns, ROOM.bounds)
    starts = torch.tensor([[[2.0, 2.0, 0], [-2.0, 2.0, 0], [-2.0, -2.0, 0], [2.0, -2.0, 0]]])
    recorder = Recorder()
    episodes = run_episodes(
        BatchSimulator(team.robots), [ROOM], starts, agents, turns, noise=team.noises(NoiseModel()), steps=17,
        watch=recorder,
    )  # fmt: skip
    driven = episodes.poses[0].diff(dim=0)[..., :2].norm(dim=-1).sum(0)
    assert bool((driven > 0.1).tolist()[0])
    record = recorder.record({}, ROOM, team, episodes, period=0.2)
    assert record.agents[1].plans[0].goal.tolist() == [2.0, 1.0]
    before, after = record.agents[0].plans[0], record.agents[2].plans[0]
    # carol is not heard of yet: she is imagined to stand
    assert np.ptp(before.paths[:, :, 2].reshape(-1, 2), axis=0).max() == 0
    assert before.paths[0, 0, 2] == pytest.approx([-2.0, -2.0], abs=0.3)
    assert after.step == 15
    assert after.paths.shape[2] == 4
