"""Runs episodes of an evaluation again, exactly as they were, to look at them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from hpp_framework.agents.hierarchical import Agent
from hpp_framework.core.task import Task
from hpp_framework.core.team import Team
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import Observation, State
from hpp_framework.core.world import World
from hpp_framework.evaluation.experiment import CHUNK, Experiment, draw_episode, make_agents
from hpp_framework.evaluation.recorder import Recorder
from hpp_framework.evaluation.rollout import Episodes, run_episodes
from hpp_framework.sim import make_simulator
from hpp_framework.utils.seeding import child_seed
from hpp_framework.viz.record import EpisodeRecord
from hpp_framework.worlds.loader import WorldFactory


@dataclass(frozen=True)
class Replay:
    """Episodes that ran side by side.

    Attributes:
        team: everybody.
        task: the shared objective, that of the end if the team changed.
        worlds: by episode, in the order of the batch.
        episodes: what happened.
        recorders: of the episodes that were watched.
    """

    team: Team
    task: Task
    worlds: Mapping[int, World]
    episodes: Episodes
    recorders: Mapping[int, Recorder]

    def record(self, number: int, about: Mapping[str, Any]) -> EpisodeRecord:
        """Return a watched episode.

        Args:
            number: of the episode.
            about: what it was, plain data; how it ended is added.
        """
        return self.recorders[number].record(
            about, self.worlds[number], self.team, self.episodes, period=CONTROL_PERIOD
        )


def describe(config: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a record says of its episode.

    Args:
        config: what ``hpp run`` records to repeat it.
    """
    planner = config["planners"][0]
    return {
        "world": config["worlds"][0],
        "planner": planner,
        **{name: config[name] for name in ("preset", "team", "backend", "seed", "episode")},
        "config": config,
        "planner_config": config["planner_configs"].get(planner),
    }


def replay(
    experiment: Experiment, factory: WorldFactory, numbers: Sequence[int], of: int
) -> Iterator[Replay]:
    """Run episodes of the first world and planner of an experiment again.

    Args:
        experiment: what was evaluated.
        factory: of its first world.
        numbers: of the episodes to watch.
        of: episodes a cell of the evaluation, to run whole batches as they were, since random numbers and
            rounding depend on the batch; 0 runs each episode alone.

    Yields:
        Each batch that holds any of the episodes.
    """
    left = list(dict.fromkeys(numbers))
    while left:
        drawn = _batch(experiment, factory, left[0], of)
        watched = [number for number in left if number in drawn]
        yield _run(experiment, drawn, watched)
        left = [number for number in left if number not in drawn]


def _batch(
    experiment: Experiment, factory: WorldFactory, number: int, of: int
) -> dict[int, tuple[World, npt.NDArray[np.floating]]]:
    """Return world and start of the episodes that an evaluation runs side by side with the chosen one."""
    name, chunk = experiment.worlds[0], CHUNK[experiment.backend]
    own = draw_episode(experiment, name, factory, number)
    if not of:
        return {number: own}
    first = number - number % chunk
    others: Iterable[int] = range(first, min(first + chunk, of))
    drawn = {other: draw_episode(experiment, name, factory, other) for other in others}
    return {other: pair for other, pair in drawn.items() if pair[0].bounds == own[0].bounds}


def _run(
    experiment: Experiment,
    drawn: Mapping[int, tuple[World, npt.NDArray[np.floating]]],
    watched: Sequence[int],
) -> Replay:
    name, first = experiment.worlds[0], min(drawn)
    team = experiment.make_team()
    turns = experiment.make_turns(team)
    worlds = {number: world for number, (world, _) in drawn.items()}
    starts = torch.from_numpy(np.stack([start for _, start in drawn.values()])).float()
    seed = child_seed(experiment.seed, name, first)
    bounds = worlds[first].bounds
    agents = make_agents(experiment, experiment.planners[0], team, turns, bounds, seed=seed)
    recorders = {number: Recorder(index=list(drawn).index(number)) for number in watched}

    def watch(step: int, state: State, agents: Sequence[Agent], observations: Sequence[Observation]) -> None:
        for recorder in recorders.values():
            recorder(step, state, agents, observations)

    with make_simulator(experiment.backend, team.robots) as simulator:
        episodes = run_episodes(
            simulator, list(worlds.values()), starts, agents, turns,
            noise=team.noises(experiment.noise), seed=child_seed(experiment.seed, name, first, "noise"),
            watch=watch,
        )  # fmt: skip
    return Replay(team, turns[-1].task, worlds, episodes, recorders)
