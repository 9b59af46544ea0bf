"""Agents: one robot's skill and planner. The decentralised unit; it reads its own observation only."""

from __future__ import annotations

import time

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.planner import Belief, MetaPlanner
from hpp_framework.skill import Skill
from hpp_framework.task import Task
from hpp_framework.types import Observation


class Agent:
    """Plans every ``plan_every`` steps, drives every step, rests once it sees the task fulfilled.

    Args:
        skill: drives towards the goal.
        planner: chooses the goal.
        task: the shared objective; with it the agent stops when the poses *it observes* fulfil the task ("the
            process stops when the agents are close to each other", section 4.2 of the paper). None never
            rests.
        rng: the agent's own randomness.
    """

    def __init__(self, skill: Skill, planner: MetaPlanner, task: Task | None, rng: torch.Generator) -> None:
        self.skill = skill
        self.planner = planner
        self.task = task
        self.rng = rng
        self.belief: Belief | None = None
        self.plan_seconds: list[float] = []
        self._countdown = 0

    def act(self, observation: Observation) -> Float[Tensor, "b 2"]:
        """Return commands [v, omega] for this control step."""
        if self._countdown == 0:
            self.plan(observation)
        self._countdown -= 1
        assert self.belief is not None
        command = self.skill.act(observation, self.belief.goal)
        if self.task is None:
            return command
        return command.masked_fill(self.task.met(observation.team_poses)[:, None], 0.0)

    def plan(self, observation: Observation) -> Belief:
        """Choose a goal now, whatever the schedule says, and restart the schedule."""
        started = time.perf_counter()
        _, self.belief = self.planner.plan(observation, self.belief, self.rng)
        self.plan_seconds.append(time.perf_counter() - started)
        self._countdown = self.planner.plan_every
        return self.belief
