"""The layer does what it says."""

from __future__ import annotations

import torch
from my_pkg.sample_layer import SampleLayer, SampleLayerConfig

from hpp_framework.core.types import Observation
from hpp_framework.testing import check_layer


def seen(distance):
    """Return what robot 0 of two observes with its teammate so many metres ahead."""
    poses = torch.tensor([[[[0.0, 0.0, 0.0], [distance, 0.0, 0.0]]]])
    return Observation(0, poses, torch.full((1, 1, 5), 10.0), torch.zeros(1, 2))


def test_it_is_a_sound_layer():
    check_layer("my-pkg/sample-layer")


def test_it_slows_down_near_a_teammate_only():
    layer = SampleLayer(SampleLayerConfig(speed=0.2))
    command, anywhere = torch.tensor([[0.9, 0.1]]), torch.zeros(1, 2)
    assert layer.filter(seen(1.0), anywhere, command).tolist() == torch.tensor([[0.2, 0.1]]).tolist()
    assert layer.filter(seen(3.0), anywhere, command).tolist() == command.tolist()
