"""Compares planners over worlds: cells of episodes, written as they finish, resumed where they stopped.

Episode ``e`` of world ``w`` under seed ``s`` has the same world and start for every planner and backend, so
that comparisons are paired.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import torch

from hpp_framework.errors import ConfigError
from hpp_framework.evaluation.rollout import Episodes, build_agents, median_ms, run_episodes
from hpp_framework.evaluation.statistics import wilson_interval
from hpp_framework.registry import hub
from hpp_framework.seeding import child_seed, numpy_rng
from hpp_framework.sensing import NoiseModel
from hpp_framework.sim import make_simulator
from hpp_framework.sim.simulator import CONTROL_PERIOD
from hpp_framework.team import parse_team
from hpp_framework.worlds.loader import resolve_world
from hpp_framework.worlds.spawn import spawn_poses
from hpp_framework.worlds.world import World

CHUNK = {"batch": 50, "sapien": 5}


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """What is compared; written into the run folder, and enough to repeat it.

    Attributes:
        worlds: registered worlds or YAML files.
        planners: registered meta-planners.
        team: as on the command line, e.g. ``"fetch,freight"``.
        preset: of the planners.
        backend: ``"batch"`` or ``"sapien"``.
        episodes: a cell.
        seed: of worlds, starts and agents.
        task: registered task.
        skill: registered skill of every robot.
        noise: disturbances of what agents observe.
        weights: extra folders searched for predictor weights.
    """

    worlds: tuple[str, ...]
    planners: tuple[str, ...]
    team: str = "fetch,freight"
    preset: str = "best"
    backend: str = "batch"
    episodes: int = 100
    seed: int = 0
    task: str = "rendezvous"
    skill: str = "p2p"
    noise: NoiseModel = NoiseModel()
    weights: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.episodes < 1:
            raise ConfigError(f"episodes must be at least 1, got {self.episodes}.")
        if not self.worlds or not self.planners:
            raise ConfigError("name at least one world and one planner.")


@dataclass(frozen=True, kw_only=True)
class EpisodeRow:
    """One line of ``episodes.csv``; times are NaN where the event never came."""

    world: str
    planner: str
    episode: int
    success: int
    time_s: float
    first_contact: int
    first_contact_s: float
    collided: int
    final_distance_m: float
    steps: int
    plan_ms: float


def run_experiment(
    experiment: Experiment, out: Path, *, progress: Callable[[str, int, int], None] = lambda *_: None
) -> list[dict[str, Any]]:
    """Run what is not yet in ``out`` and return the summary, also written to ``summary.json``.

    Args:
        experiment: what to compare.
        out: run folder; created, or resumed if it holds the same experiment.
        progress: called with (cell, episodes done, episodes in all).

    Raises:
        ConfigError: if ``out`` holds another experiment or cannot be written.
    """
    hub().tasks.entry(experiment.task)
    for planner in experiment.planners:
        hub().planners.entry(planner)
    factories = {name: resolve_world(name) for name in experiment.worlds}
    team = parse_team(experiment.team, skill=experiment.skill)
    del team
    _open_folder(experiment, out)
    rows = _read_rows(out / "episodes.csv")
    for world in experiment.worlds:
        for planner in experiment.planners:
            have = {row.episode for row in rows if (row.world, row.planner) == (world, planner)}
            chunk = CHUNK.get(experiment.backend, 5)
            for first in range(0, experiment.episodes, chunk):
                wanted = range(first, min(first + chunk, experiment.episodes))
                progress(f"{world} / {planner}", first, experiment.episodes)
                if not set(wanted) <= have:
                    fresh = _run_chunk(experiment, world, factories[world], planner, wanted)
                    rows = [
                        r
                        for r in rows
                        if not (r.world == world and r.planner == planner and r.episode in wanted)
                    ]
                    rows += fresh
                    _write_rows(out / "episodes.csv", rows)
            progress(f"{world} / {planner}", experiment.episodes, experiment.episodes)
    summary = [summarise(experiment, w, p, rows) for w in experiment.worlds for p in experiment.planners]
    (out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n")
    return summary


def summarise(experiment: Experiment, world: str, planner: str, rows: Sequence[EpisodeRow]) -> dict[str, Any]:
    """Return one summary row of a cell; rates come with 95 % Wilson bounds."""
    cell = [row for row in rows if (row.world, row.planner) == (world, planner)][: experiment.episodes]
    successes = sum(row.success for row in cell)
    low, high = wilson_interval(successes, len(cell))
    times = [row.time_s for row in cell if row.success]
    return {
        "world": world,
        "planner": planner,
        "preset": experiment.preset,
        "team": experiment.team,
        "backend": experiment.backend,
        "episodes": len(cell),
        "seed": experiment.seed,
        "success": round(successes / len(cell), 4),
        "success_low": round(low, 4),
        "success_high": round(high, 4),
        "first_contact": round(sum(row.first_contact for row in cell) / len(cell), 4),
        "time_median_s": round(float(np.median(times)), 2) if times else None,
        "collision_episodes": sum(row.collided for row in cell),
        "final_distance_mean_m": round(float(np.mean([row.final_distance_m for row in cell])), 3),
        "plan_ms_median": round(float(np.median([row.plan_ms for row in cell])), 3),
    }


def draw_episode(experiment: Experiment, world: str, factory: Any, episode: int) -> tuple[World, np.ndarray]:
    """Return world and start poses (n, 3) of one episode; the same whatever planner runs in it."""
    team = parse_team(experiment.team, skill=experiment.skill)
    rng = numpy_rng(experiment.seed, "episode", world, episode)
    drawn = factory(rng)
    return drawn, spawn_poses(drawn, team.robots, rng)


def _run_chunk(
    experiment: Experiment, world: str, factory: Any, planner: str, wanted: range
) -> list[EpisodeRow]:
    team = parse_team(experiment.team, skill=experiment.skill)
    task = hub().tasks.create(experiment.task, team.robots)
    drawn = [draw_episode(experiment, world, factory, episode) for episode in wanted]
    starts = torch.from_numpy(np.stack([start for _, start in drawn])).float()
    agents = build_agents(
        team, planner, task, preset=experiment.preset, bounds=drawn[0][0].bounds,
        seed=child_seed(experiment.seed, world, wanted.start), weights=tuple(map(Path, experiment.weights)),
    )  # fmt: skip
    with make_simulator(experiment.backend, team.robots) as simulator:
        episodes = run_episodes(
            simulator, [w for w, _ in drawn], starts, agents, task, noise=experiment.noise,
            seed=child_seed(experiment.seed, world, wanted.start, "noise"),
        )  # fmt: skip
    return _rows(world, planner, wanted, episodes)


def _rows(world: str, planner: str, wanted: range, episodes: Episodes) -> list[EpisodeRow]:
    last = episodes.last_step()
    final = episodes.spread()[torch.arange(len(last)), last]
    plan_ms = median_ms(episodes.plan_seconds)
    done, contact = episodes.done_step.tolist(), episodes.contact_step.tolist()

    def seconds(step: int) -> float:
        return round(step * CONTROL_PERIOD, 3) if step >= 0 else math.nan

    return [
        EpisodeRow(
            world=world, planner=planner, episode=episode,
            success=int(done[i] >= 0), time_s=seconds(done[i]),
            first_contact=int(contact[i] >= 0), first_contact_s=seconds(contact[i]),
            collided=int(episodes.collided[i]), final_distance_m=round(float(final[i]), 4),
            steps=int(last[i]), plan_ms=round(plan_ms, 4),
        )
        for i, episode in enumerate(wanted)
    ]  # fmt: skip


def _open_folder(experiment: Experiment, out: Path) -> None:
    config = json.loads(json.dumps(asdict(experiment)))
    file = out / "config.json"
    if file.exists():
        found = json.loads(file.read_text())
        different = [key for key in config if found.get(key) != config[key]]
        if different:
            raise ConfigError(
                f"'{out}' holds another experiment ({', '.join(different)} differ). Choose another --out, or "
                "repeat the same options to resume it."
            )
        return
    try:
        out.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(config, indent=2) + "\n")
    except OSError as error:
        raise ConfigError(f"cannot write to '{out}': {error.strerror}. Choose another --out.") from error


def _read_rows(file: Path) -> list[EpisodeRow]:
    if not file.exists():
        return []
    types: dict[str, Any] = {
        f.name: {"str": str, "int": int, "float": float}[str(f.type)] for f in fields(EpisodeRow)
    }
    with file.open(newline="") as stream:
        try:
            return [EpisodeRow(**{k: types[k](v) for k, v in row.items()}) for row in csv.DictReader(stream)]
        except (KeyError, TypeError, ValueError) as error:
            raise ConfigError(f"'{file}' is damaged ({error!r}). Move it away to start over.") from error


def _write_rows(file: Path, rows: Sequence[EpisodeRow]) -> None:
    """Write all rows to a temporary file and rename it, so that an interruption loses at most one chunk."""
    temporary = file.with_suffix(".tmp")
    try:
        with temporary.open("w", newline="") as stream:
            writer = csv.DictWriter(stream, [f.name for f in fields(EpisodeRow)])
            writer.writeheader()
            writer.writerows(asdict(row) for row in rows)
        temporary.replace(file)
    except OSError as error:
        raise ConfigError(
            f"cannot write '{file}': {error.strerror}. Finished episodes are kept; resume later."
        ) from error
