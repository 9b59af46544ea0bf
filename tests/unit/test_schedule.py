"""Robots that join late and drop out, and noise of single robots."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

from hpp_framework.agents.build import build_scheduled_agents
from hpp_framework.agents.scheduled import ScheduledAgent, restricted
from hpp_framework.core.disturbances import IDEAL, Disturbances
from hpp_framework.core.schedule import presence
from hpp_framework.core.world import World
from hpp_framework.episodes.core import EpisodeBatch
from hpp_framework.evaluation.experiment import Experiment, check_experiment
from hpp_framework.evaluation.recorder import Recorder
from hpp_framework.evaluation.replay import Replay, replay
from hpp_framework.evaluation.rollout import run_episodes
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.errors import ConfigError
from hpp_framework.worlds.loader import resolve_world

ROOM = World(name="room", bounds=(-10.0, -10.0, 10.0, 10.0))


def experiment(tmp_path, *members, **options) -> Experiment:
    file = tmp_path / "team.yaml"
    file.write_text(yaml.safe_dump({"members": [{"robot": "fetch", **member} for member in members]}))
    default = {"worlds": ("simple",), "planners": ("centralized-mp",), "episodes": 1}
    default |= {"disturbances": "ideal", "estimator": "none"}
    return Experiment(**{**default, **options}, team=str(file))


def played(shown: Experiment) -> Replay:
    (found,) = replay(shown, resolve_world("simple"), [0])
    return found


def test_stages_tell_who_takes_part_when(tmp_path):
    shown = experiment(
        tmp_path, {"id": "a"}, {"id": "b", "joins_at": 1.0, "leaves_at": 3.0}, {"id": "c", "leaves_at": 2.0}
    )
    schedule = shown.make_schedule(shown.make_team())
    assert [(stage.first, stage.present, stage.complete) for stage in schedule] == [
        (0, (0, 2), False), (5, (0, 1, 2), True), (10, (0, 1), True), (15, (0,), True),
    ]  # fmt: skip
    radii = [stage.task.radius for stage in schedule]
    assert radii[1] > radii[0] == radii[2] > radii[3]
    present = presence(schedule, 20, 3)
    assert present[[0, 5, 10, 15]].tolist() == [
        [True, False, True], [True, True, True], [True, True, False], [True, False, False],
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("members", "options", "message"),
    [
        ([{"leaves_at": 1}, {"joins_at": 2}], {}, "from 1 s on no robot of the team takes part"),
        ([{}, {"joins_at": 20}], {}, "the last robot joins at 20 s, but episodes end after 20 s"),
        (
            [{}, {"joins_at": 2}],
            {"planners": ("full-communication",)},
            "an oracle: it plans for the whole team",
        ),
    ],
)
def test_teams_that_cannot_be_are_refused(tmp_path, members, options, message):
    shown = experiment(tmp_path, *[{"id": f"r{i}", **each} for i, each in enumerate(members)], **options)
    with pytest.raises(ConfigError, match=message):
        check_experiment(shown, {"simple": resolve_world("simple")})


def test_nothing_is_heard_of_robots_that_do_not_take_part(tmp_path, begun):
    robots = experiment(tmp_path, {"id": "a"}, {"id": "b"}, {"id": "c"}).make_team().robots
    starts = torch.tensor([[[0.0, 0, 0], [2.0, 0, 0], [4.0, 0, 0]]])
    whole = begun(robots, [ROOM], starts).observe(2)
    seen = restricted(whole, (0, 2))
    assert seen.agent == 1
    assert seen.pose.tolist() == [[4.0, 0.0, 0.0]]
    assert seen.team_poses[0, :, 0].tolist() == [0.0, 4.0]
    assert seen.keyframes is not None
    assert seen.keyframes.poses.shape[2] == 2
    assert torch.equal(seen.scans, whole.scans)


def test_who_drops_out_stands_and_the_others_succeed_without_it(tmp_path):
    shown = played(
        experiment(tmp_path, {"id": "a"}, {"id": "b"}, {"id": "c", "planner": "stubborn", "leaves_at": 1.0})
    )
    episodes = shown.episodes
    driven = episodes.poses[0].diff(dim=0)[..., :2].norm(dim=-1)
    assert float(driven[:5, 2].sum()) > 0
    # 1 m/s is stopped within a second
    assert float(driven[13:, 2].max()) < 1e-3
    done = int(episodes.done_step[0])
    assert done > 5
    assert bool(shown.task.success(episodes.poses[:1, done, :2])[0])
    apart = (episodes.poses[0, done, 0, :2] - episodes.poses[0, done, 1, :2]).norm()
    assert float(episodes.spread()[0, done]) == pytest.approx(float(apart))
    record = shown.record(0, {})
    assert record.agents[2].goals[-1] == pytest.approx(record.poses[-2, 2, :2], abs=1e-3)


def test_no_episode_is_over_before_all_have_joined(tmp_path):
    members = [{"id": "a"}, {"id": "b"}, {"id": "c", "joins_at": 12.0}]
    shown = played(experiment(tmp_path, *members))
    driven = shown.episodes.poses[0].diff(dim=0)[..., :2].norm(dim=-1)
    assert float(driven[:60, 2].max()) == 0.0
    assert float(driven[60:, 2].max()) > 0.05
    contact = int(shown.episodes.contact_step[0])
    assert contact == -1 or contact > 60


def test_a_change_of_the_team_leaves_scripted_planners_alone(tmp_path, begun):
    shown = experiment(
        tmp_path, {"id": "a", "planner": "stubborn"}, {"id": "b"}, {"id": "c", "leaves_at": 0.4}
    )
    team = shown.make_team()
    schedule, config = shown.make_schedule(team), shown.agent_config("centralized-mp")
    agents = build_scheduled_agents(team, schedule, config, ROOM.bounds)
    batch = begun(team.robots, [ROOM], [[[0.0, 0, 0], [2.0, 0, 0], [4.0, 3.0, 0]]])
    for agent in agents:
        agent.reset([0])
    goals = []
    for _ in range(3):
        for index, agent in enumerate(agents):
            assert isinstance(agent, ScheduledAgent)
            agent.act(batch.observe(index))
        goals.append([agent.goal[0].tolist() for agent in agents])
    assert goals[0][0] == goals[2][0]
    assert goals[0][1] == [2.0, 1.0]
    assert goals[2][1] == [1.0, 0.0]
    assert goals[2][2] == [4.0, 3.0]
    assert [agent.present for agent in agents] == [True, True, False]


def test_noise_of_one_robot_disturbs_what_that_robot_observes(tmp_path):
    shown = experiment(tmp_path, {"id": "a"}, {"id": "b", "disturbances": "ideal:position_std=0.5"})
    team = shown.make_team()
    disturbances = replace(shown, disturbances="ideal").team_disturbances(team)
    assert disturbances == [IDEAL, Disturbances(position_std=0.5)]
    batch = EpisodeBatch(BatchSimulator(team.robots), disturbances=disturbances)
    batch.begin([ROOM], torch.tensor([[[0.0, 0, 0], [3.0, 0, 0]]]), [0])
    for _ in range(3):
        batch.step(torch.tensor([[[0.5, 0.0], [0.0, 0.0]]]))
    assert torch.equal(batch.observe(0).pose, batch.state.poses[:, 0])
    assert not torch.allclose(batch.observe(1).pose, batch.state.poses[:, 1], atol=0.01)


def test_the_team_of_the_documentation_plays(tmp_path):
    text = (Path(__file__).parents[2] / "docs" / "teams.md").read_text()
    (tmp_path / "team.yaml").write_text(re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)[0])
    shown = Experiment(worlds=("simple",), planners=("hpp",), team=str(tmp_path / "team.yaml"))
    team = shown.make_team()
    schedule = shown.make_schedule(team)
    assert [(stage.first, stage.present) for stage in schedule] == [
        (0, (0, 1, 3)),
        (15, (0, 1, 2, 3)),
        (40, (0, 1, 2)),
    ]
    agents = build_scheduled_agents(team, schedule, shown.agent_config("hpp"), ROOM.bounds)
    starts = torch.tensor([[[2.0, 2.0, 0], [-2.0, 2.0, 0], [-2.0, -2.0, 0], [2.0, -2.0, 0]]])
    recorder = Recorder()
    episodes = run_episodes(
        BatchSimulator(team.robots), [ROOM], starts, agents, schedule, seeds=[0],
        steps=17, watch=recorder,
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
