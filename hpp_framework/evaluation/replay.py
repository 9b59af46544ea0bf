"""Runs episodes of an evaluation again, exactly as they were, to look at them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from hpp_framework.core.agent import Agent
from hpp_framework.core.task import Task
from hpp_framework.core.team import Team
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import Observation, State
from hpp_framework.core.world import World
from hpp_framework.evaluation.experiment import CHUNK, Experiment, draw_episode, run_drawn
from hpp_framework.evaluation.recorder import Recorder
from hpp_framework.evaluation.rollout import Episodes
from hpp_framework.viz.record import EpisodeRecord
from hpp_framework.worlds.loader import WorldFactory


@dataclass(frozen=True)
class Replay:
    """Episodes that ran side by side.

    Attributes:
        team: all robots.
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


def replay(experiment: Experiment, factory: WorldFactory, numbers: Sequence[int]) -> Iterator[Replay]:
    """Run episodes of the first world and planner of an experiment again, each as it was.

    Args:
        experiment: what was evaluated.
        factory: of its first world.
        numbers: of the episodes to watch.

    Yields:
        Batches of them.
    """
    name, chunk = experiment.worlds[0], CHUNK[experiment.backend]
    wanted = list(dict.fromkeys(numbers))
    for first in range(0, len(wanted), chunk):
        drawn = {
            number: draw_episode(experiment, name, factory, number)
            for number in wanted[first : first + chunk]
        }
        # planners are told the bounds of their world
        for bounds in dict.fromkeys(world.bounds for world, _ in drawn.values()):
            yield _run(experiment, {n: pair for n, pair in drawn.items() if pair[0].bounds == bounds})


def _run(experiment: Experiment, drawn: Mapping[int, tuple[World, npt.NDArray[np.floating]]]) -> Replay:
    team = experiment.make_team()
    recorders = {number: Recorder(index=index) for index, number in enumerate(drawn)}

    def watch(step: int, state: State, agents: Sequence[Agent], observations: Sequence[Observation]) -> None:
        for recorder in recorders.values():
            recorder(step, state, agents, observations)

    episodes = run_drawn(experiment, experiment.planners[0], experiment.worlds[0], drawn, watch=watch)
    worlds = {number: world for number, (world, _) in drawn.items()}
    return Replay(team, experiment.make_schedule(team)[-1].task, worlds, episodes, recorders)
