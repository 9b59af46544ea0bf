"""Simulators by name, imported when first asked for."""

from __future__ import annotations

from collections.abc import Sequence

from hpp_framework.core.robot import RobotSpec
from hpp_framework.sim.simulator import Simulator
from hpp_framework.utils.errors import ConfigError, SimulatorError, unknown_name

BACKENDS = ("batch", "sapien")


def make_simulator(
    backend: str,
    robots: Sequence[RobotSpec],
    *,
    device: str = "cpu",
    render: tuple[int, int] | None = None,
) -> Simulator:
    """Build a simulator by name.

    Args:
        backend: ``"batch"`` or ``"sapien"``.
        robots: the team.
        device: ``"cpu"`` or ``"cuda"``; the SAPIEN simulator runs on the CPU.
        render: (width, height) in pixels of ``SapienSimulator.picture``, or None; only for ``"sapien"``.

    Raises:
        UnknownNameError: if there is no such backend.
        ConfigError: if the backend cannot do what ``device`` or ``render`` asks for.
        SimulatorError: if the package behind the backend is missing or broken.
    """
    if backend == "batch":
        return _batch(robots, device, render)
    if backend == "sapien":
        return _sapien(robots, device, render)
    raise unknown_name("backend", backend, BACKENDS)


def _batch(robots: Sequence[RobotSpec], device: str, render: tuple[int, int] | None) -> Simulator:
    if render is not None:
        raise ConfigError("the batch simulator makes no pictures; use backend 'sapien', or leave render out.")
    from hpp_framework.sim.batch.simulator import BatchSimulator

    return BatchSimulator(robots, device=device)


def _sapien(robots: Sequence[RobotSpec], device: str, render: tuple[int, int] | None) -> Simulator:
    if device != "cpu":
        raise ConfigError(f"the SAPIEN simulator runs on the CPU, not on '{device}'; use backend 'batch'.")
    try:
        from hpp_framework.sim.sapien.simulator import SapienSimulator
    except ImportError as error:
        raise SimulatorError(
            f"the package 'sapien' cannot be imported: {error}. Install it with "
            "`pip install 'sapien>=3.0.3'` (Linux x86-64, Python 3.10 or newer), or use backend 'batch'."
        ) from error
    return SapienSimulator(robots, render=render)
