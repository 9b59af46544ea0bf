"""Benchmarks of planning: how long one plan takes, and a hundred whole episodes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch

from hpp_framework.bench.measurement import Measurement, Parameter, Settings, ratios, timed
from hpp_framework.bench.rooms import named_world, team_of
from hpp_framework.core.planner import MetaPlanner, PlannerContext
from hpp_framework.core.predictor import PredictorRequest
from hpp_framework.core.team import Team
from hpp_framework.core.types import Observation
from hpp_framework.episodes.core import EpisodeBatch
from hpp_framework.evaluation.experiment import Experiment, run_experiment
from hpp_framework.perception.sensing import HISTORY
from hpp_framework.planning.hpp.cem import CemConfig
from hpp_framework.planning.hpp.lattice import LatticeConfig, LatticePlanner
from hpp_framework.planning.hpp.planner import PRESETS, HppConfig, HppPlanner
from hpp_framework.plugins.registry import hub
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.seeding import EpisodeRng, numpy_rng, torch_rng
from hpp_framework.worlds.spawn import spawn_poses

Plan = Callable[[], object]


def planning(settings: Settings) -> Iterator[Measurement]:
    """Latency of one agent's plan on one core, and of a batch of episodes planned together."""
    for preset in PRESETS:
        yield from _over_team_size(preset, settings)
        yield from _over_batch(preset, settings)
    yield from _over_settings(settings)


def _over_team_size(preset: str, settings: Settings) -> Iterator[Measurement]:
    sizes = settings.pick((2, 3), (2, 4, 8, 32), (2, 4, 8, 16, 32))
    plans = {n: _preset(preset, team_of(settings, n), 1, settings) for n in sizes}
    for n in sizes:
        yield _latency({"preset": preset, "robots": n, "episodes": 1}, _take({n: plans[n]}, settings)[n])
    few, many = sizes[0], sizes[min(2, len(sizes) - 1)]
    taken = _take({n: plans[n] for n in (few, many)}, settings)
    yield Measurement(
        name="plan, ratio", parameters={"preset": preset, "robots": many, "against_robots": few}, unit="x",
        values=ratios(taken[many], taken[few]),
    )  # fmt: skip


def _over_batch(preset: str, settings: Settings) -> Iterator[Measurement]:
    sizes = settings.pick((2,), (16, 128), (4, 16, 64, 256))
    team = team_of(settings, 2)
    for count in sizes:
        taken = _take({count: _preset(preset, team, count, settings)}, settings)[count]
        yield _latency({"preset": preset, "robots": 2, "episodes": count}, taken)


def _over_settings(settings: Settings) -> Iterator[Measurement]:
    """Vary candidates and horizon, one robot of a pair planning."""
    team = team_of(settings, 2)
    observation = _observe(team, 1, settings)
    task = hub().tasks.create(settings.task, team.robots)

    def build(config: HppConfig | LatticeConfig) -> Plan:
        request = PredictorRequest(team=team, agent=0)
        predictor = hub().predictors.create(config.predictor, request)
        planner = (
            HppPlanner(predictor, task, config)
            if isinstance(config, HppConfig)
            else LatticePlanner(predictor, task, config)
        )
        return _from_belief(planner, observation)

    paper, best = HppConfig(), LatticeConfig()
    for samples in settings.pick((5,), (60, 240), (15, 30, 60, 120, 240)):
        cem = CemConfig(samples=samples)
        taken = _take({0: build(replace(paper, cem=cem))}, settings)[0]
        yield _latency({"preset": "paper", "robots": 2, "candidates": samples}, taken)
    for horizon in settings.pick((1,), (10, 20), (1, 10, 20)):
        taken = _take({0: build(replace(paper, horizon=horizon))}, settings)[0]
        yield _latency({"preset": "paper", "robots": 2, "horizon": horizon}, taken)
    for reach in settings.pick((1.0,), (2.0, 8.0), (1.0, 2.0, 8.0)):
        taken = _take({0: build(replace(best, reach=reach))}, settings)[0]
        yield _latency({"preset": "best", "robots": 2, "reach_m": reach}, taken)
    for horizon in settings.pick((1,), (3, 6), (1, 3, 6)):
        taken = _take({0: build(replace(best, horizon=horizon))}, settings)[0]
        yield _latency({"preset": "best", "robots": 2, "horizon": horizon}, taken)


def _take(plans: Mapping[int, Plan], settings: Settings) -> dict[int, list[float]]:
    """Time plans in turns until a budget is spent."""
    named = {str(key): plan for key, plan in plans.items()}
    repeats = settings.pick(2, 200, 1000)
    taken = timed(named, repeats, warm_up=settings.pick(1, 3, 10), budget=settings.pick(1.0, 4.0, 40.0))
    return {key: taken[str(key)] for key in plans}


def _preset(preset: str, team: Team, episodes: int, settings: Settings) -> Plan:
    task = hub().tasks.create(settings.task, team.robots)
    context = PlannerContext(team=team, agent=0, task=task, preset=preset)
    planner: MetaPlanner = hub().planners.create("hpp", context)
    return _from_belief(planner, _observe(team, episodes, settings))


def _from_belief(planner: MetaPlanner, observation: Observation) -> Plan:
    """Return a plan to be repeated; the first of an episode has no belief yet and may skip work."""
    rng = EpisodeRng(range(len(observation.pose)))
    belief = planner.plan(observation, None, rng).belief
    return lambda: planner.plan(observation, belief, rng)


def _observe(team: Team, episodes: int, settings: Settings) -> Observation:
    """Return what the first robot of a team observes after a second of random driving."""
    rng = numpy_rng(settings.seed, "bench", "planning")
    worlds = [named_world("simple", settings, index) for index in range(episodes)]
    starts = [spawn_poses(world, team.robots, rng) for world in worlds]
    batch = EpisodeBatch(BatchSimulator(team.robots))
    batch.begin(worlds, torch.from_numpy(np.stack(starts)).float(), range(episodes))
    driver = torch_rng(settings.seed, "bench", "drive")
    for _ in range(HISTORY):
        batch.step(torch.rand(episodes, len(team), 2, generator=driver))
    return batch.observe(0)


def _latency(parameters: Mapping[str, Parameter], seconds: list[float]) -> Measurement:
    values = tuple(1e3 * each for each in seconds)
    return Measurement(name="plan", parameters={**parameters, "cores": 1}, unit="ms", values=values)


def episodes(settings: Settings) -> Iterator[Measurement]:
    """Seconds that a hundred episodes of HPP in the wall world take, worlds and statistics included."""
    count = settings.pick(1, 100, 100)
    for preset in settings.pick(("best",), tuple(PRESETS), tuple(PRESETS)):

        def run(number: int, preset: str = preset) -> None:
            experiment = Experiment(
                worlds=("wall",), planners=("hpp",), team=settings.team, preset=preset, episodes=number,
                seed=settings.seed, task=settings.task, skill=settings.skill,
            )  # fmt: skip
            with TemporaryDirectory() as folder:
                run_experiment(experiment, Path(folder) / "run")

        if settings.scale != "tiny":
            run(1)
        seconds = timed({"run": lambda r=run: r(count)}, settings.repeats, warm_up=0, budget=30.0)["run"]
        parameters = {"world": "wall", "preset": preset, "episodes": count}
        yield Measurement(name="episodes", parameters=parameters, unit="s", values=tuple(seconds))
