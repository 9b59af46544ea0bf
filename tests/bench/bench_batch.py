"""Speed of the batch simulator: agent-steps per second with 2 robots, 222 beams and 20 boxes.

Run with ``make bench`` or ``python tests/bench/bench_batch.py --help``.
"""

from __future__ import annotations

import argparse
import os
import statistics
import time

import numpy as np
import torch

from hpp_framework.registry import hub
from hpp_framework.seeding import numpy_rng
from hpp_framework.sim.batch import BatchSimulator
from hpp_framework.worlds.world import Box, World

TARGET = 30_000
"""Agent-steps per second on two cores that the project asks for."""


def furnished(rng: np.random.Generator, boxes: int) -> World:
    """Return a walled room of 20 x 20 m with boxes at random places."""
    return World(
        name="bench",
        bounds=(-10, -10, 10, 10),
        boxes=tuple(
            Box(
                center=(float(x), float(y)),
                size=(float(width), float(depth)),
                yaw=float(yaw),
            )
            for x, y, width, depth, yaw in rng.uniform((-9, -9, 0.4, 0.4, -3), (9, 9, 2, 2, 3), (boxes, 5))
        ),
    )


def measure(episodes: int, steps: int, repeats: int, boxes: int, worlds: int, device: str) -> list[float]:
    """Return agent-steps per second of every repeat; the first, with its compilation, is left out."""
    robots = [hub().robots.create("fetch"), hub().robots.create("freight")]
    rng = numpy_rng(0, "bench")
    pool = [furnished(rng, boxes) for _ in range(worlds)]
    simulator = BatchSimulator(robots, device=device)
    poses = torch.tensor(
        rng.uniform((-9, -9, -3), (9, 9, 3), (episodes, len(robots), 3)), dtype=torch.float32
    )
    simulator.reset([pool[index % worlds] for index in range(episodes)], poses)
    commands = torch.tensor(
        rng.uniform((0, -1), (1, 1), (steps, episodes, len(robots), 2)), dtype=torch.float32
    )
    speeds = []
    for _ in range(repeats + 1):
        started = time.perf_counter()
        for command in commands:
            state = simulator.step(command)
        float(state.scans.sum())  # waits for the device
        speeds.append(episodes * len(robots) * steps / (time.perf_counter() - started))
    return speeds[1:]


def main() -> None:
    """Print the median and the spread."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--episodes", type=int, default=1024, help="episodes side by side")
    parser.add_argument("--steps", type=int, default=50, help="control steps a repeat")
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument(
        "--boxes", type=int, default=20, help="boxes a world, the four outer walls not counted"
    )
    parser.add_argument("--worlds", type=int, default=64, help="different worlds")
    parser.add_argument("--device", default="cpu", help="cpu or cuda")
    options = parser.parse_args()
    torch.set_num_threads(1)
    speeds = measure(**vars(options))
    print(
        f"batch simulator on {options.device}, {os.cpu_count()} cores (load {os.getloadavg()[0]:.1f}): "
        f"2 robots, 222 beams, {options.boxes} boxes, {options.episodes} episodes"
    )
    print(
        f"agent-steps/s: median {statistics.median(speeds):,.0f}, "
        f"lowest {min(speeds):,.0f}, highest {max(speeds):,.0f} "
        f"over {len(speeds)} repeats (asked for: {TARGET:,})"
    )


if __name__ == "__main__":
    main()
