"""PPO training at tiny scale: snapshots, seeds, damage and cards."""

from __future__ import annotations

import io
import json
import os
import pickle
import resource
from pathlib import Path

import pytest
import torch
from hpp_skills.p2p import train as p2p

from hpp_framework.cli.main import main
from hpp_framework.core.skill import SkillTraining
from hpp_framework.plugins.weights import load_checkpoint, save_checkpoint
from hpp_framework.training import ppo
from hpp_framework.utils.errors import CheckpointError, ConfigError
from hpp_framework.utils.run_folder import read_json

pytestmark = [
    pytest.mark.filterwarnings("ignore:You have specified a mini-batch size"),
    pytest.mark.usefixtures("tiny_training"),
]
STEPS = 128


@pytest.fixture
def config(tmp_path):
    return SkillTraining(robot="fetch", out=tmp_path / "out", seed=3, steps=STEPS, threads=1)


@pytest.fixture
def snapshot(config, monkeypatch):
    """Interrupt a training after its first update."""
    begin = ppo._Progress._on_rollout_end

    def interrupt(self):
        begin(self)
        self.interrupted = True

    with monkeypatch.context() as patch:
        patch.setattr(ppo._Progress, "_on_rollout_end", interrupt)
        with pytest.raises(KeyboardInterrupt):
            p2p.train(config)
    return config.out / "resume.safetensors"


def with_options(config, **options):
    return SkillTraining(**{**vars(config), **options})


def test_an_interrupted_training_resumes_and_cleans_up(config, snapshot):
    assert snapshot.is_file()
    file = p2p.train(config)
    assert load_checkpoint(file, {})[1]["stages"][-1]["steps"] >= STEPS
    assert sorted(p.name for p in config.out.iterdir()) == [
        "curve.jsonl", "fetch.json", "fetch.safetensors", "learning_curve.png", "tensorboard",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"seed": 4}, "seed was 3, is 4"),
        ({"steps": 192}, "steps was 128, is 192"),
        ({"robot": "freight"}, "robot was 'fetch', is 'freight'"),
    ],
)
def test_the_snapshot_of_another_training_is_refused(config, snapshot, options, message):
    with pytest.raises(ConfigError, match=f"another training: {message}. Give the same options .* --out"):
        p2p.train(with_options(config, **options))
    assert snapshot.is_file()


def test_a_snapshot_with_another_start_is_refused(config, snapshot):
    from hpp_skills.p2p.skill import WEIGHTS

    with pytest.raises(ConfigError, match="init was None, is '[0-9a-f]+', recipe differs"):
        p2p.train(with_options(config, init=WEIGHTS / "freight.safetensors"))


def test_damaged_snapshots_are_named(config, snapshot):
    whole = snapshot.read_bytes()
    for content in (b"", b"no zip", whole[: len(whole) // 2]):
        snapshot.write_bytes(content)
        with pytest.raises(ConfigError, match="resume.safetensors' cannot be read: .* Delete it"):
            p2p.train(config)


class Planted:
    """Writes a file as soon as it is unpickled."""

    def __init__(self, file):
        self.file = file

    def __reduce__(self):
        return Path.touch, (self.file,)


def test_a_program_in_place_of_a_snapshot_is_refused_and_not_run(config, snapshot, tmp_path):
    trace, pickled = tmp_path / "ran", io.BytesIO()
    torch.save({"state": Planted(trace)}, pickled)
    old = snapshot.with_name("resume.zip")
    for content in (pickle.dumps(Planted(trace)), pickled.getvalue()):
        for file in (snapshot, old):
            whole = snapshot.read_bytes()
            file.write_bytes(content)
            with pytest.raises(ConfigError, match=rf"{file.name}' cannot be read: .* Delete it"):
                p2p.train(config)
            old.unlink(missing_ok=True)
            snapshot.write_bytes(whole)
    assert not trace.exists()
    pickle.loads(pickle.dumps(Planted(trace)))
    assert trace.exists()


@pytest.mark.parametrize(("name", "value"), [("steps", "many"), ("updates", None)])
def test_a_snapshot_with_wrong_counters_is_refused(config, snapshot, name, value):
    tensors, metadata = load_checkpoint(snapshot, {})
    save_checkpoint(snapshot, tensors, {**metadata, name: value})
    with pytest.raises(ConfigError, match=f"cannot be read: {name} missing or wrong. Delete it"):
        p2p.train(config)


def test_a_snapshot_of_other_parameters_is_refused(config, snapshot):
    tensors, metadata = load_checkpoint(snapshot, {})
    name = next(name for name in tensors if name.endswith(".exp_avg"))
    for changed in ({name: torch.zeros(3)}, {name.replace("exp_avg", "exp"): tensors[name].clone()}):
        save_checkpoint(snapshot, {**tensors, **changed}, metadata)
        with pytest.raises(ConfigError, match="cannot be read: .* Delete it"):
            p2p.train(config)


def test_a_snapshot_gives_back_all_that_was_learnt(config, snapshot, monkeypatch):
    kept = {}

    def compare(model, *_):
        policy = model.policy
        state = policy.optimizer.state_dict()["state"]
        kept.update(state=state, steps=model.num_timesteps, weights=policy.state_dict())
        raise KeyboardInterrupt

    monkeypatch.setattr(ppo, "_learn", compare)
    with pytest.raises(KeyboardInterrupt):
        p2p.train(config)
    tensors, metadata = load_checkpoint(snapshot, {})
    assert kept["steps"] == metadata["steps"] > 0
    for name, value in kept["weights"].items():
        assert torch.equal(value, tensors[f"model.{name}"])
    moments = [(i, n, v) for i, entry in kept["state"].items() for n, v in entry.items()]
    assert {f"adam.{i}.{n}" for i, n, _ in moments} == {n for n in tensors if n.startswith("adam.")} != set()
    for i, n, value in moments:
        assert torch.equal(value, tensors[f"adam.{i}.{n}"].reshape(value.shape))


def test_a_snapshot_without_description_is_refused(config, snapshot):
    tensors, metadata = load_checkpoint(snapshot, {})
    save_checkpoint(snapshot, tensors, {**metadata, "run": None})
    with pytest.raises(ConfigError, match="does not say what it is of"):
        p2p.train(config)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_a_full_disk_keeps_the_earlier_snapshot(config, snapshot, monkeypatch):
    before = snapshot.read_bytes()
    (config.out / "resume.safetensors.tmp").symlink_to("/dev/full")
    monkeypatch.setattr(
        ppo._Progress, "_on_rollout_end", lambda self: ppo.save_snapshot(self.model, self.out, self.run)
    )
    with pytest.raises(
        CheckpointError, match="cannot write .*resume.safetensors': .*No space left.* resumes"
    ):
        p2p.train(config)
    assert snapshot.read_bytes() == before


def test_weights_that_cannot_be_written_keep_the_earlier_ones(tmp_path):
    file = tmp_path / "a.safetensors"
    save_checkpoint(file, {"weight": torch.ones(1)}, {"seed": 1})
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    # stands for a full disk
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, hard))
    try:
        with pytest.raises(CheckpointError, match="cannot write '.*a.safetensors': .* Free space"):
            save_checkpoint(file, {"weight": torch.zeros(100_000)}, {"seed": 2})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert load_checkpoint(file, {"seed": 1})[0]["weight"] == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.json", "a.safetensors"]


def test_the_card_says_the_command_that_repeats_the_training(config, tmp_path, monkeypatch):
    from hpp_skills.p2p.skill import WEIGHTS

    monkeypatch.chdir(WEIGHTS)
    file = p2p.train(with_options(config, steps=1, init=WEIGHTS / "freight.safetensors"))
    card = load_checkpoint(file, {})[1]
    earlier = load_checkpoint(WEIGHTS / "freight.safetensors", {})[1].get("stages", [])
    assert card["stages"][:-1] == earlier
    assert card["stages"][-1]["command"] == (
        "hpp train skill p2p --robot fetch --steps 1 --seed 3 --threads 1 --init freight.safetensors"
    )
    assert json.loads(file.with_suffix(".json").read_text()) == card


@pytest.mark.parametrize("seed", [-1, 2**32])
def test_a_seed_that_cannot_be_used_is_refused_before_anything_is_built(seed, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stop:
        main(["train", "skill", "--seed", str(seed), "--out", "new"])
    assert stop.value.code == 2
    assert f"--seed must lie between 0 and 4294967295 (2**32 - 1), got {seed}" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("content", ["", "{", "[1]", "3"])
def test_json_that_is_no_object_is_named(tmp_path, content):
    file = tmp_path / "meta.json"
    file.write_text(content)
    with pytest.raises(ConfigError, match="meta.json' is damaged"):
        read_json(file)


def test_unreadable_json_is_named(tmp_path):
    with pytest.raises(ConfigError, match="cannot read .*nothing.json': No such file"):
        read_json(tmp_path / "nothing.json")
    with pytest.raises(ConfigError, match="cannot read"):
        read_json(tmp_path)
    (tmp_path / "binary.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="damaged"):
        read_json(tmp_path / "binary.json")
