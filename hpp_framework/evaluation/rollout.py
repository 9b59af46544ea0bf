"""Runs teams of agents through episodes, all episodes of a batch side by side."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from hpp_framework.agents.hierarchical import Agent, make_agent
from hpp_framework.agents.scheduled import Shift, attendance
from hpp_framework.config.planner_choice import make_planner, parse_planner
from hpp_framework.core.disturbances import NoiseModel
from hpp_framework.core.planner import PlannerContext
from hpp_framework.core.privileged import PrivilegedPlanner, Truth
from hpp_framework.core.task import Task
from hpp_framework.core.team import Team
from hpp_framework.core.types import Observation, State
from hpp_framework.core.world import World
from hpp_framework.perception.sensing import Sensing
from hpp_framework.plugins.build import make_skills
from hpp_framework.sim.simulator import Simulator
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.seeding import torch_rng

EPISODE_STEPS = 100
"""Control steps an episode (20 s; appendix C.1)."""

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
        present: who takes part at each time; None for everybody all the time.
    """

    poses: Float[Tensor, "b t n 3"]
    goals: Float[Tensor, "b s n 2"]
    done_step: Int[Tensor, "b"]
    contact_step: Int[Tensor, "b"]
    touched_obstacle: Bool[Tensor, "b"]
    touched_robot: Bool[Tensor, "b"]
    plan_seconds: list[float]
    present: Bool[Tensor, "t n"] | None = None

    @property
    def collided(self) -> Bool[Tensor, "b"]:
        """Whether any robot touched anything before the episode was done."""
        return self.touched_obstacle | self.touched_robot

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


def build_agents(
    team: Team,
    planner: str,
    task: Task,
    *,
    preset: str = "best",
    bounds: tuple[float, float, float, float] = (-10.0, -10.0, 10.0, 10.0),
    seed: int = 0,
    weights: tuple[Path, ...] = (),
    settings: Mapping[str, Any] | None = None,
) -> list[Agent]:
    """Give every robot of a team its skill and a planner of its own.

    Args:
        team: everybody.
        planner: registered meta-planner, with settings of its own or without, e.g. ``"hpp:keep=0.05"``; of
            all members that name none.
        task: the shared objective.
        preset: of the planner.
        bounds: of the world, metres.
        seed: of the agents' randomness; centralised planners share one source.
        weights: extra folders searched for predictor weights.
        settings: of every planner that has parameters, by dotted name; not of planners that members name.

    Raises:
        ConfigError: if a ceiling is to plan for a team in which somebody plans otherwise.
    """
    agents: list[Agent] = []
    for index, (member, skill) in enumerate(zip(team.members, make_skills(team), strict=True)):
        named = member.planner or planner
        choice = parse_planner(named)
        context = PlannerContext(
            team=team, agent=index, task=task, preset=preset, bounds=bounds, weights=weights,
            settings=settings or {} if member.planner is None else {},
        )  # fmt: skip
        made = make_planner(named, context)
        if isinstance(made, PrivilegedPlanner):
            _check_ceiling(team, named)
        agents.append(
            make_agent(index, skill, made, task, team.robots, seed, guard=choice.guard, guide=choice.guide)
        )
    return agents


def _check_ceiling(team: Team, planner: str) -> None:
    """Refuse a ceiling, which plans for everybody, where somebody has another planner."""
    for member in team.members:
        if member.planner is not None:
            raise ConfigError(
                f"planner '{planner}' is a ceiling: it plans for the whole team, but '{member.id}' has a "
                f"planner of its own, '{member.planner}'. Leave out either."
            )


def run_episodes(
    simulator: Simulator,
    worlds: Sequence[World],
    starts: Float[Tensor, "b n 3"],
    agents: Sequence[Agent],
    task: Task | Sequence[Shift],
    *,
    noise: NoiseModel | Sequence[NoiseModel] | None = None,
    seed: int = 0,
    steps: int = EPISODE_STEPS,
    watch: Watcher | None = None,
) -> Episodes:
    """Run one episode a world until all are done or time is up.

    Args:
        simulator: steps the robots; reset here.
        worlds: one an episode.
        starts: start poses.
        agents: fresh ones, in team order.
        task: the shared objective; or who takes part when, each time with the task of those who do.
        noise: disturbances of what agents observe, the same for all or one for each robot.
        seed: of the noise.
        steps: control steps at most.
        watch: looks on, e.g. to draw pictures.
    """
    state = simulator.reset(worlds, starts)
    sensing = Sensing(simulator.robots, noise or NoiseModel(), torch_rng(seed, "sensing"))
    sensing.reset(state)
    everybody = tuple(range(len(agents)))
    turns = (Shift(0, everybody, complete=True, task=task),) if isinstance(task, Task) else task
    score = _Score(len(worlds), turns)
    poses, goals = [state.poses], list[Tensor]()
    plan_seconds = _latencies([sensing.observe(i) for i in range(len(agents))], agents)
    for step in range(steps):
        observations = [sensing.observe(i) for i in range(len(agents))]
        _show(Truth(worlds, state, observations, score.done_step < 0), agents)
        commands = torch.stack([agent.act(o) for agent, o in zip(agents, observations, strict=True)], 1)
        goals.append(torch.stack([agent.goal for agent in agents], 1))
        if watch:
            watch(step, state, agents, observations)
        state = simulator.step(commands)
        sensing.update(state)
        poses.append(state.poses)
        score.update(step + 1, state)
        if bool((score.done_step >= 0).all()):
            break
    if watch:
        watch(len(goals), state, agents, [sensing.observe(i) for i in range(len(agents))])
    return Episodes(
        poses=torch.stack(poses, 1).cpu(),
        goals=torch.stack(goals, 1).cpu(),
        done_step=score.done_step,
        contact_step=score.contact_step,
        touched_obstacle=score.touched_obstacle,
        touched_robot=score.touched_robot,
        plan_seconds=plan_seconds,
        present=attendance(turns, len(poses), len(agents)) if len(turns) > 1 else None,
    )


class _Score:
    """Judges episodes by their true state."""

    def __init__(self, episodes: int, turns: Sequence[Shift]) -> None:
        self.turns = list(turns)
        self.turn = self.turns.pop(0)
        self.done_step = torch.full((episodes,), -1)
        self.contact_step = torch.full((episodes,), -1)
        self.touched_obstacle = torch.zeros(episodes, dtype=torch.bool)
        self.touched_robot = torch.zeros(episodes, dtype=torch.bool)
        self._sustained = torch.zeros(episodes, dtype=torch.int64)

    def update(self, step: int, state: State) -> None:
        """Judge what the control step before this one led to."""
        while self.turns and self.turns[0].begun(step - 1):
            self.turn = self.turns.pop(0)
            self._sustained.zero_()
        running = self.done_step < 0
        self.touched_obstacle |= state.touched_obstacle.any(1).cpu() & running
        self.touched_robot |= state.touched_robot.any(1).cpu() & running
        if not self.turn.complete:
            return
        task, present = self.turn.task, list(self.turn.present)
        poses, velocities = state.poses[:, present], state.velocities[:, present]
        met = task.met(poses).cpu() & (self.contact_step < 0) & running
        self.contact_step[met] = step
        done = task.done(poses, velocities).cpu()
        self._sustained = torch.where(done, self._sustained + 1, 0)
        self.done_step[running & (self._sustained >= task.sustain_steps)] = step


def _show(truth: Truth, agents: Sequence[Agent]) -> None:
    for agent in agents:
        if isinstance(agent.planner, PrivilegedPlanner):
            agent.planner.witness(truth)


def _latencies(observations: Sequence[Observation], agents: Sequence[Agent]) -> list[float]:
    """Time single plans on the first episode; agents' state and randomness stay untouched.

    The first plan of an episode has no belief to go on and may skip work, so it only supplies the belief of
    the timed ones. What privileged planners take means nothing.
    """
    seconds: list[float] = []
    for agent, observation in zip(agents, observations, strict=True):
        if isinstance(agent.planner, PrivilegedPlanner) or not agent.present:
            continue
        alone = agent.view(observation.episodes(slice(1)))
        _, belief = agent.planner.plan(alone, None, torch.Generator().manual_seed(0))
        for repeat in range(LATENCY_REPEATS):
            rng = torch.Generator().manual_seed(repeat)
            started = time.perf_counter()
            _, belief = agent.planner.plan(alone, belief, rng)
            seconds.append(time.perf_counter() - started)
    return seconds


def median_ms(seconds: Sequence[float]) -> float:
    """Return the median in milliseconds."""
    return float(np.median(seconds) * 1e3) if seconds else float("nan")
