"""Agents: one robot's skill and planner. The decentralised unit; it reads its own observation only."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.control.rotate_to_path import Guide
from hpp_framework.control.safety_filter import Guard
from hpp_framework.control.stop_on_success import Rest
from hpp_framework.control.terminal_approach import Docking, docks
from hpp_framework.core.planner import Belief, MetaPlanner
from hpp_framework.core.policy import Policy
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.skill import Skill
from hpp_framework.core.task import Task
from hpp_framework.core.types import Observation
from hpp_framework.utils.seeding import torch_rng


def agent_rng(planner: MetaPlanner, seed: int, index: int) -> torch.Generator:
    """Return the randomness of one agent: its own, or the team's if its planner is centralised.

    Args:
        planner: the agent's.
        seed: of the whole team's randomness.
        index: of the agent in the team.
    """
    return torch_rng(seed, "agents") if planner.centralised else torch_rng(seed, "agent", index)


def make_agent(
    index: int,
    skill: Skill,
    planner: MetaPlanner,
    task: Task,
    robots: Sequence[RobotSpec],
    seed: int,
    *,
    guard: bool = True,
    guide: bool | None = None,
) -> Agent:
    """Build the agent of one robot of a team.

    Args:
        index: of the robot.
        skill: the robot's.
        planner: the robot's.
        task: the shared objective.
        robots: the team.
        seed: of the whole team's randomness.
        guard: whether it has a guard.
        guide: whether it has a guide; None leaves it to the planner.
    """
    robot = robots[index]
    own_guard = Guard(robot)
    guided = planner.guided if guide is None else guide
    may_dock = _heeds_others(planner) and docks(task, len(robots), guided=guided)
    return Agent(
        skill,
        planner,
        Rest(task, robots) if task.halts and planner.rests else None,
        agent_rng(planner, seed, index),
        own_guard if guard else None,
        Guide(robot) if guided else None,
        Docking(robots, index, own_guard, task) if may_dock else None,
    )


def _heeds_others(planner: MetaPlanner) -> bool:
    """Return whether an agent of a planner leaves its skill's way for the sake of the others."""
    return planner.rests and not planner.heedless and not isinstance(planner, Policy)


class Agent:
    """Plans every ``plan_every`` steps, drives every step, rests when that fulfils the task.

    Args:
        skill: drives towards the goal; a planner that is a policy drives itself.
        planner: chooses the goal.
        rest: decides when to stop; None never rests.
        rng: the agent's own randomness.
        guard: keeps the robot off obstacles; None drives as the skill wants.
        guide: turns the robot round at a plan where its way leads back, and keeps it from slowing down before
            a place to meet; None leaves all ways to the skill.
        docking: takes over from the skill near the robot's spot in a gathering, and drives two that see each
            other straight together; None leaves it to the skill.

    Attributes:
        present: whether the robot takes part now.
        belief: what the planner said last.
        goal: that it chose last for the team, world coordinates, metres.
        waypoint: that the skill drives to: the goal, the robot's own place around it, or on the way there.
    """

    def __init__(
        self,
        skill: Skill,
        planner: MetaPlanner,
        rest: Rest | None,
        rng: torch.Generator,
        guard: Guard | None = None,
        guide: Guide | None = None,
        docking: Docking | None = None,
    ) -> None:
        self.skill = planner if isinstance(planner, Policy) else skill
        self.planner = planner
        self.rest = rest
        self.rng = rng
        self.guard = guard
        self.guide = guide
        self.docking = docking
        self.present = True
        self.belief: Belief | None = None
        self.goal: Tensor = torch.empty(0, 2)
        self.waypoint: Tensor = self.goal
        self._countdown = 0

    def act(self, observation: Observation) -> Float[Tensor, "b 2"]:
        """Return commands [v, omega] for this control step."""
        if self._countdown == 0:
            self.plan(observation)
        elif self.belief is not None:
            self.waypoint, self.belief = self.planner.follow(observation, self.waypoint, self.belief)
        self._countdown -= 1
        command = self.skill.act(observation, self.waypoint)
        if self.docking is not None:
            command = self.docking(observation, self.waypoint, command)
        if self.rest is not None:
            command = command.masked_fill(self.resting(observation)[:, None], 0.0)
        return command if self.guard is None else self.guard(observation, command)

    def resting(self, observation: Observation) -> Bool[Tensor, "b"]:
        """Return whether the robot halts because that fulfils the task."""
        if self.rest is None:
            return torch.zeros(len(observation.pose), dtype=torch.bool, device=observation.pose.device)
        return self.rest(observation)

    def view(self, observation: Observation) -> Observation:
        """Return what the planner is shown of an observation."""
        return observation

    def go_on_from(self, other: Agent) -> None:
        """Take over what another agent of the same robot had in mind, and its randomness."""
        self.rng, self.belief, self._countdown = other.rng, other.belief, other._countdown
        self.goal, self.waypoint = other.goal, other.waypoint

    def plan(self, observation: Observation) -> Belief:
        """Choose a goal now, whatever the schedule says, and restart the schedule."""
        self.waypoint, self.belief = self.planner.plan(observation, self.belief, self.rng)
        self.goal = self.belief.goal
        if self.guide is not None:
            # who never rests, or has a place of its own, must halt where it is sent
            halt = (self.waypoint != self.goal).any(-1) | (self.rest is None)
            self.waypoint = self.guide(observation, self.waypoint, halt)
        self._countdown = self.planner.plan_every
        return self.belief
