"""A recorded run of the batch simulator: it fails when physics or lidar change, wanted or not.

After a wanted change, record it anew and say in the commit what changed::

    python tests/golden/test_batch_golden.py
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from hpp_framework.core.world import Box, Cylinder, World
from hpp_framework.plugins.registry import hub
from hpp_framework.sim.batch.simulator import BatchSimulator

FILE = Path(__file__).with_name("batch.json")
STEPS = 60
EVERY = 5
TOLERANCE = 1e-3
"""Metres, radians, m/s: sines and cosines may round differently on another processor."""


def record() -> dict[str, Any]:
    """Drive Fetch and Freight past a box, a pillar, a table top and into each other."""
    world = World(
        name="golden",
        bounds=(-4, -3, 4, 3),
        boxes=(
            Box(center=(1.5, 1.2), size=(1.0, 0.6), yaw=0.4),
            Box(center=(0.3, 0.6), size=(0.8, 0.8), base=0.7, height=0.05),
        ),
        cylinders=(Cylinder(center=(-1.5, 1.5), radius=0.3),),
    )
    simulator = BatchSimulator([hub().robots.create(name) for name in ("fetch", "freight")])
    states = [simulator.reset([world], torch.tensor([[[-3.0, 0.2, 0.3], [3.0, -1.6, 3.0]]]))]
    for step in range(STEPS):
        turn = 0.6 * np.sin(0.15 * step)
        command = torch.tensor([[[0.9, turn], [0.8, -turn / 2]]], dtype=torch.float32)
        states.append(simulator.step(command))
    kept = states[::EVERY]
    return {
        "poses": [np.round(state.poses[0].numpy().astype(float), 5).tolist() for state in kept],
        "velocities": [np.round(state.velocities[0].numpy().astype(float), 5).tolist() for state in kept],
        "scans": [np.round(state.scans[0, :, ::17].numpy().astype(float), 4).tolist() for state in kept],
        "collided": [state.collided[0].tolist() for state in states],
    }


@pytest.fixture(scope="module")
def now() -> dict[str, Any]:
    return record()


@pytest.fixture(scope="module")
def then() -> dict[str, Any]:
    return json.loads(FILE.read_text())


@pytest.mark.parametrize("name", ["poses", "velocities"])
def test_motion_is_as_recorded(now, then, name):
    assert np.abs(np.array(now[name]) - np.array(then[name])).max() < TOLERANCE


def test_scans_are_as_recorded(now, then):
    # a beam that just misses an edge may hit it on another processor
    differing = np.abs(np.array(now["scans"]) - np.array(then["scans"])) > 10 * TOLERANCE
    assert differing.mean() < 0.01


def test_collisions_are_as_recorded(now, then):
    assert now["collided"] == then["collided"]


def test_the_recorded_run_touches_something_and_moves(then):
    assert np.array(then["collided"]).any(axis=0).all()
    assert np.ptp(np.array(then["poses"])[..., :2], axis=0).max(-1).min() > 1.0


if __name__ == "__main__":
    FILE.write_text(json.dumps(record()) + "\n")
    print(f"wrote {FILE}")
