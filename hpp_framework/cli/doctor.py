"""``hpp doctor``: what works on this machine, and what to do about what does not."""

from __future__ import annotations

import platform
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass

from rich.console import Console
from rich.markup import escape

from hpp_framework.utils.versions import installed

PACKAGES = (
    "hpp-framework", "torch", "numpy", "gymnasium", "pettingzoo", "stable-baselines3", "warp-lang", "sapien",
    "trimesh", "av",
)  # fmt: skip
OPENCV = ("opencv-python-headless", "opencv-python")
"""Distributions that bring ``cv2``, into the same folder; the second draws windows and needs libGL."""
HEADLESS = f"pip install --force-reinstall --no-deps {OPENCV[0]}"
"""Puts the files without windows back and changes nothing else, so pip stays content."""
COUNTED = ("robots", "skills", "tasks", "worlds", "planners", "predictors")
"""Registries whose sizes are shown."""


@dataclass(frozen=True)
class Finding:
    """Outcome of one check: fine, or what to do about it."""

    what: str
    detail: str
    fine: bool = True
    remedy: str = ""


@dataclass(frozen=True)
class Doctor:
    """Say what works on this machine: simulators, pictures, CUDA, plugins, weights, versions."""

    def run(self) -> None:
        """Print one line a check; never fails."""
        console = Console(highlight=False)
        for check in (_python, _packages, _opencv, _plugins, _batch, _sapien, _pictures, _cuda, _weights):
            finding = _safely(check)
            mark = "[green]ok[/]  " if finding.fine else "[yellow]--[/]  "
            # remedies are there to be copied, so no line is broken
            console.print(f"{mark}{escape(finding.what)}: {escape(finding.detail)}", soft_wrap=True)
            if finding.remedy:
                console.print(f"      {escape(finding.remedy)}", soft_wrap=True)


def _safely(check: Callable[[], Finding]) -> Finding:
    try:
        return check()
    except Exception as error:
        return Finding(check.__name__.strip("_"), f"failed: {error}", fine=False)


def _python() -> Finding:
    return Finding("python", f"{sys.version.split()[0]} on {platform.platform()}")


def _packages() -> Finding:
    versions = installed(PACKAGES)
    found = [f"{name} {number}" for name, number in versions.items() if number is not None]
    missing = [name for name, number in versions.items() if number is None]
    remedy = f"pip install {' '.join(missing)}" if missing else ""
    return Finding("packages", ", ".join(found), fine=not missing, remedy=remedy)


def _opencv() -> Finding:
    try:
        import cv2
    except ImportError as error:
        return Finding("opencv", f"cannot be imported: {error}", fine=False, remedy=HEADLESS)
    found = re.search(r"^\s*GUI:\s+(\S+)", cv2.getBuildInformation(), re.MULTILINE)
    windows = found is not None and found[1] != "NONE"
    detail = f"{cv2.__version__}, {'with' if windows else 'without'} windows"
    if windows and None not in installed(OPENCV).values():
        detail += f"; the files of {OPENCV[1]} lie over those of {OPENCV[0]}"
        return Finding("opencv", detail, fine=False, remedy=HEADLESS)
    return Finding("opencv", detail)


def _plugins() -> Finding:
    from hpp_framework.plugins.registry import hub

    registries = hub().registries()
    counts = [f"{sum(1 for _ in registries[name])} {name}" for name in COUNTED]
    reasons = [plugin.reason for plugin in hub().broken]
    for registry in registries.values():
        for name in registry.clashes():
            reasons.append(registry.clash(name))
    detail = ", ".join(counts)
    if reasons:
        detail += f"; {len(reasons)} {'problem' if len(reasons) == 1 else 'problems'}"
    return Finding("plugins", detail, fine=not reasons, remedy="\n      ".join(reasons))


def _batch() -> Finding:
    _drive("batch")
    return Finding("batch simulator", "works")


def _sapien() -> Finding:
    _drive("sapien")
    return Finding("sapien simulator", "works")


def _drive(backend: str) -> None:
    """Drive a robot for one step."""
    import torch

    from hpp_framework.core.robot import DriveLimits, Lidar, RobotSpec
    from hpp_framework.core.world import World
    from hpp_framework.sim import make_simulator

    # no plugin's robot: this is about the simulator
    robot = RobotSpec(
        name="disc", footprint_radius=0.3, profile_radius=0.2, height=0.4, mass=50.0,
        drive=DriveLimits(speed=(0.0, 1.0), turn_rate=3.0, acceleration=0.5, turn_acceleration=1.5),
        lidar=Lidar(
            beams=10, field_of_view=3.0, mount=(0.25, 0.0, 0.0), height=0.3, min_range=0.05, max_range=25.0,
            noise_std=0.0,
        ),
    )  # fmt: skip
    with make_simulator(backend, [robot]) as simulator:
        simulator.reset([World(name="test")], torch.zeros(1, 1, 3))
        simulator.step(torch.ones(1, 1, 2))


def _pictures() -> Finding:
    from hpp_framework.sim.sapien.render import rendering_problem

    problem = rendering_problem()
    if problem is None:
        return Finding("3-D pictures", "work (Vulkan)")
    return Finding(
        "3-D pictures", "not available; videos show the top-down view only", fine=False, remedy=problem
    )


def _cuda() -> Finding:
    import torch

    if torch.cuda.is_available():
        return Finding("cuda", torch.cuda.get_device_name())
    return Finding("cuda", "none; everything runs on the CPU")


def _weights() -> Finding:
    from hpp_framework.plugins.weights import weight_folders

    files = [file for folder in weight_folders(()) for file in folder.glob("*/*.safetensors")]
    remedy = "" if files else "Train predictors: hpp collect, then hpp train predictor."
    return Finding("weights", f"{len(files)} files", fine=bool(files), remedy=remedy)
