"""Benchmarks of the simulators: agent-steps, scans, and the batch lidar against SAPIEN's rays."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import asdict, dataclass, replace

import numpy as np
import torch

from hpp_framework.bench.measurement import Measurement, Settings, SkippedError, rates, ratios, timed
from hpp_framework.bench.rooms import WALL_SEGMENTS, furnished, robots_of, starts
from hpp_framework.sim import make_simulator
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.errors import SimulatorError
from hpp_framework.utils.seeding import numpy_rng, torch_rng
from hpp_framework.worlds.people import populate

BOXES = 20
"""Boxes of the usual case; with the outer walls they are 96 segments."""

PEOPLE = 10
"""People whose cost is measured."""

COMMANDS = 16
"""Different commands that a simulation repeats."""

FEW, MANY = 80, 2000
"""Segments between which growth is measured."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """One set of parameters of the batch simulator.

    Attributes:
        worlds: episodes side by side.
        robots: a world.
        beams: a scan.
        segments: obstacle segments per world, 16 of them the outer walls.
        rooms: different rooms.
        people: who walk in each of them.
    """

    worlds: int = 1024
    robots: int = 2
    beams: int = 222
    segments: int = WALL_SEGMENTS + 4 * BOXES
    rooms: int = 32
    people: int = 0


class Loop:
    """A batch simulator with commands to repeat.

    Args:
        case: what is simulated.
        settings: device and seed.
    """

    def __init__(self, case: Case, settings: Settings) -> None:
        self.case, self.settings = case, settings
        robots = robots_of(settings, case.robots, case.beams)
        rng = numpy_rng(settings.seed, "bench", "rooms")
        boxes = (case.segments - WALL_SEGMENTS) // 4
        rooms = [furnished(rng, boxes) for _ in range(min(case.rooms, case.worlds))]
        poses = starts(rooms, robots, case.worlds, rng)
        people = numpy_rng(settings.seed, "bench", "people")
        rooms = [populate(room, (), np.zeros((0, 2)), people, more=case.people) for room in rooms]
        self.simulator = BatchSimulator(robots, device=settings.device, threads=settings.threads)
        self.simulator.load(rooms, episodes=case.worlds)
        worlds = torch.arange(case.worlds, dtype=torch.int32) % len(rooms)
        whole_team = torch.ones(case.worlds, case.robots, dtype=torch.bool)
        self.simulator.place(worlds, whole_team, poses)
        commands = torch.rand(
            COMMANDS, case.worlds, case.robots, 2, generator=torch_rng(settings.seed, "bench")
        )
        commands[..., 1] = 2 * commands[..., 1] - 1
        self._commands = list(commands.to(settings.device))
        self._still = torch.zeros_like(self._commands[0])
        self.steps = _enough(self._step, settings)

    def _step(self) -> None:
        self.simulator.advance(self._commands[0])
        self.settings.wait()

    def drive(self) -> None:
        """Step often enough to take time."""
        for index in range(self.steps):
            self.simulator.advance(self._commands[index % COMMANDS])
        self.settings.wait()

    def look(self) -> None:
        """Cast all lidars as often; all robots are told to stand still."""
        for _ in range(self.steps):
            self.simulator.advance(self._still)
        self.settings.wait()

    def close(self) -> None:
        """End the simulator's threads."""
        self.simulator.close()


def _enough(action: object, settings: Settings) -> int:
    """Return how often an action fills a repeat, at least 2 and at most 1,000 times."""
    assert callable(action)
    action()
    began = time.perf_counter()
    action()
    once = time.perf_counter() - began
    return int(min(max(settings.target_seconds / max(once, 1e-6), 2), 1000))


def simulation(settings: Settings) -> Iterator[Measurement]:
    """Agent-steps per second: physics and all lidars; the state shares the simulator's memory."""
    cases = _cases(settings)
    for case in cases:
        yield _agent_steps(case, settings)
    if settings.threads > 1:
        yield _agent_steps(cases[0], replace(settings, threads=1))
    yield _growth(settings)
    yield _crowded(settings)


def _agent_steps(case: Case, settings: Settings) -> Measurement:
    with closing(Loop(case, settings)) as loop:
        seconds = timed({"drive": loop.drive}, settings.repeats)["drive"]
    amount = case.worlds * case.robots * loop.steps
    return _measured("agent steps", case, settings, rates(amount, seconds))


def _cases(settings: Settings) -> list[Case]:
    """Vary one thing at a time; the number of agents stays the same where robots are varied."""
    usual = settings.pick(Case(worlds=4, rooms=2), Case(), Case(worlds=4096))
    sizes = settings.pick((), (1, 64, 8192), (1, 16, 64, 256, 1024, 16384))
    teams = settings.pick((4,), (4, 8, 32), (4, 8, 32))
    segments = settings.pick((20,), (20, 400, 2000), (20, 40, 200, 400, 1000, 2000))
    return [
        usual,
        *(replace(usual, worlds=worlds) for worlds in sizes),
        *(replace(usual, robots=n, worlds=max(usual.worlds * 2 // n, 1)) for n in teams),
        replace(usual, beams=1080),
        *(replace(usual, segments=count) for count in segments),
    ]


def _growth(settings: Settings) -> Measurement:
    """Return how many times longer a step takes among many segments than among few."""
    usual = settings.pick(Case(worlds=2, rooms=1), Case(), Case(worlds=4096))
    few, many = replace(usual, segments=FEW), replace(usual, segments=MANY)
    with closing(Loop(few, settings)) as sparse, closing(Loop(many, settings)) as dense:
        seconds = timed({"few": sparse.drive, "many": dense.drive}, settings.repeats)
    values = ratios([s / dense.steps for s in seconds["many"]], [s / sparse.steps for s in seconds["few"]])
    measured = _measured("time of a step, ratio", many, settings, values, unit="x")
    return replace(measured, parameters={**measured.parameters, "against_segments": FEW})


def _crowded(settings: Settings) -> Measurement:
    """Return how many times longer a step takes with people than without."""
    usual = settings.pick(Case(worlds=4, rooms=2), Case(), Case(worlds=4096))
    crowded = replace(usual, people=PEOPLE)
    with closing(Loop(usual, settings)) as alone, closing(Loop(crowded, settings)) as among:
        seconds = timed({"alone": alone.drive, "among": among.drive}, settings.repeats)
    values = ratios([s / among.steps for s in seconds["among"]], [s / alone.steps for s in seconds["alone"]])
    return _measured("time of a step among people, ratio", crowded, settings, values, unit="x")


def scans(settings: Settings) -> Iterator[Measurement]:
    """Scans per second alone: the lidars of robots that stand still."""
    usual = settings.pick(Case(worlds=4, rooms=2), Case(), Case(worlds=4096))
    others = settings.pick((), (80, 400, 2000), (20, 80, 200, 400, 1000, 2000))
    cases = [usual, replace(usual, beams=1080), *(replace(usual, segments=count) for count in others)]
    for case in cases:
        with closing(Loop(case, settings)) as loop:
            seconds = timed({"look": loop.look}, settings.repeats)["look"]
        yield _measured("scans", case, settings, rates(case.worlds * case.robots * loop.steps, seconds))


def sapien(settings: Settings) -> Iterator[Measurement]:
    """SAPIEN's steps and rays per second, and how many times faster the batch lidar is.

    Raises:
        SkippedError: if SAPIEN cannot run here.
    """
    case = replace(Case(), worlds=settings.pick(4, 1024, 4096), rooms=settings.pick(1, 32, 32))
    robots = robots_of(settings, case.robots, case.beams)
    try:
        simulator = make_simulator("sapien", robots)
    except SimulatorError as error:
        raise SkippedError(str(error)) from error
    from hpp_framework.sim.sapien.simulator import SapienSimulator

    assert isinstance(simulator, SapienSimulator)
    rng = numpy_rng(settings.seed, "bench", "rooms")
    room = furnished(rng, BOXES)
    command = torch.tensor([[[0.5, 0.3]] * case.robots])
    with simulator:
        simulator.reset([room], starts([room], robots, 1, rng))
        steps = _enough(simulator.state, settings)

        def drive() -> None:
            for _ in range(steps):
                simulator.step(command)

        def look() -> None:
            for _ in range(steps):
                simulator.state()

        with closing(Loop(case, settings)) as loop:
            seconds = timed({"drive": drive, "look": look, "batch": loop.look}, settings.repeats)
    one = {"robots": case.robots, "beams": case.beams, "boxes": BOXES, "cores": 1}
    rays = rates(case.robots * case.beams * steps, seconds["look"])
    batch = rates(case.worlds * case.robots * case.beams * loop.steps, seconds["batch"])
    yield Measurement(name="SAPIEN steps", parameters=one, unit="1/s", values=rates(steps, seconds["drive"]))
    yield Measurement(name="SAPIEN rays", parameters=one, unit="1/s", values=rays)
    yield _measured("batch rays", case, settings, batch)
    yield _measured("batch rays : SAPIEN rays", case, settings, ratios(batch, rays), unit="x")


def _parameters(case: Case, settings: Settings) -> dict[str, str | int | float]:
    return {**asdict(case), "device": settings.device, "threads": settings.threads}


def _measured(
    name: str, case: Case, settings: Settings, values: tuple[float, ...], unit: str = "1/s"
) -> Measurement:
    return Measurement(name=name, parameters=_parameters(case, settings), unit=unit, values=values)
