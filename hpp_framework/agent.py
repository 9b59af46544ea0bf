"""Agents: one robot's skill and planner. The decentralised unit; it reads its own observation only."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.planner import Belief, MetaPlanner
from hpp_framework.robot import RobotSpec
from hpp_framework.seeding import torch_rng
from hpp_framework.sim.simulator import CONTROL_PERIOD
from hpp_framework.skill import Skill
from hpp_framework.task import Task
from hpp_framework.types import Observation

SPEED_STEPS = 3
"""Control steps over which observed motion is averaged."""

BRAKING_SHARE = 0.85
"""Share of the braking distance that is looked ahead: robots come to rest well within the task's reach."""


class Rest:
    """Decides when an agent stops: when braking now leaves everybody where the task is fulfilled.

    "The process stops when the agents are close to each other" (section 4.2 of the paper). A robot that does
    1 m/s needs more than a metre to stop, so it looks ahead by most of everybody's braking distance.

    Args:
        task: the shared objective.
        robots: the team, for its deceleration.
    """

    def __init__(self, task: Task, robots: Sequence[RobotSpec]) -> None:
        self.task = task
        self.deceleration = torch.tensor([robot.drive.acceleration for robot in robots])

    def __call__(self, observation: Observation) -> Bool[Tensor, "b"]:
        """Return whether to rest now, judged from observed poses and their recent change."""
        poses = observation.team_poses
        steps = min(SPEED_STEPS, observation.poses.shape[1] - 1)
        if steps == 0:
            return self.task.met(poses)
        moved = poses[..., :2] - observation.poses[:, -1 - steps, :, :2]
        velocity = moved / (steps * CONTROL_PERIOD)
        braking_time = velocity.norm(dim=-1) / self.deceleration.to(poses)
        stopped = poses[..., :2] + BRAKING_SHARE * velocity * braking_time[..., None] / 2
        halted = torch.cat([stopped, poses[..., 2:]], -1)
        return self.task.met(poses) | self.task.met(halted)


def agent_rng(planner: MetaPlanner, seed: int, index: int) -> torch.Generator:
    """Return the randomness of one agent: its own, or the team's if its planner is centralised.

    Args:
        planner: the agent's.
        seed: of the whole team's randomness.
        index: of the agent in the team.
    """
    return torch_rng(seed, "agents") if planner.centralised else torch_rng(seed, "agent", index)


class Agent:
    """Plans every ``plan_every`` steps, drives every step, rests when that fulfils the task.

    Args:
        skill: drives towards the goal.
        planner: chooses the goal.
        rest: decides when to stop; None never rests.
        rng: the agent's own randomness.
    """

    def __init__(self, skill: Skill, planner: MetaPlanner, rest: Rest | None, rng: torch.Generator) -> None:
        self.skill = skill
        self.planner = planner
        self.rest = rest
        self.rng = rng
        self.belief: Belief | None = None
        self.goal: Tensor = torch.empty(0, 2)
        self._countdown = 0

    def act(self, observation: Observation) -> Float[Tensor, "b 2"]:
        """Return commands [v, omega] for this control step."""
        if self._countdown == 0:
            self.plan(observation)
        self._countdown -= 1
        command = self.skill.act(observation, self.goal)
        if self.rest is None:
            return command
        return command.masked_fill(self.rest(observation)[:, None], 0.0)

    def plan(self, observation: Observation) -> Belief:
        """Choose a goal now, whatever the schedule says, and restart the schedule."""
        self.goal, self.belief = self.planner.plan(observation, self.belief, self.rng)
        self._countdown = self.planner.plan_every
        return self.belief
