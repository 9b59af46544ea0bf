"""Data collection, training and motion models, at tiny scale."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
import torch

from hpp_framework.checkpoints import load_checkpoint
from hpp_framework.errors import CheckpointError, ConfigError
from hpp_framework.prediction.collect import SCAN_UNIT, Collection, collect
from hpp_framework.prediction.constant_velocity import ConstantVelocity
from hpp_framework.prediction.dataset import TrajectoryData
from hpp_framework.prediction.delta import DeltaNetwork, DeltaPoseLidar
from hpp_framework.prediction.far_sighted import OFFSETS, FarSighted, FarSightedNetwork
from hpp_framework.predictor import PredictorRequest, PredictorTraining
from hpp_framework.registry import hub
from hpp_framework.seeding import numpy_rng
from hpp_framework.sensing import HISTORY
from hpp_framework.team import parse_team
from hpp_framework.types import Observation

TINY = Collection(trajectories=60, chunk=20, steps=70, worlds=2, seed=4)


@pytest.fixture(scope="module")
def team():
    return parse_team("fetch,freight")


@pytest.fixture(scope="module")
def folder(team, tmp_path_factory):
    out = tmp_path_factory.mktemp("data")
    assert list(collect(team, TINY, out)) == [20, 40, 60]
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


@pytest.mark.parametrize("kind", ["delta-pose-lidar", "far-sighted"])
@pytest.mark.parametrize("subject", [0, 1])
def test_training_learns_resumes_and_is_refused_for_others(team, folder, tmp_path, kind, subject):
    config = PredictorTraining(
        data=folder, out=tmp_path, agent=0, subject=subject, steps=60, batch=64, threads=1, seed=2
    )
    file = hub().predictor_trainers.create(kind, config)
    weights, card = load_checkpoint(file, {})
    assert card["predictor"] == kind
    assert card["command"].startswith(f"hpp train predictor {kind}")
    assert all(np.isfinite(v) for v in card["validation"].values())
    again = hub().predictor_trainers.create(kind, config)
    assert all(torch.equal(weights[n], w) for n, w in load_checkpoint(again, {})[0].items())
    with pytest.raises(CheckpointError, match="history"):
        load_checkpoint(file, {"history": 7})
    assert json.loads(file.with_suffix(".json").read_text()) == card


def test_missing_weights_say_what_to_do(team):
    lonely = parse_team("fetch,freight", skill="p2p")
    broken = lonely.members[1]
    from dataclasses import replace

    stranger = replace(
        lonely, members=(lonely.members[0], replace(broken, robot=replace(broken.robot, name="rover")))
    )
    with pytest.raises(CheckpointError, match="hpp collect"):
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
        (DeltaPoseLidar([DeltaNetwork(222) for _ in range(agents)], 0), 5),
        (FarSighted([FarSightedNetwork(fetch.lidar) for _ in range(agents)]), len(OFFSETS)),
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
        DeltaPoseLidar([DeltaNetwork(222), DeltaNetwork(222)], 0),
        FarSighted([FarSightedNetwork(fetch.lidar), FarSightedNetwork(fetch.lidar)]),
    ):
        together = model.rollout(seen, goals, 5).poses[..., :2]
        alone = torch.cat([model.rollout(seen, goals[:, i : i + 1], 5).poses[..., :2] for i in range(7)], 1)
        assert torch.allclose(together, alone, atol=1e-4)


def test_models_do_not_depend_on_where_the_world_has_its_origin(fetch):
    """Turning and moving everything turns and moves what is predicted."""
    from hpp_framework import geometry

    seen = observation()
    goals = torch.randn(3, 4, 2, generator=torch.Generator().manual_seed(2))
    place = torch.tensor([3.0, -2.0, 0.7])
    moved = Observation(
        0, geometry.compose(place.expand_as(seen.poses), seen.poses), seen.scans, seen.velocity
    )
    for model in (
        DeltaPoseLidar([DeltaNetwork(222), DeltaNetwork(222)], 0),
        FarSighted([FarSightedNetwork(fetch.lidar), FarSightedNetwork(fetch.lidar)]),
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
