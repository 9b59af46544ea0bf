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

    counts = [f"{sum(1 for _ in registry)} {name}" for name, registry in hub().registries().items()]
    return Finding("plugins", ", ".join(counts[:6]))


def _batch() -> Finding:
    import torch

    from hpp_framework.registry import hub
    from hpp_framework.sim import make_simulator
    from hpp_framework.worlds.world import World

    simulator = make_simulator("batch", [entry.factory()() for entry in hub().robots][:1])
    simulator.reset([World(name="test")], torch.zeros(1, 1, 3))
    simulator.step(torch.ones(1, 1, 2))
    return Finding("batch simulator", "works")


def _sapien() -> Finding:
    import torch

    from hpp_framework.registry import hub
    from hpp_framework.sim import make_simulator
    from hpp_framework.worlds.world import World

    with make_simulator("sapien", [entry.factory()() for entry in hub().robots][:1]) as simulator:
        simulator.reset([World(name="test")], torch.zeros(1, 1, 3))
        simulator.step(torch.ones(1, 1, 2))
    return Finding("sapien simulator", "works")


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
