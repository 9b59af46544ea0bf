"""Weights files: what they hold, and that wrong ones are refused with a reason."""

from __future__ import annotations

import json

import pytest
import torch

from hpp_framework.plugins.weights import load_checkpoint, load_into, save_checkpoint
from hpp_framework.utils.errors import CheckpointError

CARD = {"kind": "p2p", "robot": "fetch", "beams": 222}


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "new" / "weights.safetensors"
    save_checkpoint(path, torch.nn.Linear(3, 2).state_dict(), CARD)
    return path


def test_weights_and_card_come_back(tmp_path):
    module = torch.nn.Linear(3, 2)
    path = tmp_path / "a.safetensors"
    save_checkpoint(path, module.state_dict(), CARD)
    weights, metadata = load_checkpoint(path, {"robot": "fetch"})
    copy = torch.nn.Linear(3, 2)
    load_into(copy, weights, path)
    assert torch.equal(copy.weight, module.weight)
    assert metadata.items() >= CARD.items()


def test_the_card_beside_the_weights_is_readable(file):
    assert json.loads(file.with_suffix(".json").read_text()).items() >= CARD.items()
    assert not list(file.parent.glob("*.tmp"))


def test_weights_of_another_robot_are_refused(file):
    with pytest.raises(CheckpointError, match="made for robot = 'fetch', but 'freight' is needed"):
        load_checkpoint(file, {"robot": "freight"})
    with pytest.raises(CheckpointError, match="made for history = None, but 5 is needed"):
        load_checkpoint(file, {"history": 5})


def test_missing_files_are_named(tmp_path):
    with pytest.raises(CheckpointError, match="nothing.safetensors' does not exist"):
        load_checkpoint(tmp_path / "nothing.safetensors", {})
    with pytest.raises(CheckpointError, match="does not exist"):
        load_checkpoint(tmp_path, {})


@pytest.mark.parametrize("damage", ["truncated", "empty", "text", "flipped header"])
def test_damaged_files_are_named(file, damage):
    data = file.read_bytes()
    file.write_bytes(
        {
            "truncated": data[: len(data) // 2],
            "empty": b"",
            "text": b"this is not a weights file",
            "flipped header": b"\xff" * 8 + data[8:],
        }[damage]
    )
    with pytest.raises(CheckpointError, match="cannot be read: .* Train or copy it again"):
        load_checkpoint(file, {})


def test_a_foreign_card_is_refused(tmp_path):
    from safetensors.torch import save_file

    path = tmp_path / "foreign.safetensors"
    save_file({"weight": torch.zeros(2)}, path)
    with pytest.raises(CheckpointError, match="made for robot = None"):
        load_checkpoint(path, {"robot": "fetch"})
    save_file({"weight": torch.zeros(2)}, path, metadata={"card": "{not json"})
    with pytest.raises(CheckpointError, match="cannot be read"):
        load_checkpoint(path, {})


@pytest.mark.parametrize("module", [torch.nn.Linear(4, 2), torch.nn.Linear(3, 2, bias=False)])
def test_weights_that_do_not_fit_the_network_are_refused(file, module):
    weights, _ = load_checkpoint(file, {})
    with pytest.raises(CheckpointError, match="does not fit the network"):
        load_into(module, weights, file)


def test_saving_over_a_file_replaces_it(file):
    save_checkpoint(file, {"weight": torch.ones(1)}, {"robot": "freight"})
    weights, metadata = load_checkpoint(file, {"robot": "freight"})
    assert list(weights) == ["weight"]
    assert "beams" not in metadata


def test_weights_of_another_format_are_refused(tmp_path):
    from safetensors.torch import save_file

    path = tmp_path / "newer.safetensors"
    save_file({"weight": torch.zeros(2)}, path, metadata={"card": '{"format": 2}'})
    with pytest.raises(CheckpointError, match="has format 2, but this version reads 1"):
        load_checkpoint(path, {})
    save_file({"weight": torch.zeros(2)}, path, metadata={"card": "[]"})
    with pytest.raises(CheckpointError, match="card is no JSON object"):
        load_checkpoint(path, {})
    save_file({"weight": torch.zeros(2)}, path)
    assert load_checkpoint(path, {})[1] == {}
