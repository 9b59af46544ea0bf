"""``hpp onboard``: what is planned, skipped and refused; the tutorials of the docs run it whole."""

from __future__ import annotations

import json
import os
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import hpp_skills
import numpy as np
import pytest
import torch

from hpp_framework.cli.onboard import _own_folder, _what_next
from hpp_framework.core.predictor import PredictorRequest
from hpp_framework.onboarding import run as onboarding_run
from hpp_framework.onboarding.card import write_card
from hpp_framework.onboarding.config import make_onboarding
from hpp_framework.onboarding.run import describe_plan, onboard
from hpp_framework.onboarding.scale import SCALES, Scale
from hpp_framework.onboarding.stages import Stage, make_stages
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import Hub, Registry
from hpp_framework.plugins.weights import (
    WEIGHTS_VARIABLE,
    find_weights,
    load_checkpoint,
    save_checkpoint,
    weight_folders,
)
from hpp_framework.prediction.collect import Collection, collect
from hpp_framework.prediction.dataset import TrajectoryData
from hpp_framework.prediction.library import expected_metadata, find_model
from hpp_framework.utils.errors import CheckpointError, ConfigError

SMOKE = SCALES["smoke"]


@pytest.fixture
def rover(register, freight):
    """Register a robot that is not known yet, with as many beams as Freight."""
    register("robots", "rover", lambda: replace(freight, name="rover"))


def titles(onboarding, out):
    return [stage.title for stage in make_stages(onboarding, out, workers=2)]


@contextmanager
def no_bars(_unit):
    yield lambda *_: None


@pytest.mark.usefixtures("rover")
def test_a_robot_is_trained_with_every_teammate_and_its_own_kind(tmp_path):
    onboarding = make_onboarding("rover", ("fetch", "freight"), "p2p", SMOKE)
    planned = titles(onboarding, tmp_path)
    assert planned[0] == "train p2p for rover, 60,000 steps from fetch"
    assert planned[1:4] == [
        f"collect 40 trajectories of rover and {other}" for other in ("fetch", "freight", "rover")
    ]
    models = "self-rover, other-rover-fetch, other-fetch-rover, other-rover-freight, other-freight-rover"
    assert planned[4] == f"train 6 models, 20 steps each: {models}, other-rover-rover"
    assert [title.split()[0] for title in planned[5:]] == ["judge", *["judge", "let"] * 3]


@pytest.mark.usefixtures("rover")
def test_a_robot_that_sees_otherwise_is_trained_from_nothing(register, freight, tmp_path):
    lidar = replace(freight.lidar, beams=90)
    register("robots", "mole", lambda: replace(freight, name="mole", lidar=lidar))
    assert titles(make_onboarding("mole", ("fetch",), "p2p", SMOKE), tmp_path)[0] == (
        "train p2p for mole, 4,000 steps from nothing"
    )
    blank = make_onboarding("rover", ("fetch",), "p2p", SMOKE, init="none")
    assert titles(blank, tmp_path)[0] == "train p2p for rover, 4,000 steps from nothing"


def test_a_skill_drives_all_robots_in_all_pairs_and_needs_models_of_its_own(tmp_path):
    planned = titles(make_onboarding("dwa", ("fetch", "freight"), "p2p", SMOKE), tmp_path)
    assert planned[:3] == [
        f"collect 40 trajectories of {pair}"
        for pair in ("fetch and freight", "fetch and fetch", "freight and freight")
    ]
    assert planned[3].startswith("train 6 models, 20 steps each: self-fetch, other-fetch-freight, ")
    assert not any("train dwa" in title for title in planned)


def test_what_is_shipped_is_not_trained_again(tmp_path):
    planned = titles(make_onboarding("freight", ("fetch",), "p2p", SMOKE), tmp_path)
    assert not any(title.startswith("train") for title in planned)


@pytest.mark.usefixtures("rover")
def test_weights_of_a_newcomer_that_a_smaller_scale_made_are_made_again(tmp_path, monkeypatch):
    monkeypatch.setenv("HPP_WEIGHTS", str(tmp_path / "weights"))
    skill = tmp_path / "weights" / "p2p" / "rover.safetensors"
    skill.parent.mkdir(parents=True)
    shipped = Path(hpp_skills.__file__).parent / "p2p" / "weights" / "fetch.safetensors"
    weights, card = load_checkpoint(shipped, {})
    save_checkpoint(skill, weights, {**card, "robot": "rover", "stages": [{"steps": 16384}]})
    trial = titles(make_onboarding("rover", ("fetch",), "p2p", replace(SMOKE, further_steps=9000)), tmp_path)
    assert not any("train p2p" in title for title in trial)
    serious = titles(make_onboarding("rover", ("fetch",), "p2p", SMOKE), tmp_path)
    assert serious[0] == (
        "train p2p for rover, 60,000 steps from fetch (instead of those found, of 16,384 steps)"
    )


def test_models_of_a_newcomer_that_a_smaller_scale_made_are_made_again(tmp_path):
    longer = replace(SMOKE, predictor_steps=20_000)
    planned = titles(make_onboarding("freight", ("fetch",), "p2p", longer), tmp_path)
    models = "self-freight, other-freight-fetch, other-fetch-freight, other-freight-freight"
    assert f"train 4 models, 20,000 steps each: {models}" in planned


def test_a_skill_without_weights_or_trainer_is_refused(register, tmp_path):
    def lost(robot):
        raise CheckpointError(f"no weights for {robot.name}.")

    register("skills", "lost", lost)
    with pytest.raises(ConfigError, match="no weights for fetch. Skill 'lost' has no trainer"):
        make_stages(make_onboarding("lost", ("fetch",), "p2p", SMOKE), tmp_path, workers=1)


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        ("onboard frech", ["no robot called 'frech'. Did you mean 'fetch'"]),
        ("onboard freight --with fetch,rovr", ["no robot called 'rovr'"]),
        ("onboard dwa --with=", ["name the robots that skill 'dwa' must drive"]),
        ("onboard freight --scale smok", ["no scale called 'smok'. Did you mean 'smoke'"]),
        ("onboard freight --set trajectries=3", ["'trajectries' is no setting of scale 'standard'"]),
        ("onboard freight --set trajectories=600", ["at least 1000 trajectories are needed"]),
        ("onboard freight --init robbie", ["no robot called 'robbie'"]),
    ],
)
def test_a_mistake_gets_a_clear_message(command, expected, refused):
    refused(command, expected)


def test_an_interrupted_onboarding_goes_on_and_finds_its_own_weights(tmp_path, monkeypatch):
    ran, said = [], []

    def run(name):
        if name == "second" and ran.count("second") == 0:
            ran.append(name)
            raise KeyboardInterrupt
        ran.append(name)
        assert weight_folders(())[0] == tmp_path / "weights"

    def stages(onboarding, out, *, workers):
        return [
            Stage(
                name, 60.0, lambda name=name: name in ran and name != "second", lambda _, name=name: run(name)
            )
            for name in ("first", "second")
        ]

    monkeypatch.setattr(onboarding_run, "make_stages", stages)
    monkeypatch.setattr(onboarding_run, "check", lambda onboarding: None)
    onboarding = make_onboarding("freight", ("fetch",), "p2p", SMOKE)
    with pytest.raises(KeyboardInterrupt):
        onboard(onboarding, tmp_path, workers=1, bars=no_bars, say=said.append)
    assert WEIGHTS_VARIABLE not in os.environ
    onboard(onboarding, tmp_path, workers=1, bars=no_bars, say=said.append)
    assert ran == ["first", "second", "second"]
    assert "   1. first (done)" in said
    assert "  in all: 2 min" in describe_plan([Stage("x", 119.0, lambda: False, print)])
    with pytest.raises(ConfigError, match="another training: seed was 0, is 1"):
        onboard(replace(onboarding, seed=1), tmp_path, workers=1, bars=no_bars, say=said.append)


def test_the_card_says_what_came_out(tmp_path):
    share = {"success": 0.75, "success_low": 0.5, "success_high": 0.9}
    skill = {"world": "training", "summary": {**share, "clean": 0.5, "collision": 0.25, "freeze": 0.0}}
    error = {"predictor": "far-sighted", "role": "other", "errors": [{"seconds": 1.0, "mean_m": 0.123}]}
    cell = {
        **share, "world": "simple", "planner": "hpp", "time_median_s": 7.4, "collision_episodes": 1,
        "episodes": 8,
    }  # fmt: skip
    for kind, content in (("skill", [skill]), ("predictors", [error]), ("rendezvous", {"cells": [cell]})):
        file = tmp_path / kind / "rover,fetch" / "summary.json"
        file.parent.mkdir(parents=True)
        file.write_text(json.dumps(content))
    text = write_card(make_onboarding("freight", ("fetch",), "p2p", SMOKE), tmp_path).read_text()
    assert "# Robot `freight`" in text
    assert "| `rover,fetch` | `training` | 0.75 (0.50 to 0.90) | 0.50 | 0.25 | 0.00 |" in text
    assert "| `rover,fetch` | other | `far-sighted` | 0.12 | - |" in text
    assert "| `rover,fetch` | `simple` | `hpp` | 0.75 (0.50 to 0.90) | 7.4 s | 1/8 |" in text
    assert json.loads((tmp_path / "card.json").read_text())["onboarding"]["newcomer"] == "freight"


def test_a_scale_that_holds_nothing_out_is_refused():
    with pytest.raises(ConfigError, match="at least 40 trajectories are needed"):
        Scale(trajectories=20, chunk=20)


def test_weights_of_another_skill_are_passed_over_in_folders_that_nobody_asked_for(tmp_path):
    """A package may bring models of its own skill for a robot that has others already."""
    team = parse_team("freight,freight", skill="dwa")
    expected = expected_metadata("far-sighted", *team.members, own=True)
    for folder, skill in (("a", "p2p"), ("b", "dwa")):
        file = tmp_path / folder / "far-sighted" / "self-freight.safetensors"
        save_checkpoint(
            file, {"w": torch.ones(1)}, {**expected, "agent_skill": skill, "subject_skill": skill}
        )

    def found(order, **options):
        folders = [tmp_path / folder for folder in order]
        return find_weights(folders, "predictor", "far-sighted", "self-freight", "Train.", **options)

    for order in ("ab", "ba"):
        assert found(order, expected=expected).parts[-3] == "b"
    assert found("ab", expected=expected, asked=1).parts[-3] == "a"
    with pytest.raises(CheckpointError, match="made for agent_skill = 'p2p', but 'dwa' is needed. Train."):
        found("a", expected=expected)


def test_missing_models_name_the_command_that_makes_them():
    team = parse_team("fetch,freight", skill="dwa")
    with pytest.raises(CheckpointError) as caught:
        find_model("far-sighted", PredictorRequest(team=team, agent=0), 1)
    assert "hpp onboard dwa --with fetch,freight" in str(caught.value)
    assert "--set predictor=empty-world" in str(caught.value)


def test_what_to_do_with_the_weights_names_the_folder_of_the_package(tmp_path, monkeypatch):
    folder = tmp_path / "my_robot" / "weights"
    checkpoints = Registry("checkpoint folder")
    robots = Registry("robot")
    for registry in (robots, checkpoints):
        registry.set_origin("my-robot 0.1")
    robots.add("rover", lambda: None)
    checkpoints.add("my_robot", lambda: folder)
    checkpoints.set_origin("other 1.0")
    checkpoints.add("other", lambda: tmp_path)
    monkeypatch.setattr(
        "hpp_framework.plugins.registry.hub", lambda: Hub(robots=robots, checkpoints=checkpoints)
    )
    assert _own_folder("rover") == folder
    weights = Path("runs") / "rover" / "weights"
    assert f"cp -r runs/rover/weights/. {folder}/\n" in _what_next(weights, folder)
    monkeypatch.chdir(tmp_path)
    said = _what_next(weights, folder)
    assert "cp -r runs/rover/weights/. my_robot/weights/\n" in said
    assert f"HPP_WEIGHTS={tmp_path}/runs/rover/weights" in said
    assert "MY_PKG/weights/" in _what_next(weights, None)


def test_folders_of_the_environment_come_before_those_of_plugins(tmp_path, monkeypatch):
    one, other = tmp_path / "one", tmp_path / "other"
    one.mkdir()
    other.mkdir()
    monkeypatch.setenv(WEIGHTS_VARIABLE, f"{one}{os.pathsep}{other}")
    assert weight_folders((tmp_path,))[:3] == [tmp_path, one, other]


def test_a_folder_of_the_environment_that_does_not_exist_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv(WEIGHTS_VARIABLE, f"{tmp_path}{os.pathsep}{tmp_path / 'nowhere'}")
    with pytest.raises(CheckpointError, match="HPP_WEIGHTS names '.*nowhere', which is no folder"):
        weight_folders(())


def test_every_robot_learns_from_scans_as_wide_as_its_own(register, freight, tmp_path):
    lidar = replace(freight.lidar, beams=90)
    register("robots", "mole", lambda: replace(freight, name="mole", lidar=lidar))
    team = parse_team("freight,mole", skill="pure-pursuit")
    config = Collection(trajectories=4, chunk=2, worlds=1, steps=12, world="simple")
    assert list(collect(team, config, tmp_path))[-1] == 4
    data = TrajectoryData(tmp_path)
    for agent, beams in enumerate((222, 90)):
        batch = data.sample(
            "train", 3, np.random.default_rng(0), agent=agent, subject=0, offsets=(1,), keyframes=2
        )
        assert batch.scans.shape[-1] == batch.future_scans.shape[-1] == beams
        assert batch.keyframes is not None
        assert batch.keyframes.scans.shape[-1] == beams
        assert batch.scans.min() > 0
