"""Team files: what they may say, how mistakes are named, and that what they say is what runs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from hpp_framework.agents.build import build_scheduled_agents
from hpp_framework.config.team_file import read_team_file, resolve_team
from hpp_framework.evaluation import folder
from hpp_framework.evaluation.experiment import (
    Experiment,
    check_experiment,
    read_experiment,
    run_experiment,
)
from hpp_framework.planning.baselines.centralized import CentralizedMidpoint, CentralizedOther
from hpp_framework.prediction.library import model_pairs
from hpp_framework.utils.errors import CheckpointError, ConfigError
from hpp_framework.worlds.loader import resolve_world

ALICE = {"id": "alice", "robot": "fetch"}
BOB = {"id": "bob", "robot": "freight"}


@pytest.fixture
def write(tmp_path):
    def writer(*members, **others) -> Path:
        file = tmp_path / "team.yaml"
        file.write_text(yaml.safe_dump({"members": list(members), **others}))
        return file

    return writer


def test_what_members_leave_out_comes_from_the_team_and_then_from_the_command(write):
    file = write(ALICE, {**BOB, "skill": "dwa"}, {"id": "carol", "robot": "fetch"}, planner="centralized-mp")
    team = resolve_team(str(file), skill="p2p")
    assert team.ids == ("alice", "bob", "carol")
    assert [member.robot.name for member in team.members] == ["fetch", "freight", "fetch"]
    assert [member.skill for member in team.members] == ["p2p", "dwa", "p2p"]
    assert {member.planner for member in team.members} == {"centralized-mp"}


def test_control_layers_of_the_team_hold_for_members_that_name_none(write):
    layers = "rotate-to-path,terminal-approach:near=1.2,safety-filter"
    file = write(ALICE, {**BOB, "control": "safety-filter"}, control=layers)
    assert [member.control for member in resolve_team(str(file)).members] == [layers, "safety-filter"]
    assert [member.control for member in resolve_team(str(write(ALICE))).members] == [None]
    assert read_team_file(write(ALICE)) == {"members": [ALICE]}


@pytest.mark.parametrize(
    ("members", "others", "message"),
    [
        ([], {}, "'members' is empty"),
        ([ALICE], {"skil": "p2p"}, "'skil' is not a known key. Did you mean 'skill'"),
        ([{"id": "alice"}], {}, r"'members\[0\].robot' is missing"),
        ([{**ALICE, "plan": "hpp"}], {}, r"'members\[0\].plan' is not a known key. Did you mean 'planner'"),
        ([ALICE, {**BOB, "id": "alice"}], {}, r"'members\[1\].id' 'alice' is taken"),
        ([{**ALICE, "robot": "fetsh"}], {}, r"'members\[0\].robot' names no robot .* Did you mean 'fetch'"),
        ([{**ALICE, "skill": "p2q"}], {}, r"'members\[0\].skill' names no skill .* Did you mean 'p2p'"),
        ([{**ALICE, "planner": "hp:hysteresis=0"}], {}, r"planner' names no planner .* Did you mean 'hpp'"),
        (
            [ALICE, {**BOB, "believes": {"alic": "fetch"}}],
            {},
            r"believes.alic' is not .* Did you mean 'alice'",
        ),
        ([ALICE, {**BOB, "believes": {"bob": "fetch"}}], {}, "believes.bob' is the robot itself"),
        (
            [ALICE, {**BOB, "believes": {"bob": {"robot": "fetch", "skill": "dwa"}}}],
            {},
            "is the robot itself",
        ),
        ([ALICE, {**BOB, "believes": {"alice": {"robots": "fetch"}}}], {}, "Did you mean 'robot'"),
        ([{**ALICE, "noise": {}}], {}, r"noise' is not a known key. .*disturbances"),
        (
            [ALICE],
            {"disturbances": "field:lost_beams=2"},
            "'disturbances' is wrong: .*'lost_beams' must be at most 1, got 2",
        ),
        (
            [{**ALICE, "disturbances": "filed"}],
            {},
            r"'members\[0\].disturbances' is wrong: .*Did you mean 'field'",
        ),
        ([{**ALICE, "joins_at": -1}], {}, r"joins_at' must be at least 0"),
        ([{**ALICE, "joins_at": 5, "leaves_at": 4}], {}, r"leaves_at' of 4 s is not after it joins, at 5 s"),
        ([{**ALICE, "joins_at": "5 s"}], {}, "joins_at' must be a number, got '5 s'"),
        ([{**ALICE, "weights": {"alice": "nowhere"}}], {}, "weights.alice' .* is not a folder"),
        ([3], {}, r"'members\[0\]' must be a mapping, got 3"),
        ([{**ALICE, "control": ""}], {}, r"'members\[0\].control' must be text, got ''"),
        ([ALICE], {"control": ["safety-filter"]}, r"'control' must be text, got \['safety-filter'\]"),
        ([ALICE], {"skill": "p2q"}, "'skill' names no skill .* Did you mean 'p2p'"),
    ],
)
def test_mistakes_name_file_key_and_remedy(write, members, others, message):
    file = write(*members, **others)
    with pytest.raises(ConfigError, match=message) as caught:
        read_team_file(file)
    assert str(file) in str(caught.value)


def test_a_missing_file_is_called_a_team_file(tmp_path):
    with pytest.raises(ConfigError, match="there is no such file. Check the path; team files end in"):
        resolve_team(str(tmp_path / "team.yml"))


def experiment(file: Path, **options) -> Experiment:
    return Experiment(
        **{"worlds": ("simple",), "planners": ("centralized-oa",), "episodes": 1, **options}, team=str(file)
    )


def agents_of(shown: Experiment):
    team, planner = shown.make_team(), shown.planners[0]
    return build_scheduled_agents(
        team, shown.make_schedule(team), shown.agent_config(planner), (-10, -10, 10, 10)
    )


def test_every_member_runs_its_own_planner(write):
    alice, bob = agents_of(experiment(write(ALICE, {**BOB, "planner": "centralized-mp"})))
    assert isinstance(alice.planner, CentralizedOther)
    assert isinstance(bob.planner, CentralizedMidpoint)


def test_an_oracle_is_refused_where_a_robot_plans_otherwise(write):
    shown = experiment(write(ALICE, {**BOB, "planner": "centralized-mp"}), planners=("full-communication",))
    with pytest.raises(ConfigError, match="plans for the whole team, but 'bob' has a planner of its own"):
        check_experiment(shown, {"simple": resolve_world("simple")})


def test_settings_of_the_command_do_not_reach_planners_of_members(write):
    shown = experiment(
        write(ALICE, {**BOB, "planner": "hpp:forgetting_factor=0.0"}),
        planners=("hpp",),
        settings={"surprise": 0.11},
    )
    configs = check_experiment(shown, {"simple": resolve_world("simple")})
    assert configs["hpp"]["surprise"] == 0.11
    assert configs["hpp:forgetting_factor=0.0"]["surprise"] == 0.15
    assert configs["hpp:forgetting_factor=0.0"]["forgetting_factor"] == 0.0


def test_a_run_repeats_from_its_config_without_the_file(write, tmp_path):
    file = write(ALICE, {**BOB, "planner": "centralized-mp"})
    first = experiment(file)
    run_experiment(first, tmp_path / "first")
    file.unlink()
    again = read_experiment(tmp_path / "first" / folder.CONFIG, "evaluate")
    assert again == first
    run_experiment(again, tmp_path / "again")
    one, two = ((tmp_path / each / folder.EPISODES).read_text().splitlines() for each in ("first", "again"))
    without_times = [[line.split(",")[:12] for line in lines] for lines in (one, two)]
    assert without_times[0] == without_times[1]


def test_another_team_in_the_same_file_is_another_experiment(write, tmp_path):
    run_experiment(experiment(write(ALICE, BOB)), tmp_path / "out")
    with pytest.raises(ConfigError, match="members differ"):
        run_experiment(experiment(write(ALICE, {**BOB, "planner": "centralized-mp"})), tmp_path / "out")


def models(shown: Experiment, agent: int):
    return agents_of(replace(shown, planners=("hpp",)))[agent].planner.predictor.models


def weight_of(model):
    return next(model.parameters()).flatten()[:20].tolist()


def test_a_wrong_belief_changes_the_model_of_that_robot_for_that_robot_only(write):
    right = experiment(write(ALICE, BOB))
    wrong = experiment(write(ALICE, {**BOB, "believes": {"alice": "freight"}}))
    assert weight_of(models(right, 1)[0]) != weight_of(models(wrong, 1)[0])
    assert weight_of(models(right, 1)[1]) == weight_of(models(wrong, 1)[1])
    assert weight_of(models(right, 0)[1]) == weight_of(models(wrong, 0)[1])
    recorded = json.loads(json.dumps(wrong.members))
    assert recorded["members"][1]["believes"] == {"alice": {"robot": "freight"}}


def test_a_robot_may_be_wrong_about_its_own_skill(write):
    believes = {"believes": {"bob": {"skill": "p2p"}}}
    wrong = experiment(write({**ALICE, **believes}, {**BOB, "skill": "dwa", **believes}))
    assert wrong.make_team().members[1].skill == "dwa"
    assert weight_of(models(wrong, 1)[1]) == weight_of(models(experiment(write(ALICE, BOB)), 1)[1])


def test_a_belief_without_weights_is_refused_like_any_other(write):
    shown = experiment(write(ALICE, {**BOB, "believes": {"alice": {"skill": "dwa"}}}))
    with pytest.raises(CheckpointError, match="dwa"):
        models(shown, 1)


def test_weights_of_an_ordered_pair_are_taken_from_its_folder_only(write, tmp_path):
    (tmp_path / "mine" / "far-sighted").mkdir(parents=True)
    shown = experiment(write(ALICE, {**BOB, "weights": {"alice": "mine"}}))
    with pytest.raises(CheckpointError, match="no weights 'other-freight-fetch.safetensors' .*mine"):
        models(shown, 1)


@pytest.mark.parametrize("count", [4, 8, 32])
def test_the_models_of_two_kinds_of_robots_serve_teams_of_any_size(count):
    names = model_pairs(resolve_team(",".join((["fetch", "freight"] * count)[:count])))
    assert set(names) == {
        "self-fetch", "self-freight", "other-fetch-freight", "other-freight-fetch", "other-fetch-fetch",
        "other-freight-freight",
    }  # fmt: skip
