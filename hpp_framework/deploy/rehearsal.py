"""Rehearsals: episodes of ``hpp evaluate``, driven by the code that drives robots."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.world import World
from hpp_framework.deploy.backends import open_team_port
from hpp_framework.deploy.build import LoopBuilder
from hpp_framework.deploy.faults import Fault
from hpp_framework.deploy.loop import RobotLoop
from hpp_framework.deploy.loopback import Look, LoopbackPort, run_loopback
from hpp_framework.deploy.processes import agent_processes
from hpp_framework.deploy.simulated import SimulatedTeam, joined
from hpp_framework.deploy.world import RealTimeWorld
from hpp_framework.evaluation.experiment import Conduct, Experiment, draw_episode, run_experiment
from hpp_framework.evaluation.folder import REHEARSE
from hpp_framework.evaluation.rollout import EPISODE_STEPS, LATENCY_REPEATS, Episodes
from hpp_framework.evaluation.summary import Summary
from hpp_framework.sim import make_simulator
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.progress import Progress
from hpp_framework.utils.seeding import child_seed
from hpp_framework.worlds.loader import resolve_world

CHUNK = 10
LOOPBACK = "loopback"

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

    def add(self, loop: RobotLoop) -> None:
        """Add what a loop did."""
        self.seconds += loop.seconds
        self.counts += loop.gate.counts

    def lines(self) -> list[str]:
        """Return them in words."""
        if not self.seconds:
            return []
        median, slow = np.percentile(np.array(self.seconds) * 1e3, [50, 99])
        gate = ", ".join(f"{name} {count}" for name, count in sorted(self.counts.items()) if count)
        return [
            f"control steps: {len(self.seconds)}, median {median:.1f} ms, 99 % below {slow:.1f} ms",
            f"gate:          {gate or 'no brake, no command limited'}",
        ]


Watch = Callable[[SimulatedTeam, Sequence[RobotLoop]], Look]
"""Called before each episode with the simulated team and the control loops; returns what looks on in it."""


def run_in_loopback(
    experiment: Experiment,
    planner: str,
    world: str,
    drawn: Drawn,
    *,
    faults: Sequence[Fault] = (),
    figures: Figures | None = None,
    watch: Watch = lambda *_: lambda _: None,
    steps: int = EPISODE_STEPS,
) -> Episodes:
    """Run episodes one after the other over the loopback backend.

    Args:
        experiment: names everything.
        planner: of robots that name none.
        world: its name, for seeds.
        drawn: world and start poses by number of episode.
        faults: that come about in each episode.
        figures: to add what the control loops did to.
        watch: looks on.
        steps: control steps an episode, at most.
    """
    figures = figures or Figures()
    builder = LoopBuilder(experiment, planner, next(iter(drawn.values()))[0].bounds)
    team, found = builder.team, list[Episodes]()
    with make_simulator(experiment.backend, team.robots) as simulator:
        simulated = SimulatedTeam(simulator, team, builder.schedule, experiment.team_disturbances(team))
        ports = [LoopbackPort(simulated, index, faults) for index in range(len(team))]
        loops = [builder.loop(index, port) for index, port in enumerate(ports)]
        timed = [seconds for loop in loops for seconds in _plan_seconds(loop)]
        for number, (place, start) in drawn.items():
            seed = child_seed(experiment.seed, world, number)
            simulated.begin(place, start, seed)
            for port, loop in zip(ports, loops, strict=True):
                port.begin()
                loop.begin(seed)
            run_loopback(simulated, loops, faults, steps, watch(simulated, loops))
            found.append(simulated.episode(timed))
        for loop in loops:
            figures.add(loop)
    return joined(found)


def run_in_processes(
    experiment: Experiment, planner: str, world: str, drawn: Drawn, *, backend: str, logs: Path
) -> Episodes:
    """Run episodes one after the other in real time, a process for each robot's agent.

    Args:
        experiment: names everything.
        planner: of robots that name none.
        world: its name, for seeds.
        drawn: world and start poses by number of episode.
        backend: that connects the processes.
        logs: folder for what the processes print.

    Raises:
        HppError: if the backend is missing or a process fails.
    """
    team = experiment.make_team()
    schedule = experiment.make_schedule(team)
    bounds, found = next(iter(drawn.values()))[0].bounds, list[Episodes]()
    port = open_team_port(backend, team, experiment.members)
    try:
        with (
            make_simulator(experiment.backend, team.robots) as simulator,
            agent_processes(experiment, planner, bounds, team, backend, logs) as check,
        ):
            simulated = SimulatedTeam(simulator, team, schedule, experiment.team_disturbances(team))
            real_time = RealTimeWorld(simulated, port, check)
            for number, (place, start) in drawn.items():
                seed = child_seed(experiment.seed, world, number)
                simulated.begin(place, start, seed)
                port.begin(seed)
                real_time.run(EPISODE_STEPS)
                found.append(simulated.episode([]))
    finally:
        port.close()
    return joined(found)


def simulate(experiment: Experiment, world: str, episode: int, backend: str) -> dict[str, float]:
    """Be a simulated team in real time for one episode, and return what became of it.

    Args:
        experiment: names world, team and disturbances.
        world: of its worlds.
        episode: number of the episode.
        backend: that connects the agents.

    Raises:
        HppError: if the backend is missing or no agent comes.
    """
    team = experiment.make_team()
    place, start = draw_episode(experiment, world, resolve_world(world), episode)
    port = open_team_port(backend, team, experiment.members)
    try:
        with make_simulator(experiment.backend, team.robots) as simulator:
            schedule = experiment.make_schedule(team)
            simulated = SimulatedTeam(simulator, team, schedule, experiment.team_disturbances(team))
            simulated.begin(place, start, child_seed(experiment.seed, world, episode))
            RealTimeWorld(simulated, port).run(EPISODE_STEPS)
    finally:
        port.close()
    found = simulated.episode([])
    steps = int(found.last_step()[0])
    return {
        "success": int(found.done_step[0] >= 0), "time_s": round(steps * CONTROL_PERIOD, 1),
        "touched_obstacle": int(found.touched_obstacle[0]), "touched_robot": int(found.touched_robot[0]),
        "final_distance_m": round(float(found.spread()[0, steps]), 2),
    }  # fmt: skip


def rehearse(
    experiment: Experiment,
    out: Path,
    backend: str = LOOPBACK,
    *,
    faults: Sequence[Fault] = (),
    progress: Progress = lambda *_: None,
) -> tuple[Summary, Figures]:
    """Run an experiment over a backend; writes what ``hpp evaluate`` does.

    Args:
        experiment: what to run.
        out: run folder; created, or resumed if it holds the same rehearsal.
        backend: that carries the data.
        faults: that come about in each episode; only over the loopback backend.
        progress: called with (cell, episodes done, episodes in all).

    Raises:
        HppError: as :func:`~hpp_framework.evaluation.experiment.run_experiment` does.
    """
    figures = Figures()
    if faults and backend != LOOPBACK:
        raise ConfigError(
            f"faults come about over the loopback backend only; leave out --fault with {backend}."
        )
    if backend == LOOPBACK:
        run = partial(run_in_loopback, faults=faults, figures=figures)
    else:
        run = partial(run_in_processes, backend=backend, logs=out)
    about = {"port": backend, "faults": [asdict(each) for each in faults]}
    conduct = Conduct(run=run, chunk=CHUNK, command=REHEARSE, about=about)
    return run_experiment(experiment, out, progress=progress, conduct=conduct), figures


def _plan_seconds(loop: RobotLoop) -> list[float]:
    """Warm an agent up and time single plans, as evaluations do."""
    loop.warm_up()
    return loop.agent.plan_seconds(loop.assembly.observation(), LATENCY_REPEATS)
