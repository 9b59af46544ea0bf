"""hpp robot: the same agents on robots, and on robots that behave like real ones."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro
from rich.console import Console
from rich.table import Table

from hpp_framework.cli.evaluate_tables import summary_table
from hpp_framework.cli.options import Pairs, check_positive, names
from hpp_framework.cli.progress import cell_bars
from hpp_framework.config.settings import parse_settings
from hpp_framework.plugins.builtin import DEFAULT_CONTROL, DEFAULT_DISTURBANCES, DEFAULT_ESTIMATOR
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.run_folder import RunFolder

if TYPE_CHECKING:
    from hpp_framework.deploy.loop import RobotLoop
    from hpp_framework.evaluation.experiment import Experiment

TABLE_WIDTH = 120


@dataclass(frozen=True, kw_only=True)
class _Shared:
    """Options of all that follows."""

    team: str = "fetch,freight"
    """Robots, separated by commas, 'id=robot' names one; or a team file (.yaml) with topics and gates."""
    task: str = "rendezvous"
    """Registered task, with settings or without ('formation:shape=ring'), or a YAML file of terms."""
    skill: str = "p2p"
    """Registered skill of every robot."""
    control: str = DEFAULT_CONTROL
    """Control layers of every robot from the skill outwards; 'hpp list layers' shows them."""
    preset: str = "best"
    """Preset of the planners: paper or best."""
    weights: str = ""
    """Extra folders searched for weights of predictors and policies, separated by commas."""
    set: Pairs = ()
    """Settings of every planner that has parameters, e.g. hysteresis=0.05 plan_every=10."""
    disturbances: str = DEFAULT_DISTURBANCES
    """What estimators count on, and what simulated robots suffer: ideal, paper, field or harsh, with settings
    or without, e.g. field:command_delay=0.4."""
    estimator: str = DEFAULT_ESTIMATOR
    """Registered estimator of all agents, with settings or without, e.g. tracker:noise=2."""
    seed: int = 0
    """Seed of agents, and of worlds, starts and disturbances where they are simulated."""

    def experiment(self, *, worlds: tuple[str, ...], planners: tuple[str, ...], **others: Any) -> Experiment:
        """Return what the options describe."""
        from hpp_framework.evaluation.experiment import Experiment

        return Experiment(
            worlds=worlds, planners=planners, team=self.team, task=self.task, skill=self.skill,
            control=self.control, preset=self.preset, disturbances=self.disturbances,
            estimator=self.estimator, seed=self.seed,
            weights=names(self.weights, "--weights") if self.weights else (),
            settings=parse_settings(list(chain(*self.set)), "--set"), **others,
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Rehearse(_Shared):
    """Run whole episodes with robots that behave like real ones, and write what 'hpp evaluate' writes.

    Writes episodes.csv (one row per episode), summary.json and config.json into --out. Interrupted rehearsals
    resume: repeat the same command.
    """

    backend: Literal["loopback", "ros2"] = "loopback"
    """What carries the data: this process in simulated time, or ROS 2 and a process for each robot in real
    time."""
    worlds: str = "wall"
    """Registered worlds or YAML files, separated by commas."""
    planners: str = "hpp"
    """Registered planners, separated by commas."""
    simulator: Literal["batch", "sapien"] = "batch"
    """Simulator of the robots."""
    episodes: int = 10
    """Episodes per world and planner."""
    people: int = 0
    """Pedestrians who walk between random places, beside those that a world has of its own."""
    fault: tuple[str, ...] = ()
    """What goes wrong in each episode, as KIND:ROBOT@BEGIN or KIND:ROBOT@BEGIN+SECONDS, e.g. kill:fetch@2 or
    network:fetch@2+5; kinds are in docs/deploy.md."""
    out: Path = Path("out/rehearsal")
    """Folder to write to."""

    def run(self) -> None:
        """Run the episodes and print their summary."""
        from hpp_framework.deploy.faults import parse_fault
        from hpp_framework.deploy.rehearsal import rehearse

        check_positive(episodes=self.episodes)
        experiment = self.experiment(
            worlds=names(self.worlds, "--worlds"), planners=names(self.planners, "--planners"),
            backend=self.simulator, episodes=self.episodes, people=self.people,
        )  # fmt: skip
        ids = experiment.make_team().ids
        faults = [parse_fault(text, ids) for text in self.fault]
        with RunFolder(self.out).locked(), cell_bars() as report:
            summary, figures = rehearse(experiment, self.out, self.backend, faults=faults, progress=report)
        Console(width=TABLE_WIDTH).print(summary_table(summary["cells"]))
        print(*figures.lines(), f"episodes:      {self.out / 'episodes.csv'}", sep="\n")


@dataclass(frozen=True, kw_only=True)
class _OneRobot(_Shared):
    """Options of commands for one robot."""

    me: str
    """Id of the robot."""
    backend: Literal["ros2"] = "ros2"
    """What carries the data."""
    planner: str = "hpp"
    """Registered planner of the robot, unless the team file names one."""
    bounds: tuple[float, float, float, float] = (-10.0, -10.0, 10.0, 10.0)
    """Where the team may gather: x_min y_min x_max y_max in the map's frame, metres."""

    def connect(self, *, rehearsed: bool = False) -> RobotLoop:
        """Return the control loop of the robot."""
        from hpp_framework.deploy.backends import open_port
        from hpp_framework.deploy.build import LoopBuilder

        experiment = self.experiment(worlds=("simple",), planners=(self.planner,))
        builder = LoopBuilder(experiment, self.planner, self.bounds)
        me = builder.index(self.me)
        return builder.loop(
            me, open_port(self.backend, builder.team, me, experiment.members, rehearsed=rehearsed)
        )


@dataclass(frozen=True, kw_only=True)
class RunRobot(_OneRobot):
    """Drive one robot: a process like this for each robot of the team.

    The robot is armed when all data come and nothing is wrong. Ctrl-C brakes first.
    """

    seconds: float = math.inf
    """Time after which the robot brakes and the command ends."""
    rehearsed: bool = False
    """Whether 'hpp robot rehearse' runs it and begins its episodes."""

    def run(self) -> None:
        """Drive until time is up or Ctrl-C."""
        from hpp_framework.deploy.node import run_node
        from hpp_framework.deploy.rehearsal import Figures

        loop, figures, late = self.connect(rehearsed=self.rehearsed), Figures(), None
        try:
            late = run_node(
                loop, seconds=self.seconds, seed=self.seed, say=lambda line: print(line, flush=True)
            )
        finally:
            loop.port.close()
            figures.add(loop)
            print(*figures.lines(), "" if late is None else f"late steps:    {late}", sep="\n", flush=True)


@dataclass(frozen=True, kw_only=True)
class CheckRobot(_OneRobot):
    """Listen to one robot, and say what comes and what keeps it from being armed; sends nothing."""

    seconds: float = 5.0
    """Time to listen."""

    def run(self) -> None:
        """Print a table of topics, and what is wrong.

        Raises:
            ConfigError: if the robot would not be armed.
        """
        from hpp_framework.deploy.node import problems

        loop = self.connect()
        try:
            traffic, found = problems(loop.port, loop, self.seconds)
        finally:
            loop.port.close()
        table = Table(box=None)
        for column in ("topic", "type", "per s", "late s", "frame", "instead there is"):
            table.add_column(column)
        for each in traffic:
            rate = f"{each.count / self.seconds:.1f}"
            late = f"{each.age:.2f}" if each.count else "-"
            table.add_row(each.topic, each.type, rate, late, each.frame, " ".join(each.others))
        Console(width=TABLE_WIDTH).print(table)
        if found:
            raise ConfigError(
                f"'{self.me}' would not be armed: {' '.join(found)} Topics are set in the team file."
            )
        print(f"'{self.me}' can be armed.")


@dataclass(frozen=True, kw_only=True)
class Simulate(_Shared):
    """Be the world and all robots of a team, in real time, for agents in other processes.

    Begins when all robots are sent commands, ends when the task is fulfilled or after 20 s.
    """

    world: str = "wall"
    """Registered world or YAML file."""
    backend: Literal["ros2"] = "ros2"
    """What carries the data."""
    simulator: Literal["batch", "sapien"] = "batch"
    """Simulator of the robots."""
    episode: int = 0
    """Number of the episode in an 'hpp evaluate' with the same seed; it has the same world and start."""

    def run(self) -> None:
        """Run the episode and print what became of it."""
        from hpp_framework.deploy.rehearsal import simulate

        experiment = self.experiment(worlds=(self.world,), planners=("hpp",), backend=self.simulator)
        row = simulate(experiment, self.world, self.episode, self.backend)
        print(", ".join(f"{name} {value}" for name, value in row.items()))


@dataclass(frozen=True, kw_only=True)
class Robot:
    """Drive robots, rehearse it, and look at what they send."""

    do: Annotated[
        Annotated[RunRobot, tyro.conf.subcommand("run")]
        | Annotated[CheckRobot, tyro.conf.subcommand("check")]
        | Annotated[Simulate, tyro.conf.subcommand("simulate")]
        | Annotated[Rehearse, tyro.conf.subcommand("rehearse")],
        tyro.conf.arg(name=""),
    ]

    def run(self) -> None:
        """Do it."""
        self.do.run()
