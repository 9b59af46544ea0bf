"""Runs teams of agents through episodes, all episodes of a batch side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from hpp_framework.core.agent import Agent
from hpp_framework.core.disturbances import IDEAL, Disturbances
from hpp_framework.core.estimator import Estimator
from hpp_framework.core.schedule import Schedule, presence
from hpp_framework.core.types import Observation, State
from hpp_framework.core.world import World
from hpp_framework.episodes.core import EpisodeBatch
from hpp_framework.sim.simulator import Simulator

EPISODE_STEPS = 100
"""Control steps per episode (20 s; appendix C.1)."""

LATENCY_REPEATS = 4
"""Plans timed an agent, after a first one that begins without a belief."""


@dataclass(frozen=True)
class Episodes:
    """What happened; times are counted in control steps, -1 means never.

    Attributes:
        poses: true poses, from the start on.
        goals: the goal each robot's skill had in each step.
        done_step: step at which success had been sustained long enough.
        contact_step: first step at which the task was met, motion aside.
        touched_obstacle: whether any robot touched an obstacle before the episode was done.
        touched_robot: whether any two robots touched each other before the episode was done.
        plan_seconds: wall time of single plans from a belief on, one episode and one agent at a time.
        present: which robots take part at each time; None for all robots all the time.
        touched_person: whether any robot drove into a person before the episode was done; None for never.
    """

    poses: Float[Tensor, "b t n 3"]
    goals: Float[Tensor, "b s n 2"]
    done_step: Int[Tensor, "b"]
    contact_step: Int[Tensor, "b"]
    touched_obstacle: Bool[Tensor, "b"]
    touched_robot: Bool[Tensor, "b"]
    plan_seconds: list[float]
    present: Bool[Tensor, "t n"] | None = None
    touched_person: Bool[Tensor, "b"] | None = None

    @property
    def collided(self) -> Bool[Tensor, "b"]:
        """Whether any robot touched anything before the episode was done."""
        touched = self.touched_obstacle | self.touched_robot
        return touched if self.touched_person is None else touched | self.touched_person

    def last_step(self) -> Int[Tensor, "b"]:
        """Return the step at which each episode ended: done, or out of time."""
        return torch.where(self.done_step >= 0, self.done_step, self.poses.shape[1] - 1)

    def spread(self) -> Float[Tensor, "b t"]:
        """Return the mean distance between those who take part over time, in metres (0 for a lone robot)."""
        xy = self.poses[..., :2]
        apart = (xy[:, :, :, None] - xy[:, :, None]).norm(dim=-1)
        if self.present is None:
            count = xy.shape[2]
            return apart.sum((-1, -2)) / max(count * (count - 1), 1)
        together = self.present[:, :, None] & self.present[:, None]
        counts = self.present.sum(1)
        return (apart * together).sum((-1, -2)) / (counts * (counts - 1)).clamp(min=1)


Watcher = Callable[[int, State, Sequence[Agent], Sequence[Observation]], None]
"""Called after planning in each step with (step, state, agents, their observations)."""


def run_episodes(
    simulator: Simulator,
    worlds: Sequence[World],
    starts: Float[Tensor, "b n 3"],
    agents: Sequence[Agent],
    schedule: Schedule,
    *,
    seeds: Sequence[int],
    disturbances: Disturbances | Sequence[Disturbances] = IDEAL,
    estimators: Sequence[Estimator] | None = None,
    steps: int = EPISODE_STEPS,
    watch: Watcher | None = None,
) -> Episodes:
    """Run one episode per world until all are done or time is up.

    Args:
        simulator: steps the robots; reset here.
        worlds: one per episode.
        starts: start poses.
        agents: in team order; reset here.
        schedule: who takes part when, with the task of those who do.
        seeds: of agents and disturbances, one per episode.
        disturbances: of sensing and acting, the same for all or one for each robot.
        estimators: one for each agent; None takes what was sensed last as it is.
        steps: control steps at most.
        watch: looks on, e.g. to draw pictures.
    """
    batch = EpisodeBatch(simulator, schedule, disturbances=disturbances, estimators=estimators)
    batch.begin(worlds, starts, seeds)
    for agent in agents:
        agent.reset(seeds)
    poses, goals = [batch.state.poses], list[Tensor]()
    plan_seconds = _latencies(batch, agents)
    for step in range(steps):
        observations = batch.observe_all()
        commands = torch.stack([agent.act(o) for agent, o in zip(agents, observations, strict=True)], 1)
        goals.append(torch.stack([agent.goal for agent in agents], 1))
        if watch:
            watch(step, batch.state, agents, observations)
        poses.append(batch.step(commands).poses)
        if not bool(batch.running.any()):
            break
    if watch:
        watch(len(goals), batch.state, agents, batch.observe_all())
    return Episodes(
        poses=torch.stack(poses, 1).cpu(),
        goals=torch.stack(goals, 1).cpu(),
        done_step=batch.done_step,
        contact_step=batch.contact_step,
        touched_obstacle=batch.touched_obstacle,
        touched_robot=batch.touched_robot,
        touched_person=batch.touched_person,
        plan_seconds=plan_seconds,
        present=presence(schedule, len(poses), len(agents)) if len(schedule) > 1 else None,
    )


def _latencies(batch: EpisodeBatch, agents: Sequence[Agent]) -> list[float]:
    """Time single plans on the first episode; agents' state and randomness stay untouched."""
    seconds: list[float] = []
    for agent, observation in zip(agents, batch.observe_all(), strict=True):
        privileged = observation.privileged
        alone = replace(
            observation.episodes(slice(1)), privileged=privileged and privileged.episodes(slice(1))
        )
        seconds += agent.plan_seconds(alone, LATENCY_REPEATS)
    return seconds


def median_ms(seconds: Sequence[float]) -> float:
    """Return the median in milliseconds."""
    return float(np.median(seconds) * 1e3) if seconds else float("nan")
