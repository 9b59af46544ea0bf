"""What a benchmark ran on; written beside its results."""

from __future__ import annotations

import os
import platform
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import torch

from hpp_framework.bench.measurement import available_cores

PACKAGES = ("hpp-framework", "torch", "numpy", "warp-lang", "sapien", "stable-baselines3")


def describe_machine(device: str) -> dict[str, Any]:
    """Return processor, cores, load, device, versions and command (JSON-compatible)."""
    return {
        "processor": _processor(),
        "cores": available_cores(),
        "load": [round(value, 2) for value in os.getloadavg()],
        "device": torch.cuda.get_device_name() if device.startswith("cuda") else "cpu",
        "system": platform.platform(),
        "python": platform.python_version(),
        "versions": {name: _version(name) for name in PACKAGES},
        "threads_variable": os.environ.get("OMP_NUM_THREADS", ""),
        "command": " ".join(["hpp", *sys.argv[1:]]),
    }


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()
