"""Settings by name: of configs, of planners, on the command line."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest

from hpp_framework.cli.main import main
from hpp_framework.config.planner_choice import make_planner, make_policy, parameters, parse_planner
from hpp_framework.config.settings import altered, parse_settings, setting
from hpp_framework.core.planner import MetaPlanner, PlannerContext
from hpp_framework.evaluation.experiment import Experiment, read_experiment, run_experiment
from hpp_framework.planning.hpp.planner import HppConfig
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import ConfigError

TINY = Experiment(worlds=("simple",), planners=("hpp:predictor=constant-velocity:hysteresis=0",), episodes=1)


@pytest.fixture
def context(straight_team):
    task = hub().tasks.create("rendezvous", straight_team.robots)
    return PlannerContext(
        team=straight_team, agent=0, task=task, settings={"predictor": "constant-velocity", "horizon": 4}
    )


def test_settings_reach_nested_configs_and_leave_the_original_alone():
    before = HppConfig()
    after = altered(before, {"cem.samples": 30, "horizon": 2}, "it")
    assert (after.cem.samples, after.horizon) == (30, 2)
    assert setting(after, "cem.samples") == 30
    assert before == HppConfig()


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("horizn", 1, "Did you mean 'horizon'"),
        ("horizon", 2.5, "a whole number"), ("horizon", "x", "a whole number"),
        ("cem", 1, "e.g. 'cem."), ("horizon.more", 1, "ends at 'horizon'"),
        ("horizon", math.nan, "a whole number"), ("horizon", 0, "'horizon' must be at least 1"),
    ],
)  # fmt: skip
def test_wrong_settings_are_refused(name, value, words):
    with pytest.raises(ConfigError, match=words):
        altered(HppConfig(), {name: value}, "it")


def test_values_are_read_as_numbers_truth_or_text():
    found = parse_settings(["a=1", "b=1e-4", "c=true", "d=far-sighted", "e=x=y"], "--set")
    assert found == {"a": 1, "b": 1e-4, "c": True, "d": "far-sighted", "e": "x=y"}


def test_planners_have_settings_of_their_own_before_those_of_all(context):
    planner = make_planner("hpp:horizon=3:hysteresis=0", context)
    found = parameters(planner)
    assert found is not None
    assert (found["predictor"], found["horizon"], found["hysteresis"]) == ("constant-velocity", 3, 0.0)
    assert parameters(make_planner("centralized-rp", context)) is None


def test_a_planner_may_have_a_preset_of_its_own():
    assert parse_planner("hpp:preset=paper:horizon=2").preset == "paper"
    assert parse_planner("hpp:preset=paper:horizon=2").settings == {"horizon": 2}


@pytest.mark.parametrize("moved", ["guard", "guide"])
def test_settings_that_are_control_layers_now_are_named(moved):
    with pytest.raises(ConfigError, match=f"'{moved}' is no setting of a planner any more.*--control"):
        parse_planner(f"centralized-mp:{moved}=false")


def test_settings_that_have_another_name_now_are_named(context):
    with pytest.raises(ConfigError, match="'keep' is unknown. It is now called 'hysteresis'"):
        make_planner("hpp:keep=0.1", context)


def test_policies_are_named_like_planners(context, register):
    assert parse_planner("maddpg").is_policy
    assert not parse_planner("hpp").is_policy
    with pytest.raises(ConfigError, match="'maddpg' has no settings"):
        make_policy("maddpg:hysteresis=1", replace(context, team=parse_team("fetch,freight")))


def test_settings_of_a_planner_without_parameters_are_refused(context, tmp_path):
    with pytest.raises(ConfigError, match="'centralized-rp' has no settings"):
        make_planner("centralized-rp:hysteresis=1", context)
    for planner, message in (("centralized-rp", "has no settings"), ("centralized-mp", "is no setting of")):
        with pytest.raises(ConfigError, match=message):
            run_experiment(replace(TINY, planners=(planner,), settings={"hysteresis": 1}), tmp_path)


def test_settings_of_all_planners_reach_those_that_have_them(context):
    told = replace(context, settings={"horizon": 3, "predictor": "constant-velocity"})
    assert parameters(make_planner("hpp", told))["horizon"] == 3
    assert parameters(make_planner("centralized-mp", told)) == {"plan_every": 10}


def test_a_planner_that_ignores_settings_is_noticed(context, register):
    class Deaf(MetaPlanner):
        config = HppConfig()

        def plan(self, observation, belief, rng):
            raise AssertionError

    register("planners", "test-deaf", lambda context: Deaf())
    with pytest.raises(ConfigError, match="does not heed"):
        make_planner("test-deaf", context)


def test_settings_are_recorded_and_repeated(tmp_path):
    experiment = replace(TINY, settings={"reach": 2.0})
    run_experiment(experiment, tmp_path)
    config = json.loads((tmp_path / "config.json").read_text())
    assert config["settings"] == {"reach": 2.0}
    assert config["planner_configs"][TINY.planners[0]]["reach"] == 2.0
    assert read_experiment(tmp_path / "config.json", "evaluate") == experiment
    with pytest.raises(ConfigError, match="settings differ"):
        run_experiment(TINY, tmp_path)


def test_the_option_may_be_given_several_times(tmp_path):
    main(
        ["evaluate", "--worlds", "simple", "--planners", "hpp", "--episodes", "1", "--out", str(tmp_path),
         "--set", "predictor=constant-velocity", "--set", "horizon=3", "reach=1"]
    )  # fmt: skip
    settings = json.loads((tmp_path / "config.json").read_text())["settings"]
    assert settings == {"predictor": "constant-velocity", "horizon": 3, "reach": 1}
