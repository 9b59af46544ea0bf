"""Rehearsals: episodes of ``hpp evaluate``, driven by the code that drives robots."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hpp_framework.core.world import World
from hpp_framework.deploy.build import LoopBuilder
from hpp_framework.deploy.faults import Fault
from hpp_framework.deploy.loop import RobotLoop
from hpp_framework.deploy.loopback import Look, LoopbackPort, run_loopback
from hpp_framework.deploy.simulated import SimulatedTeam, joined
from hpp_framework.evaluation.experiment import Conduct, Experiment, run_experiment
from hpp_framework.evaluation.folder import REHEARSE
from hpp_framework.evaluation.rollout import EPISODE_STEPS, LATENCY_REPEATS, Episodes
from hpp_framework.evaluation.summary import Summary
from hpp_framework.sim import make_simulator
from hpp_framework.utils.progress import Progress
from hpp_framework.utils.seeding import child_seed

CHUNK = 10

Drawn = Mapping[int, tuple[World, np.ndarray]]


@dataclass
class Figures:
    """What the control loops of a rehearsal did.

    Attributes:
        seconds: wall times of control steps.
        counts: control steps braked, by reason, and commands limited.
    """

    seconds: list[float] = field(default_factory=lambda: list[float]())
    counts: Counter[str] = field(default_factory=lambda: Counter[str]())

    def lines(self) -> list[str]:
        """Return them in words."""
        steps = np.array(self.seconds) * 1e3
        median, slow = (np.median(steps), np.percentile(steps, 99)) if len(steps) else (np.nan, np.nan)
        gate = ", ".join(f"{name} {count}" for name, count in sorted(self.counts.items()) if count)
        return [
            f"control steps: {len(steps)}, median {median:.1f} ms, 99 % below {slow:.1f} ms",
            f"gate:          {gate or 'no brake, no command limited'}",
        ]


def run_in_loopback(
    experiment: Experiment,
    planner: str,
    drawn: Drawn,
    world: str,
    *,
    faults: Sequence[Fault] = (),
    figures: Figures | None = None,
    look: Callable[[SimulatedTeam, Sequence[RobotLoop]], Look] = lambda *_: lambda _: None,
) -> Episodes:
    """Run episodes one after the other over the loopback backend.

    Args:
        experiment: names everything.
        planner: of robots that name none.
        drawn: world and start poses by number of episode.
        world: its name, for seeds.
        faults: that come about in each episode.
        figures: to add what the control loops did to.
        look: called with the simulated team and the loops before each episode; looks on in it.
    """
    figures = figures or Figures()
    builder = LoopBuilder(experiment, planner, next(iter(drawn.values()))[0].bounds)
    team = builder.team
    found: list[Episodes] = []
    with make_simulator(experiment.backend, team.robots) as simulator:
        simulated = SimulatedTeam(
            simulator, team, builder.schedule, experiment.team_disturbances(team)
        )
        ports = [LoopbackPort(simulated, index, faults) for index in range(len(team))]
        loops = [builder.loop(index, port) for index, port in enumerate(ports)]
        for number, (place, start) in drawn.items():
            seed = child_seed(experiment.seed, world, number)
            simulated.begin(place, start, seed)
            for port, loop in zip(ports, loops, strict=True):
                port.begin()
                loop.begin(seed)
            timed = [] if found else _plan_seconds(loops, seed)
            run_loopback(simulated, loops, faults, EPISODE_STEPS, look(simulated, loops))
            found.append(simulated.episode(timed))
        for loop in loops:
            figures.seconds += loop.seconds
            figures.counts += loop.gate.counts
    return joined(found)


def rehearse(
    experiment: Experiment,
    out: Path,
    *,
    faults: Sequence[Fault] = (),
    progress: Progress = lambda *_: None,
) -> tuple[Summary, Figures]:
    """Run an experiment over the loopback backend; writes what ``hpp evaluate`` does.

    Args:
        experiment: what to run.
        out: run folder; created, or resumed if it holds the same rehearsal.
        faults: that come about in each episode.
        progress: called with (cell, episodes done, episodes in all).

    Raises:
        HppError: as :func:`~hpp_framework.evaluation.experiment.run_experiment` does.
    """
    figures = Figures()

    def run(experiment: Experiment, planner: str, world: str, drawn: Drawn) -> Episodes:
        return run_in_loopback(experiment, planner, drawn, world, faults=faults, figures=figures)

    about = {"port": "loopback", "faults": [str(each) for each in faults]}
    conduct = Conduct(run=run, chunk=CHUNK, command=REHEARSE, about=about)
    return run_experiment(experiment, out, progress=progress, conduct=conduct), figures


def _plan_seconds(loops: Sequence[RobotLoop], seed: int) -> list[float]:
    """Warm all agents up and time single plans, as evaluations do; they begin anew afterwards."""
    seconds: list[float] = []
    for loop in loops:
        if loop.warm_up(loop.port.latest()):
            seconds += loop.agent.plan_seconds(loop.assembly.observation(), LATENCY_REPEATS)
        loop.begin(seed)
    return seconds
