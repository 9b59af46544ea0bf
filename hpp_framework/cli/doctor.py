"""``hpp doctor``: what works on this machine, and what to do about what does not."""

from __future__ import annotations

import platform
import sys
from collections.abc import Callable
from dataclasses import dataclass

from rich.console import Console
from rich.markup import escape

from hpp_framework.versions import installed

PACKAGES = (
    "hpp-framework", "torch", "numpy", "gymnasium", "pettingzoo", "stable-baselines3", "warp-lang", "sapien",
    "trimesh", "opencv-python-headless", "av",
)  # fmt: skip


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
            console.print(f"{mark}{escape(finding.what)}: {escape(finding.detail)}")
            if finding.remedy:
                console.print(f"      {escape(finding.remedy)}")


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
    import cv2

    gui = (
        "GUI:                           NONE" not in cv2.getBuildInformation()
        and "QT" in cv2.getBuildInformation()
    )
    remedy = (
        "pip uninstall -y opencv-python opencv-python-headless && pip install opencv-python-headless"
        if gui
        else ""
    )
    return Finding(
        "opencv", f"{cv2.__version__}, {'with' if gui else 'without'} windows", fine=not gui, remedy=remedy
    )


def _plugins() -> Finding:
    from hpp_framework.registry import hub

    registries = hub().registries()
    counts = [f"{sum(1 for _ in registry)} {name}" for name, registry in registries.items()]
    reasons = [plugin.reason for plugin in hub().broken]
    for registry in registries.values():
        for name in registry.clashes():
            reasons.append(registry.clash(name))
    detail = ", ".join(counts[:6])
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

    from hpp_framework.robot import DriveLimits, Lidar, RobotSpec
    from hpp_framework.sim import make_simulator
    from hpp_framework.worlds.world import World

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
    from hpp_framework.sim.sapien_render import rendering_problem

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
    from hpp_framework.registry import hub

    files = [file for entry in hub().checkpoints for file in entry.factory()().glob("*/*.safetensors")]
    remedy = "" if files else "Train predictors: hpp collect, then hpp train predictor."
    return Finding("shipped weights", f"{len(files)} files", fine=bool(files), remedy=remedy)
