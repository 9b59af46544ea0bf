"""What a benchmark ran on, and the two rates of the machine that costs are compared with."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import torch

from hpp_framework.bench.measurement import Measurement, Settings, rates, timed
from hpp_framework.utils.executor import available_cores
from hpp_framework.utils.versions import installed

PACKAGES = ("hpp-framework", "torch", "numpy", "warp-lang", "sapien", "stable-baselines3")


SIDE = 1024
"""Rows and columns of the matrices that are multiplied."""

COPIED = 1 << 26
"""Bytes that are copied, more than caches hold."""


class Product:
    """Square single-precision matrix products, as many as fill a repeat."""

    def __init__(self, settings: Settings) -> None:
        self.matrix = torch.ones(SIDE, SIDE)
        self.count = settings.pick(1, 40, 100)
        self.operations = 2 * SIDE**3 * self.count

    def __call__(self) -> None:
        """Multiply."""
        for _ in range(self.count):
            torch.mm(self.matrix, self.matrix)


def machine(settings: Settings) -> Iterator[Measurement]:
    """Matrix products and copies per second, on one core and on all: the floors of everything else."""
    product = Product(settings)
    source = torch.ones(settings.pick(1 << 10, COPIED, COPIED) // 4)
    target = torch.empty_like(source)
    count = settings.pick(1, 10, 40)

    def copy() -> None:
        for _ in range(count):
            target.copy_(source)

    for threads in dict.fromkeys((1, settings.threads)):
        torch.set_num_threads(threads)
        seconds = timed({"product": product, "copy": copy}, settings.repeats)
        gigaflops = rates(product.operations / 1e9, seconds["product"])
        # a copy reads and writes
        gigabytes = rates(2 * 4 * len(source) * count / 1e9, seconds["copy"])
        case = {"size": SIDE, "threads": threads}
        yield Measurement(name="matrix product", parameters=case, unit="Gflop/s", values=gigaflops)
        yield Measurement(name="memory copy", parameters={"threads": threads}, unit="GB/s", values=gigabytes)


def describe_machine(device: str) -> dict[str, Any]:
    """Return processor, cores, load, device, versions and command (JSON-compatible)."""
    return {
        "processor": _processor(),
        "cores": available_cores(),
        "load": [round(value, 2) for value in os.getloadavg()],
        "device": torch.cuda.get_device_name() if device.startswith("cuda") else "cpu",
        "system": platform.platform(),
        "python": platform.python_version(),
        "versions": {name: number or "not installed" for name, number in installed(PACKAGES).items()},
        "threads_variable": os.environ.get("OMP_NUM_THREADS", ""),
        "command": " ".join(["hpp", *sys.argv[1:]]),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()
