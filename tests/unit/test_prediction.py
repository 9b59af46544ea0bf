"""Data collection, training and motion models, at tiny scale."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch

from hpp_framework.cli.main import main
from hpp_framework.core.predictor import PredictorRequest, PredictorTraining
from hpp_framework.core.types import Observation
from hpp_framework.perception.sensing import HISTORY
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import hub
from hpp_framework.plugins.weights import load_checkpoint
from hpp_framework.prediction import delta_general_pose_lidar, delta_pose_lidar, pose_lidar
from hpp_framework.prediction.collect import SCAN_UNIT, Collection, collect
from hpp_framework.prediction.constant_velocity import ConstantVelocity
from hpp_framework.prediction.dataset import TrajectoryData
from hpp_framework.prediction.far_sighted import OFFSETS, FarSighted, FarSightedNetwork
from hpp_framework.prediction.library import model_pairs
from hpp_framework.prediction.one_step import OneStepNetwork
from hpp_framework.prediction.one_step_rollout import OneStep
from hpp_framework.utils.errors import CheckpointError, ConfigError
from hpp_framework.utils.seeding import numpy_rng

FORMS = [delta_pose_lidar.FORM, pose_lidar.FORM, delta_general_pose_lidar.FORM]
TINY = Collection(trajectories=60, chunk=20, steps=85, worlds=2, seed=4)


@pytest.fixture(scope="module")
def team():
    return parse_team("fetch,freight")


@pytest.fixture(scope="module")
def folder(team, tmp_path_factory):
    out = tmp_path_factory.mktemp("data")
    assert list(collect(team, TINY, out)) == [0, 20, 40, 60]
    return out


def sample(folder, **options):
    settings = {"agent": 0, "subject": 1, "offsets": (1, 5)} | options
    return TrajectoryData(folder).sample("train", 64, numpy_rng(0, "s"), **settings)


def test_collection_resumes_and_repeats(team, folder, tmp_path):
    shutil.copytree(folder, tmp_path / "data")
    shutil.rmtree(tmp_path / "data" / "chunk-00001")
    list(collect(team, TINY, tmp_path / "data"))
    for name in ("poses", "scans", "goals", "world"):
        first = np.load(folder / "chunk-00001" / f"{name}.npy")
        assert np.array_equal(first, np.load(tmp_path / "data" / "chunk-00001" / f"{name}.npy"))


def test_the_data_do_not_depend_on_the_number_of_workers(team, folder, tmp_path):
    done = list(collect(team, TINY, tmp_path, workers=2))
    assert done == [0, 20, 40, 60]
    for file in folder.glob("chunk-*/*.npy"):
        assert file.read_bytes() == (tmp_path / file.relative_to(folder)).read_bytes()


def test_all_models_of_a_team_are_trained_and_then_left_alone(folder, tmp_path, capsys):
    command = f"train predictor delta-pose-lidar --data {folder} --out {tmp_path} --steps 8 --batch 16"
    main([*command.split(), "--workers", "2"])
    files = sorted(tmp_path.glob("*/*.safetensors"))
    assert [file.stem for file in files] == [
        "other-fetch-freight", "other-freight-fetch", "self-fetch", "self-freight",
    ]  # fmt: skip
    card = load_checkpoint(files[1], {})[1]
    assert (card["agent"], card["subject"], card["role"]) == ("freight", "fetch", "other")
    before = [file.stat().st_mtime_ns for file in files]
    main([*command.split(), "--agent", "1", "--workers", "1"])
    assert [file.stat().st_mtime_ns for file in files] == before
    assert "self-freight, step 8, is there already" in capsys.readouterr().out


def test_robots_that_are_alike_share_their_models():
    assert model_pairs(parse_team("fetch,fetch,freight")) == {
        "self-fetch": (0, 0),
        "other-fetch-fetch": (0, 1),
        "other-fetch-freight": (0, 2),
        "other-freight-fetch": (2, 0),
        "self-freight": (2, 2),
    }
    assert model_pairs(parse_team("fetch,fetch"), agent=1) == {
        "other-fetch-fetch": (1, 0),
        "self-fetch": (1, 1),
    }
    with pytest.raises(ConfigError, match="--subject 2: the team has robots 0 to 1"):
        model_pairs(parse_team("fetch,fetch"), subject=2)


def test_another_collection_is_refused(team, folder):
    with pytest.raises(ConfigError, match="another collection"):
        next(iter(collect(team, Collection(trajectories=60, chunk=20, seed=5), folder)))


def test_goals_are_common_and_some_switch(folder):
    goals = np.concatenate([np.load(c / "goals.npy") for c in folder.glob("chunk-*")])
    changes = (np.diff(goals, axis=1) != 0).any(-1).sum(1)
    assert set(changes.tolist()) == {0, 1}


def test_robots_mostly_drive_towards_the_goal(folder):
    data = [{n: np.load(c / f"{n}.npy") for n in ("poses", "goals")} for c in folder.glob("chunk-*")]
    poses = np.concatenate([d["poses"] for d in data])
    goals = np.concatenate([d["goals"] for d in data])
    distance = np.linalg.norm(poses[..., :2] - goals[:, :, None], axis=-1)
    kept = (goals[:, 0] == goals[:, -1]).all(-1)
    assert (distance[kept, -1] < distance[kept, 0]).mean() > 0.9


def test_history_begins_by_repetition_and_future_is_the_future(folder):
    batch = sample(folder)
    assert batch.subject_poses.shape == (64, HISTORY, 3)
    assert batch.future.shape == (64, 2, 3)
    step = (batch.future[:, 0, :2] - batch.subject_poses[:, -1, :2]).norm(dim=1)
    assert step.max() < 0.21  # 1 m/s for 0.2 s
    assert batch.scans.max() <= 25.0 + SCAN_UNIT


def test_future_with_another_goal_is_marked(folder):
    batch = sample(folder, offsets=(1, 65))
    assert batch.valid[:, 0].float().mean() > 0.9
    assert batch.valid[:, 1].float().mean() < 0.5


@pytest.mark.parametrize("kind", [*(form.kind for form in FORMS), "far-sighted"])
@pytest.mark.parametrize("subject", [0, 1])
def test_training_learns_resumes_and_is_refused_for_others(team, folder, tmp_path, kind, subject):
    config = PredictorTraining(
        data=folder, out=tmp_path, agent=0, subject=subject, steps=60, batch=64, seed=2
    )
    file = hub().predictor_trainers.create(kind, config)
    weights, card = load_checkpoint(file, {})
    assert card["predictor"] == kind
    assert card["command"].startswith(f"hpp train predictor {kind}")
    assert all(np.isfinite(v) for v in card["validation"].values())
    file.unlink()
    again = hub().predictor_trainers.create(kind, config)
    assert all(torch.equal(weights[n], w) for n, w in load_checkpoint(again, {})[0].items())
    with pytest.raises(CheckpointError, match="history"):
        load_checkpoint(file, {"history": 7})
    assert json.loads(file.with_suffix(".json").read_text()) == card


class Stop(Exception):
    """Cuts a training off, as a lost process would."""


def interrupted(monkeypatch, config, *, after=30):
    """Train until a snapshot is there, then a little further, and stop."""
    from hpp_framework.prediction import training

    learn = training._learn

    def cut(model, optimiser, batches, step):
        if step == after:
            raise Stop
        return learn(model, optimiser, batches, step)

    with monkeypatch.context() as patch:
        patch.setattr(training, "SNAPSHOT_EVERY", 20)
        patch.setattr(training, "VALIDATE_EVERY", 20)
        patch.setattr(training, "REPORT_EVERY", 10)
        patch.setattr(training, "_learn", cut)
        with pytest.raises(Stop):
            hub().predictor_trainers.create("far-sighted", config)


@pytest.fixture
def config(folder, tmp_path):
    return PredictorTraining(
        data=folder, out=tmp_path / "out", agent=0, subject=1, steps=40, batch=16, seed=2
    )


def test_an_interrupted_training_resumes_to_the_same_weights(config, monkeypatch):
    from hpp_framework.prediction import training

    monkeypatch.setattr(training, "REPORT_EVERY", 10)
    whole = hub().predictor_trainers.create("far-sighted", replace(config, out=config.out / "whole"))
    interrupted(monkeypatch, config)
    assert list(config.out.glob("*/*.resume.safetensors"))
    resumed = hub().predictor_trainers.create("far-sighted", config)
    weights, card = load_checkpoint(whole, {})
    again, card_again = load_checkpoint(resumed, {})
    assert all(torch.equal(weights[name], again[name]) for name in weights)
    assert card_again["curve"] == card["curve"]
    assert not list(config.out.glob("far-sighted/*resume*"))


@pytest.mark.parametrize("option", [{"seed": 3}, {"steps": 50}, {"batch": 20}, {"learning_rate": 2e-3}])
def test_the_snapshot_of_another_training_is_refused(config, monkeypatch, option):
    interrupted(monkeypatch, config)
    name, value = next(iter(option.items()))
    message = f"another training: {name} was {getattr(config, name)}, is {value}. .* another --out"
    with pytest.raises(ConfigError, match=message):
        hub().predictor_trainers.create("far-sighted", replace(config, **option))


def test_the_snapshot_of_other_data_is_refused(config, team, monkeypatch, tmp_path):
    interrupted(monkeypatch, config)
    other = replace(TINY, seed=9, trajectories=40, steps=62)
    list(collect(team, other, tmp_path / "other"))
    with pytest.raises(ConfigError, match="data differs, trajectories was 60, is 40"):
        hub().predictor_trainers.create("far-sighted", replace(config, data=tmp_path / "other"))


def test_the_learning_rate_rises_and_falls(config):
    from hpp_framework.prediction.training import WARM_UP, learning_rate

    long = replace(config, steps=10_000, learning_rate=1e-3)
    rates = [learning_rate(long, step) for step in (0, WARM_UP // 2 - 1, WARM_UP, 5_000, 9_999)]
    assert rates == pytest.approx([2e-6, 5e-4, 1e-3, 5.1e-4, 2e-5], rel=0.01)


def test_training_reports_its_error_beside_that_of_constant_velocity(config, monkeypatch, capsys):
    interrupted(monkeypatch, config)
    hub().predictor_trainers.create("far-sighted", config)
    lines = [line for line in capsys.readouterr().out.splitlines() if "held-out worlds" in line]
    assert [line.split("step ")[1].split(",")[0] for line in lines] == ["10", "20", "40"]
    assert all("error_5s_m" in line and "constant_velocity_5s_m" in line for line in lines)


def test_the_card_says_the_command_that_repeats_the_training(config):
    file = hub().predictor_trainers.create("far-sighted", replace(config, steps=2))
    assert load_checkpoint(file, {})[1]["command"] == (
        f"hpp train predictor far-sighted --data {config.data.name} --agent 0 --subject 1 --steps 2 "
        "--batch 16 --seed 2"
    )


@pytest.mark.parametrize("size", [1, 2, 3, 4, 5, 7, 10])
def test_a_batch_has_the_size_asked_for(folder, size):
    batch = TrajectoryData(folder).sample("train", size, numpy_rng(0), agent=0, subject=1, offsets=(1, 5))
    parts = [getattr(batch, part) for part in batch.__dataclass_fields__]
    assert {len(part) for part in parts if part is not None} == {size}


@pytest.mark.parametrize("batch", [1, 3])
def test_the_smallest_batches_give_finite_weights(config, batch):
    file = hub().predictor_trainers.create("far-sighted", replace(config, steps=20, batch=batch))
    assert all(torch.isfinite(value).all() for value in load_checkpoint(file, {})[0].values())


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("meta.json", b"{", "meta.json' is damaged"),
        ("meta.json", b"[]", "meta.json' is damaged"),
        ("meta.json", b'{"format": 9, "team": []}', "meta.json' does not describe"),
        ("chunk-00001/poses.npy", None, "poses.npy' is missing or damaged.* 'hpp collect' again"),
        ("chunk-00001/scans.npy", b"", "scans.npy' is missing or damaged"),
        ("chunk-00001/goals.npy", b"\x93NUMPY", "goals.npy' is missing or damaged"),
    ],
)
def test_damaged_data_are_named(folder, tmp_path, file, content, message):
    shutil.copytree(folder, tmp_path / "data")
    (tmp_path / "data" / file).unlink()
    if content is not None:
        (tmp_path / "data" / file).write_bytes(content)
    with pytest.raises(ConfigError, match=message):
        TrajectoryData(tmp_path / "data")


def test_an_array_cut_short_is_named(folder, tmp_path):
    shutil.copytree(folder, tmp_path / "data")
    file = tmp_path / "data" / "chunk-00000" / "scans.npy"
    file.write_bytes(file.read_bytes()[:-1000])
    with pytest.raises(ConfigError, match="scans.npy' is missing or damaged"):
        TrajectoryData(tmp_path / "data")


def test_a_collection_with_damaged_metadata_is_not_extended(team, folder, tmp_path):
    shutil.copytree(folder, tmp_path / "data")
    (tmp_path / "data" / "meta.json").write_text("{")
    with pytest.raises(ConfigError, match="meta.json' is damaged"):
        next(iter(collect(team, TINY, tmp_path / "data")))


def test_a_world_file_can_be_collected_in(team, tmp_path):
    world = tmp_path / "my_room.yaml"
    world.write_text("name: my room\nbounds: [-4, -3, 4, 3]\n")
    tiny = Collection(trajectories=6, chunk=3, steps=8, worlds=1, world=str(world), seed=1)
    assert list(collect(team, tiny, tmp_path / "data")) == [0, 3, 6]
    poses = np.load(tmp_path / "data" / "chunk-00000" / "poses.npy")
    assert (np.abs(poses[..., 0]) < 4).all()
    assert (np.abs(poses[..., 1]) < 3).all()


def test_folders_in_which_nothing_can_be_found_are_refused(team, tmp_path):
    def ask(folder):
        hub().predictors.create("far-sighted", PredictorRequest(team=team, agent=0, folders=(folder,)))

    with pytest.raises(ConfigError, match="--weights '.*typo' is not a folder"):
        ask(tmp_path / "typo")
    with pytest.raises(ConfigError, match="no weights of predictor 'far-sighted'.*it has: none"):
        ask(tmp_path)
    (tmp_path / "far-sighted").mkdir()
    (tmp_path / "far-sighted" / "self-fetch.resume.safetensors").write_bytes(b"")
    (tmp_path / "delta-pose-lidar").mkdir()
    (tmp_path / "delta-pose-lidar" / "self-fetch.safetensors").write_bytes(b"")
    with pytest.raises(ConfigError, match="it has: delta-pose-lidar"):
        ask(tmp_path)


def test_a_horizon_beyond_the_model_is_refused(fetch):
    model = FarSighted([FarSightedNetwork(fetch), FarSightedNetwork(fetch)], (fetch, fetch))
    with pytest.raises(ConfigError, match="1 to 15 steps of a second, but the horizon is 16"):
        model.rollout(observation(), torch.zeros(3, 1, 2), 16)


def test_missing_weights_say_what_to_do(team):
    lonely = parse_team("fetch,freight", skill="p2p")
    broken = lonely.members[1]
    stranger = replace(
        lonely, members=(lonely.members[0], replace(broken, robot=replace(broken.robot, name="rover")))
    )
    with pytest.raises(CheckpointError, match="hpp onboard p2p --with fetch,rover"):
        hub().predictors.create("far-sighted", PredictorRequest(team=stranger, agent=0))


def observation(count=3, agents=2, beams=222):
    generator = torch.Generator().manual_seed(1)
    poses = torch.randn(count, HISTORY, agents, 3, generator=generator)
    scans = 1 + 5 * torch.rand(count, HISTORY, beams, generator=generator)
    return Observation(0, poses, scans, torch.zeros(count, 2))


@pytest.mark.parametrize("agents", [2, 3])
def test_rollouts_have_the_promised_shape(fetch, agents):
    seen = observation(agents=agents)
    goals = torch.randn(3, 7, 2, generator=torch.Generator().manual_seed(2))
    models = [
        *((OneStep(form, [OneStepNetwork(222) for _ in range(agents)], 0), 5) for form in FORMS),
        (FarSighted([FarSightedNetwork(fetch) for _ in range(agents)], (fetch,) * agents), len(OFFSETS)),
        (ConstantVelocity(), 4),
    ]
    for model, horizon in models:
        out = model.rollout(seen, goals, horizon)
        assert out.poses.shape == (3, 7, horizon, agents, 3)
        assert torch.isfinite(out.poses[..., :2]).all()
        assert (out.times.diff() > 0).all()


def test_candidates_do_not_influence_each_other(fetch):
    seen = observation()
    goals = torch.randn(3, 7, 2, generator=torch.Generator().manual_seed(2))
    for model in (
        *(OneStep(form, [OneStepNetwork(222), OneStepNetwork(222)], 0) for form in FORMS),
        FarSighted([FarSightedNetwork(fetch), FarSightedNetwork(fetch)], (fetch, fetch)),
    ):
        together = model.rollout(seen, goals, 5).poses[..., :2]
        alone = torch.cat([model.rollout(seen, goals[:, i : i + 1], 5).poses[..., :2] for i in range(7)], 1)
        assert torch.allclose(together, alone, atol=1e-4)


def test_models_do_not_depend_on_where_the_world_has_its_origin():
    """Turning and moving everything turns and moves what is predicted."""
    from hpp_framework.core import geometry

    seen = observation()
    goals = torch.randn(3, 4, 2, generator=torch.Generator().manual_seed(2))
    place = torch.tensor([3.0, -2.0, 0.7])
    moved = Observation(
        0, geometry.compose(place.expand_as(seen.poses), seen.poses), seen.scans, seen.velocity
    )
    for model in (
        *(OneStep(f, [OneStepNetwork(222), OneStepNetwork(222)], 0) for f in FORMS if not f.in_world),
    ):
        here = model.rollout(seen, goals, 4).poses[..., :2]
        there = model.rollout(moved, geometry.to_world(place.expand(3, 4, 3), goals), 4).poses[..., :2]
        assert torch.allclose(geometry.to_world(place.expand(*here.shape[:-1], 3), here), there, atol=1e-3)


def test_constant_velocity_goes_on(team):
    poses = torch.zeros(1, HISTORY, 1, 3)
    poses[0, :, 0, 0] = torch.arange(HISTORY) * 0.1
    seen = Observation(0, poses, torch.ones(1, HISTORY, 222), torch.zeros(1, 2))
    out = ConstantVelocity().rollout(seen, torch.zeros(1, 1, 2), 3)
    assert torch.allclose(out.poses[0, 0, :, 0, 0], torch.tensor([0.5, 0.6, 0.7]))
