"""Recorded evaluations: they fail when any part of an agent behaves otherwise, wanted or not.

A move of code must keep every number. After a wanted change of behaviour, record them anew and say in the
commit what changed::

    python tests/golden/test_episode_golden.py
"""

from __future__ import annotations

import csv
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
import torch

from hpp_framework.evaluation.experiment import Experiment, run_experiment
from hpp_framework.plugins.builtin import DEFAULT_CONTROL

FILE = Path(__file__).with_name("episodes.npz")
EPISODES, SEED = 8, 7
FULL = "rotate-to-path,terminal-approach,yield-together,stop-on-success,safety-filter"
STOP = "stop-on-success:beyond=0,safety-filter"
CELLS: dict[str, dict[str, str]] = {
    "wall": {"world": "wall", "planner": "hpp"},
    "navigation": {"world": "navigation", "planner": "hpp"},
    "roundabout": {"world": "real-roundabout", "planner": "hpp"},
    "paper": {"world": "wall", "planner": "hpp:preset=paper", "control": STOP},
    "other-agent": {"world": "navigation", "planner": "centralized-oa", "control": STOP},
    "midpoint": {"world": "real-forest", "planner": "centralized-mp", "control": STOP},
    "rrt": {"world": "real-wall", "planner": "rrt-mp", "control": STOP},
    "maddpg": {"world": "simple", "planner": "maddpg", "control": STOP},
    "stubborn": {"world": "navigation", "planner": "stubborn:x=1:y=2", "control": STOP},
    "three": {"world": "wall", "planner": "hpp", "team": "fetch,freight,fetch"},
    "four": {"world": "wall", "planner": "hpp", "team": "fetch,freight,fetch,freight"},
    "handover": {"world": "wall", "planner": "hpp", "task": "handover"},
    "formation": {
        "world": "navigation",
        "planner": "hpp",
        "task": "formation",
        "team": "fetch,freight,fetch",
    },
    "field": {
        "world": "navigation", "planner": "hpp", "disturbances": "field", "estimator": "tracker",
        "control": DEFAULT_CONTROL,
    },
}  # fmt: skip
FIELDS = (
    "success", "time_s", "first_contact_s", "touched_obstacle", "touched_robot", "final_distance_m", "steps",
    "goal_gap_m", "agreement_s", "side_flips", "chase",
)  # fmt: skip
ELSEWHERE = 0.75
"""Share of a cell's episodes that must end alike on another processor: rounding may turn a close decision."""


def processor() -> str:
    """Name what decides how numbers are rounded."""
    lines = Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else []
    model = next(
        (line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "unknown"
    )
    return f"{model}, {torch.backends.cpu.get_cpu_capability()}"


def record(cell: str, out: Path) -> dict[str, np.ndarray]:
    """Run the episodes of one cell and return its rows and distance curves."""
    named = CELLS[cell]
    run_experiment(
        Experiment(
            worlds=(named["world"],), planners=(named["planner"],), team=named.get("team", "fetch,freight"),
            task=named.get("task", "rendezvous"), control=named.get("control", FULL), episodes=EPISODES,
            seed=SEED, disturbances=named.get("disturbances", "ideal"),
            estimator=named.get("estimator", "none"),
        ),
        out,
    )  # fmt: skip
    with (out / "episodes.csv").open() as stream:
        rows = [[float(row[name]) for name in FIELDS] for row in csv.DictReader(stream)]
    (curves,) = sorted((out / "distances").glob("*.npy"))
    return {"rows": np.array(rows), "curves": np.load(curves)}


@pytest.fixture(scope="module")
def then() -> dict[str, np.ndarray]:
    with np.load(FILE) as stored:
        return dict(stored)


@pytest.mark.slow
@pytest.mark.parametrize("cell", CELLS)
def test_episodes_are_as_recorded(cell, then, tmp_path):
    now = record(cell, tmp_path)
    rows, curves = then[f"{cell}/rows"], then[f"{cell}/curves"]
    if processor() == str(then["processor"]):
        np.testing.assert_array_equal(now["rows"], rows)
        np.testing.assert_array_equal(now["curves"], curves)
    else:
        time = FIELDS.index("time_s")
        alike = np.isclose(now["rows"][:, time], rows[:, time], atol=0.41, equal_nan=True)
        assert alike.mean() >= ELSEWHERE


if __name__ == "__main__":
    torch.set_num_threads(1)
    chosen = sys.argv[1:] or list(CELLS)
    kept = dict(np.load(FILE)) if FILE.exists() else {}
    for name in chosen:
        with tempfile.TemporaryDirectory() as folder:
            kept |= {f"{name}/{part}": values for part, values in record(name, Path(folder)).items()}
        success = kept[f"{name}/rows"][:, 0]
        print(f"{name}: {success.sum():.0f} of {len(success)}", flush=True)
    np.savez_compressed(
        FILE, processor=np.array(processor()), **{k: v for k, v in kept.items() if k != "processor"}
    )
    print(f"wrote {FILE}")
