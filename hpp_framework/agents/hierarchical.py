"""The agent of the paper: a planner chooses goals, a skill drives to them, layers have the last word."""

from __future__ import annotations

import time
from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.agent import Agent, Memory
from hpp_framework.core.control import ControlLayer
from hpp_framework.core.planner import Belief, Decision, MetaPlanner
from hpp_framework.core.skill import Skill
from hpp_framework.core.types import Observation
from hpp_framework.utils.seeding import EpisodeRng, child_seed


class HierarchicalAgent(Agent):
    """Plans every ``plan_every`` control steps, drives every step.

    Args:
        planner: the upper level; chooses a goal from the agent's own observation.
        skill: the lower level; drives there where the planner chooses no option.
        control: between the skill and the wheels.
        index: of the robot in its team; tells its randomness from that of the others.
    """

    def __init__(self, planner: MetaPlanner, skill: Skill, control: ControlLayer, index: int) -> None:
        self.planner = planner
        self.skill = skill
        self.control = control
        self.index = index
        self.config = getattr(planner, "config", None)

    def reset(self, seeds: Sequence[int]) -> None:
        """Forget the episodes before; the next :meth:`act` plans."""
        names = ("agents",) if self.planner.shared_rng else ("agent", self.index)
        self.rng = EpisodeRng([child_seed(seed, *names) for seed in seeds])
        self.decision: Decision | None = None
        self.belief = None
        self._until_plan = 0

    def act(self, observation: Observation) -> Float[Tensor, "b 2"]:
        """Return commands [v, omega] for this control step."""
        if self._until_plan == 0 or self.decision is None:
            self.plan(observation)
        else:
            self._take(observation, self.planner.follow(observation, self.decision))
        self._until_plan -= 1
        self.command = self.control.filter(observation, self.waypoint, self._drive(observation))
        return self.command

    def plan(self, observation: Observation) -> Belief:
        """Choose a goal now, whatever the schedule says, and restart the schedule."""
        self.decision, decision = None, self.planner.plan(observation, self.belief, self.rng)
        self._take(observation, decision)
        self._until_plan = self.planner.plan_every
        return decision.belief

    def memory(self) -> Memory | None:
        """Return what it goes on from."""
        if self.decision is None:
            return None
        return Memory(self.rng, self._until_plan, self.decision, self.waypoint)

    def carry_over(self, memory: Memory | None) -> None:
        """Go on from the memory of another agent of the same robot, if the planner's belief still holds."""
        if memory is None or self.planner.carry_over(memory.decision.belief) is None:
            return
        self.rng, self._until_plan = memory.rng, memory.until_plan
        self.decision, self.belief = memory.decision, memory.decision.belief
        self.goal, self.waypoint = memory.decision.belief.goal, memory.waypoint

    def plan_seconds(self, observation: Observation, repeats: int) -> list[float]:
        """Return wall times of plans from a belief on; a first plan, which may skip work, supplies it."""
        if not self.planner.timed:
            return []
        belief = self.planner.plan(observation, None, EpisodeRng([0])).belief
        seconds: list[float] = []
        for repeat in range(repeats):
            rng = EpisodeRng([repeat])
            started = time.perf_counter()
            belief = self.planner.plan(observation, belief, rng).belief
            seconds.append(time.perf_counter() - started)
        return seconds

    def _take(self, observation: Observation, decision: Decision) -> None:
        """Follow a decision; only where it sends the robot elsewhere are the layers asked again."""
        moved = self.decision is None or decision.goal is not self.decision.goal
        self.decision, self.belief, self.goal = decision, decision.belief, decision.belief.goal
        if moved:
            self.waypoint = self.control.redirect(observation, self.goal, decision.goal)

    def _drive(self, observation: Observation) -> Float[Tensor, "b 2"]:
        """Return the commands of the agent's skill, or of the options that its planner chose."""
        assert self.decision is not None, "plans come before drives"
        chosen = self.decision.option
        if chosen is None:
            return self.skill.act(observation, self.waypoint)
        command = torch.zeros_like(observation.velocity)
        for index, option in enumerate(self.planner.options):
            rows = (chosen == index)[:, None]
            if bool(rows.any()):
                command = torch.where(rows, option.skill.act(observation, self.waypoint), command)
        return command
