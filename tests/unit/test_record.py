"""Saved episodes: what is read is what was written, and files that are none are refused."""

from __future__ import annotations

import json
import zipfile
from dataclasses import replace

import numpy as np
import pytest
import torch

from hpp_framework.core.disturbances import Disturbances
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.world import MovingObstacle, Person
from hpp_framework.evaluation.recorder import Recorder
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import ConfigError
from hpp_framework.viz import record_file
from hpp_framework.viz.film import frames
from hpp_framework.viz.record_file import FILE, GRAIN, load_record, save_record

STARTS = torch.tensor([[[-2.0, 0.0, 0.0], [2.0, 0.5, 3.0]], [[-0.4, 0.0, 0.0], [0.4, 0.0, 3.1]]])
ABOUT = {
    "world": "small", "planner": "hpp", "preset": "best", "team": "fetch,freight", "backend": "batch",
    "seed": 5001, "episode": 0,
}  # fmt: skip


def recorded(play, world, planner="hpp", index=0, steps=12):
    """Run two episodes side by side and return the record of one, and what happened in both."""
    team = parse_team("fetch,freight")
    task = hub().tasks.create("rendezvous", team.robots)
    recorder = Recorder(index=index)
    episodes = play(
        team, task, [world, world], STARTS, planner, steps=steps, watch=recorder,
        disturbances=Disturbances(position_std=0.05),
    )  # fmt: skip
    return recorder.record(
        {**ABOUT, "planner": planner}, world, team, episodes, period=CONTROL_PERIOD
    ), episodes


@pytest.fixture(scope="module")
def record(play, small_world):
    return recorded(play, small_world)[0]


def same(a, b):
    assert a.dtype.kind == b.dtype.kind
    np.testing.assert_allclose(a, b, atol=0.6 / GRAIN)


def test_a_record_holds_the_episode(play, small_world):
    record, episodes = recorded(play, small_world, index=0)
    same(record.poses, episodes.poses[0].numpy())
    for i, agent in enumerate(record.agents):
        same(agent.goals[:-1], episodes.goals[0, :, i].numpy())
        assert agent.plans[0].step == 0
        assert agent.plan_at(0) is agent.plans[0]
        for plan in agent.plans:
            same(plan.goal, agent.goals[plan.step])
            count = len(plan.candidates)
            assert plan.paths.shape == (count, len(plan.times), 2, 2)
            assert plan.scores[plan.order()[0]] == np.nanmax(plan.scores)
        # noise: the agent's own idea of the poses
        assert 0 < np.abs(agent.seen[:, :, :2] - record.poses[:, :, :2]).max() < 0.5


def test_an_episode_of_a_batch_ends_where_it_ended(play, small_world):
    record, episodes = recorded(play, small_world, index=1)
    last = int(episodes.last_step()[1])
    assert record.about["success"]
    assert last < episodes.poses.shape[1] - 1
    assert len(record.poses) == last + 1
    assert record.about["time_s"] == pytest.approx(last * CONTROL_PERIOD)
    assert record.agents[0].resting[-1]
    assert all(plan.step <= last for agent in record.agents for plan in agent.plans)


def test_people_and_doors_are_kept_and_records_without_them_still_load(play, small_world, record, tmp_path):
    door = MovingObstacle(size=(0.2, 1.0), path=((0, 0, 3), (2, 2, 3)))
    walker = Person(start=(-1.0, -2.0), waypoints=((1.0, -2.0),), speed=1.2, radius=0.3)
    busy, _ = recorded(play, replace(small_world, people=(walker,), moving=(door,)))
    read = load_record(save_record(tmp_path / "busy.npz", busy))
    steps = len(busy.poses)
    assert read.people.shape == (steps, 1, 4)
    assert read.people[0, 0].tolist() == pytest.approx([-1.0, -2.0, 0.0, 0.3], abs=1e-3)
    assert read.people[-1, 0, 0] > -0.5
    assert read.moving.shape == (steps, 1, 24, 2)
    middle = read.moving[:, 0].mean(1)
    np.testing.assert_allclose(middle[:, 0], np.minimum(np.arange(steps) * CONTROL_PERIOD, 2), atol=2e-3)
    quiet = load_record(save_record(tmp_path / "quiet.npz", record))
    assert quiet.people is None
    assert quiet.moving is None
    with np.load(tmp_path / "quiet.npz") as archive:
        assert not {"people", "moving"} & set(archive.files)
    pictures = [next(iter(frames(told))) for told in (read, replace(read, people=None, moving=None))]
    assert (pictures[0] != pictures[1]).any()


def test_planners_that_imagine_nothing_are_recorded_too(play, small_world):
    record, _ = recorded(play, small_world, planner="centralized-mp")
    plan = record.agents[0].plans[0]
    assert plan.candidates.shape == (0, 2)
    assert plan.chosen() is None
    assert plan.order() == []


def test_what_is_read_is_what_was_written(record, tmp_path):
    file = save_record(tmp_path / "new" / FILE, record)
    assert [path.name for path in file.parent.iterdir()] == [FILE]
    assert file.stat().st_size < 500_000
    for place in (file, file.parent):
        again = load_record(place)
        assert again.about == record.about
        assert again.period == record.period
        for robot, other in zip(record.robots, again.robots, strict=True):
            assert other == replace(robot, body=other.body)
        same(again.poses, record.poses)
        assert again.ground.bounds == record.ground.bounds
        for name in ("boxes", "boxes_touched", "discs", "lines"):
            same(getattr(again.ground, name), getattr(record.ground, name))
        for mine, theirs in zip(record.agents, again.agents, strict=True):
            assert mine.id == theirs.id
            for name in ("seen", "scans", "goals", "resting"):
                same(getattr(mine, name), getattr(theirs, name))
            assert [plan.step for plan in mine.plans] == [plan.step for plan in theirs.plans]
            for plan, other in zip(mine.plans, theirs.plans, strict=True):
                for name in ("goal", "mean", "std", "candidates", "scores", "paths", "times"):
                    same(getattr(plan, name), getattr(other, name))


def test_the_file_holds_no_pickles(record, tmp_path):
    with np.load(save_record(tmp_path / FILE, record), allow_pickle=False) as archive:
        assert all(archive[name].dtype.kind in "fbiu" for name in archive.files)


def damaged(file, how):
    content = file.read_bytes()
    if how == "cut off":
        file.write_bytes(content[: len(content) // 2])
    elif how == "flipped":
        middle = content.index(b"0.seen") + 2000
        file.write_bytes(
            content[:middle] + bytes(255 - b for b in content[middle : middle + 64]) + content[middle + 64 :]
        )
    elif how == "array missing":
        with np.load(file) as archive:
            arrays = {name: archive[name] for name in archive.files if name != "0.scans"}
        np.savez(file, **arrays)
    elif how == "wrong shape":
        with np.load(file) as archive:
            arrays = {name: archive[name] for name in archive.files}
        np.savez(file, **{**arrays, "1.goals": arrays["1.goals"][:-1]})
    elif how == "wrong header":
        change_header(file, bounds=[1, 2])


def change_header(file, **changes):
    with np.load(file) as archive:
        arrays = {name: archive[name] for name in archive.files}
    header = {**json.loads(arrays["header"].tobytes()), **changes}
    np.savez(file, **{**arrays, "header": np.frombuffer(json.dumps(header).encode(), np.uint8)})


@pytest.mark.parametrize("how", ["cut off", "flipped", "array missing", "wrong shape", "wrong header"])
def test_damaged_files_are_named(record, how, tmp_path):
    file = save_record(tmp_path / FILE, record)
    damaged(file, how)
    with pytest.raises(ConfigError, match="damaged"):
        load_record(file)


@pytest.mark.parametrize("content", [b"", b"no episode", b"\x93NUMPY", "zip", "npz", "npy", "pickle"])
def test_foreign_files_are_refused(content, tmp_path):
    file = tmp_path / FILE
    if content == "zip":
        with zipfile.ZipFile(file, "w") as archive:
            archive.writestr("a.txt", "text")
    elif content == "npz":
        np.savez(file, poses=np.zeros((3, 2, 3)))
    elif content in ("npy", "pickle"):
        with file.open("wb") as stream:
            np.save(stream, np.array([{}] if content == "pickle" else [1.0]), allow_pickle=True)
    else:
        file.write_bytes(content)
    with pytest.raises(ConfigError, match="is no episode"):
        load_record(file)


def test_missing_files_and_other_formats_are_said(record, tmp_path):
    with pytest.raises(ConfigError, match="there is no episode"):
        load_record(tmp_path)
    file = save_record(tmp_path / FILE, record)
    change_header(file, format=99)
    with pytest.raises(ConfigError, match="has format 99, but this version reads 1"):
        load_record(file)


def test_an_interrupted_write_keeps_the_old_file(record, tmp_path, monkeypatch):
    file = save_record(tmp_path / FILE, record)
    before = file.read_bytes()

    def full(stream, **_):
        stream.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(record_file.np, "savez_compressed", full)
    with pytest.raises(ConfigError, match="No space left"):
        save_record(file, record)
    assert file.read_bytes() == before
    assert list(tmp_path.iterdir()) == [file]
