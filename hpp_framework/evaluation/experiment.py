"""Compares planners over worlds: cells of episodes, written as they finish, resumed where they stopped.

Episode ``e`` of world ``w`` under seed ``s`` has the same world and start for every planner and backend, so
that comparisons are paired.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
import torch

from hpp_framework.agents.build import AgentConfig, build_scheduled_agents
from hpp_framework.config.control_choice import parse_control
from hpp_framework.config.planner_choice import has_setting, parameters, parse_planner
from hpp_framework.config.sensing_choice import make_estimators, parse_disturbances
from hpp_framework.config.task_file import make_task
from hpp_framework.config.team_file import build_team, effective_team, is_team_file, read_team_file
from hpp_framework.core.disturbances import Disturbances
from hpp_framework.core.estimator import Estimator
from hpp_framework.core.planner import PRESETS
from hpp_framework.core.schedule import Schedule, make_schedule
from hpp_framework.core.team import Team
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.world import World
from hpp_framework.evaluation import folder
from hpp_framework.evaluation.distances import curve_file, distance_curves, write_bands, write_curves
from hpp_framework.evaluation.marl_eval import marl_eval_layout
from hpp_framework.evaluation.rollout import EPISODE_STEPS, Episodes, Watcher, run_episodes
from hpp_framework.evaluation.rows import EpisodeRow, to_rows
from hpp_framework.evaluation.summary import Results, Summary, summarise
from hpp_framework.evaluation.table import read_rows, write_rows
from hpp_framework.evaluation.turns import least_times
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.builtin import (
    DEFAULT_CONTROL,
    DEFAULT_DISTURBANCES,
    DEFAULT_ESTIMATOR,
    DEFAULT_SKILL,
    DEFAULT_TASK,
    DEFAULT_TEAM,
)
from hpp_framework.sim import BACKENDS, make_simulator
from hpp_framework.utils.errors import ConfigError, unknown_name
from hpp_framework.utils.progress import Progress
from hpp_framework.utils.run_folder import write_json
from hpp_framework.utils.seeding import child_seed, numpy_rng
from hpp_framework.worlds.loader import MOST_PEOPLE, WorldFactory, resolve_world
from hpp_framework.worlds.people import populate
from hpp_framework.worlds.spawn import spawn_poses

CHUNK = {"batch": 100, "sapien": 5}

Bounds = dict[int, float]
"""Least times of the episodes of a world, in seconds; filled where they are first needed."""


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """What is compared; written into the run folder, and enough to repeat it.

    Attributes:
        worlds: registered worlds or YAML files.
        planners: registered meta-planners, with or without settings, e.g. ``"hpp:hysteresis=0.05"``.
        team: as on the command line, e.g. ``"fetch,freight"``, or a team file.
        control: control stack of all robots, e.g. ``"terminal-approach:near=1.2,safety-filter"``.
        preset: of the planners.
        backend: ``"batch"`` or ``"sapien"``.
        episodes: a cell.
        seed: of worlds, starts and agents.
        task: registered task, with settings or without, e.g. ``"formation:shape=ring"``, or a task file.
        skill: registered skill of every robot.
        disturbances: of sensing and acting: a profile, with settings or without, e.g. ``"field"``.
        estimator: registered estimator of all agents, with settings or without, e.g. ``"tracker"``.
        weights: extra folders searched for predictor weights.
        settings: of every planner that has parameters, by dotted name.
        members: what a team file says, all defaults filled in; read from it unless given.
        people: pedestrians who walk between random places, beside those that a world has of its own.
    """

    worlds: tuple[str, ...]
    planners: tuple[str, ...]
    team: str = DEFAULT_TEAM
    control: str = DEFAULT_CONTROL
    preset: str = "best"
    backend: str = "batch"
    episodes: int = 100
    seed: int = 0
    task: str = DEFAULT_TASK
    skill: str = DEFAULT_SKILL
    disturbances: str = DEFAULT_DISTURBANCES
    estimator: str = DEFAULT_ESTIMATOR
    weights: tuple[str, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=lambda: dict[str, Any]())
    members: Mapping[str, Any] = field(default_factory=lambda: dict[str, Any]())
    people: int = 0

    def __post_init__(self) -> None:
        if is_team_file(self.team):
            file = Path(self.team)
            members = effective_team(self.members, file) if self.members else read_team_file(file)
            object.__setattr__(self, "members", members)
        if self.episodes < 1:
            raise ConfigError(f"episodes must be at least 1, got {self.episodes}.")
        if not 0 <= self.people <= MOST_PEOPLE:
            raise ConfigError(f"people must be from 0 to {MOST_PEOPLE}, got {self.people}.")
        if not self.worlds or not self.planners:
            raise ConfigError("name at least one world and one planner.")

    def make_team(self) -> Team:
        """Build all robots."""
        if self.members:
            return build_team(self.members, skill=self.skill)
        return parse_team(self.team, skill=self.skill)

    def make_schedule(self, team: Team) -> Schedule:
        """Return who of the team takes part when, and the task that they have then.

        Raises:
            ConfigError: if the last robot joins when episodes are over.
        """
        schedule = make_schedule(team, lambda part: make_task(self.task, part.robots, part.ids))
        first = next(stage.first for stage in schedule if stage.complete)
        if first >= EPISODE_STEPS:
            raise ConfigError(
                f"the last robot joins at {first * CONTROL_PERIOD:g} s, but episodes end after "
                f"{EPISODE_STEPS * CONTROL_PERIOD:g} s; lower its joins_at."
            )
        return schedule

    def team_disturbances(self, team: Team) -> list[Disturbances]:
        """Return what disturbs each robot of the team."""
        texts = [member.disturbances or self.disturbances for member in team.members]
        return [parse_disturbances(text) for text in texts]

    def make_estimators(self, team: Team) -> list[Estimator]:
        """Build the estimators of all agents."""
        return make_estimators(self.estimator, team.robots, self.team_disturbances(team))

    def agent_config(self, planner: str) -> AgentConfig:
        """Return what the agents of one of the planners have in common."""
        return AgentConfig(
            planner=planner, control=self.control, preset=self.preset, settings=self.settings,
            weights=tuple(map(Path, self.weights)),
        )  # fmt: skip


def read_experiment(file: Path, command: str) -> Experiment:
    """Return the experiment that a ``config.json`` describes.

    Args:
        file: written by ``hpp run`` or ``hpp evaluate``.
        command: that wants to repeat it, ``"run"`` or ``"evaluate"``.

    Raises:
        ConfigError: if the file is damaged, another command wrote it, or a world file has changed since.
    """
    found = folder.read_config(file, command)
    kinds = {
        "str": str, "int": int, "tuple[str, ...]": list, "Mapping[str, Any]": dict,
    }  # fmt: skip
    for name, default in folder.ADDED.items():
        found.setdefault(name, default)
    wrong = [f.name for f in fields(Experiment) if type(found.get(f.name)) is not kinds[str(f.type)]]
    remedy = f"Give a config.json that `hpp {command}` wrote."
    if wrong:
        raise ConfigError(f"'{file}' describes no experiment: {', '.join(wrong)} missing or wrong. {remedy}")
    values: dict[str, Any] = {f.name: found[f.name] for f in fields(Experiment)}
    for name in ("worlds", "planners", "weights"):
        values[name] = tuple(map(str, values[name]))
    return Experiment(**values)


def check_experiment(experiment: Experiment, factories: Mapping[str, WorldFactory]) -> dict[str, Any]:
    """Try everything that an experiment names, before anything is written.

    Args:
        experiment: what is compared.
        factories: of its worlds.

    Returns:
        The effective parameters of each planner, None where a planner has no config dataclass.

    Raises:
        HppError: whatever is wrong: an unknown name, missing weights, a world without room for the team.
    """
    for kind, name, known in (
        ("preset", experiment.preset, PRESETS), ("backend", experiment.backend, BACKENDS),
    ):  # fmt: skip
        if name not in known:
            raise unknown_name(kind, name, known)
    for planner in experiment.planners:
        parse_planner(planner)
    parse_control(experiment.control)
    team = experiment.make_team()
    schedule = experiment.make_schedule(team)
    drawn = [draw_episode(experiment, name, factories[name], 0)[0] for name in experiment.worlds]
    configs: dict[str, Any] = {}
    unknown = dict(experiment.settings)
    for planner in experiment.planners:
        agents = build_scheduled_agents(team, schedule, experiment.agent_config(planner), drawn[0].bounds)
        # members with a planner of their own come last: theirs may be called the same
        for member, agent in sorted(zip(team.members, agents, strict=True), key=lambda m: m[0].planner or ""):
            configs.setdefault(member.planner or planner, parameters(agent))
            if member.planner is None:
                unknown = {name: value for name, value in unknown.items() if not has_setting(agent, name)}
    if unknown:
        for planner in experiment.planners:
            # a planner with parameters says which it has
            as_own = ":".join([planner, *(f"{name}={value}" for name, value in unknown.items())])
            build_scheduled_agents(team, schedule, experiment.agent_config(as_own), drawn[0].bounds)
    experiment.make_estimators(team)
    make_simulator(experiment.backend, team.robots).close()
    return configs


def run_experiment(
    experiment: Experiment,
    out: Path,
    *,
    progress: Progress = lambda *_: None,
    conduct: Conduct | None = None,
) -> Summary:
    """Run what is not yet in ``out`` and return the summary, which is also written to ``summary.json``.

    Args:
        experiment: what to compare.
        out: run folder; created, or resumed if it holds the same experiment.
        progress: called with (cell, episodes done, episodes in all).
        conduct: how episodes are run; None for in simulation, side by side.

    Raises:
        HppError: if the experiment names something wrong (nothing is written then), or ``out`` holds
            something else, is damaged or cannot be written.
    """
    factories = {name: resolve_world(name) for name in experiment.worlds}
    configs = check_experiment(experiment, factories)
    conduct = conduct or Conduct(run=run_drawn, chunk=CHUNK[experiment.backend])
    recorded = folder.record(conduct.command, {**asdict(experiment), **conduct.about}, configs)
    folder.open_evaluation(out, recorded)
    file = out / folder.EPISODES
    rows = read_rows(file, EpisodeRow)
    for world in experiment.worlds:
        bounds: Bounds = {}
        for planner in experiment.planners:
            cell = _Cell(experiment, world, planner, factories[world], bounds, conduct)
            rows = _run_cell(cell, rows, file, progress)
    firsts = range(0, experiment.episodes, conduct.chunk)
    write_bands(out, experiment.worlds, experiment.planners, firsts)
    results = Results(
        worlds=experiment.worlds, planners=experiment.planners, preset=experiment.preset,
        rows=[row for row in rows if row.episode < experiment.episodes],
        about={
            "team": experiment.team, "control": experiment.control, "estimator": experiment.estimator,
            "disturbances": experiment.disturbances,
            "people": experiment.people, "backend": experiment.backend, "seed": experiment.seed,
        },
    )  # fmt: skip
    summary = summarise(results)
    write_json(out / folder.SUMMARY, summary)
    write_json(out / folder.MARL_EVAL, marl_eval_layout(results, experiment.task), indent=None)
    return summary


def draw_episode(
    experiment: Experiment, world: str, factory: WorldFactory, episode: int
) -> tuple[World, np.ndarray]:
    """Return world, its people settled, and start poses (n, 3) of one episode; the same for every planner."""
    team = experiment.make_team()
    rng = numpy_rng(experiment.seed, "episode", world, episode)
    drawn = factory(rng)
    starts = spawn_poses(drawn, team.robots, rng)
    people_rng = numpy_rng(experiment.seed, "people", world, episode)
    return populate(drawn, team.robots, starts, people_rng, more=experiment.people), starts


RunDrawn = Callable[[Experiment, str, str, Mapping[int, tuple[World, np.ndarray]]], Episodes]
"""Runs episodes of (experiment, planner, world), given world and start poses by number of episode."""


@dataclass(frozen=True, kw_only=True)
class Conduct:
    """How the episodes of an experiment are run.

    Attributes:
        run: does it; the worlds of a call share their bounds.
        chunk: episodes that are written together.
        command: that the run folder names.
        about: what else the run folder records, and must be the same to resume.
    """

    run: RunDrawn
    chunk: int
    command: str = folder.EVALUATE
    about: Mapping[str, Any] = field(default_factory=lambda: dict[str, Any]())


@dataclass(frozen=True)
class _Cell:
    """One planner in one world."""

    experiment: Experiment
    world: str
    planner: str
    factory: WorldFactory
    bounds: Bounds
    conduct: Conduct

    def curves(self, out: Path, first: int) -> Path:
        """Return where the distances of a chunk go."""
        experiment = self.experiment
        world, planner = experiment.worlds.index(self.world), experiment.planners.index(self.planner)
        return curve_file(out, world, planner, first)


def _run_cell(cell: _Cell, rows: list[EpisodeRow], file: Path, progress: Progress) -> list[EpisodeRow]:
    """Run the missing chunks of one world and planner, write after each, and return all rows."""
    key, label = (cell.world, cell.planner), f"{cell.world} / {cell.planner}"
    have = {row.episode for row in rows if (row.world, row.planner) == key}
    chunk, episodes = cell.conduct.chunk, cell.experiment.episodes
    for first in range(0, episodes, chunk):
        wanted = range(first, min(first + chunk, episodes))
        progress(label, first, episodes)
        if set(wanted) <= have:
            continue
        fresh, curves = _run_chunk(cell, wanted)
        # the rows come last: they say that a chunk is finished
        write_curves(cell.curves(file.parent, first), curves)
        rows = [r for r in rows if (r.world, r.planner) != key or r.episode not in wanted] + fresh
        write_rows(file, rows, EpisodeRow)
    progress(label, episodes, episodes)
    return rows


def _run_chunk(cell: _Cell, wanted: range) -> tuple[list[EpisodeRow], np.ndarray]:
    """Run episodes side by side; only those together whose worlds share the bounds that planners are told."""
    drawn = {e: draw_episode(cell.experiment, cell.world, cell.factory, e) for e in wanted}
    groups: dict[tuple[float, float, float, float], list[int]] = {}
    for episode, (world, _) in drawn.items():
        groups.setdefault(world.bounds, []).append(episode)
    found = [each for group in groups.values() for each in _run_group(cell, drawn, group)]
    found.sort(key=lambda each: each[0].episode)
    return [row for row, _ in found], np.stack([curve for _, curve in found])


def _run_group(
    cell: _Cell, drawn: Mapping[int, tuple[World, np.ndarray]], group: Sequence[int]
) -> list[tuple[EpisodeRow, np.ndarray]]:
    experiment, name = cell.experiment, cell.world
    team = experiment.make_team()
    schedule = experiment.make_schedule(team)
    worlds = [drawn[episode][0] for episode in group]
    starts = np.stack([drawn[episode][1] for episode in group])
    chosen = {episode: drawn[episode] for episode in group}
    episodes = cell.conduct.run(experiment, cell.planner, name, chosen)
    # the same for every planner
    missing = [i for i, episode in enumerate(group) if episode not in cell.bounds]
    found = least_times([worlds[i] for i in missing], starts[missing], team, schedule)
    cell.bounds.update(zip([group[i] for i in missing], found.tolist(), strict=True))
    bounds = np.array([cell.bounds[episode] for episode in group])
    rows = to_rows(name, cell.planner, group, episodes, bounds)
    return list(zip(rows, distance_curves(episodes), strict=True))


def run_drawn(
    experiment: Experiment,
    planner: str,
    world: str,
    drawn: Mapping[int, tuple[World, np.ndarray]],
    *,
    watch: Watcher | None = None,
) -> Episodes:
    """Run episodes side by side, whose worlds have the same bounds; each runs as it would alone.

    Args:
        experiment: names everything else.
        planner: of its planners.
        world: of its worlds.
        drawn: world and start poses by number of episode.
        watch: looks on.
    """
    team = experiment.make_team()
    schedule = experiment.make_schedule(team)
    worlds = [pair[0] for pair in drawn.values()]
    starts = torch.from_numpy(np.stack([pair[1] for pair in drawn.values()])).float()
    agents = build_scheduled_agents(team, schedule, experiment.agent_config(planner), worlds[0].bounds)
    with make_simulator(experiment.backend, team.robots) as simulator:
        return run_episodes(
            simulator, worlds, starts, agents, schedule, disturbances=experiment.team_disturbances(team),
            estimators=experiment.make_estimators(team),
            seeds=[child_seed(experiment.seed, world, number) for number in drawn], watch=watch,
        )  # fmt: skip
