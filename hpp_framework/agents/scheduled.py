"""Agents of teams that change: robots join late and drop out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from hpp_framework.core.agent import Agent
from hpp_framework.core.planner import Belief
from hpp_framework.core.schedule import Stage
from hpp_framework.core.types import Keyframes, Observation, Trajectories


def restricted(observation: Observation, present: Sequence[int]) -> Observation:
    """Return what an agent knows while it hears of some of the robots only, itself among them.

    Args:
        observation: of the agent, of the whole team.
        present: indices of these robots.
    """
    chosen = list(present)
    kept = observation.keyframes
    return Observation(
        agent=chosen.index(observation.agent),
        poses=observation.poses[:, :, chosen],
        scans=observation.scans,
        velocity=observation.velocity,
        keyframes=None if kept is None else Keyframes(kept.poses[:, :, chosen], kept.scans),
        velocities=None if observation.velocities is None else observation.velocities[:, chosen],
        std=None if observation.std is None else observation.std[:, chosen],
        ages=None if observation.ages is None else observation.ages[:, chosen],
        scan_age=observation.scan_age,
        jitter=observation.jitter,
    )


class ScheduledAgent(Agent):
    """A robot of a team that changes: an agent for each stage in which it takes part, and none in others.

    At each change of the team it plans anew, unless its planner's belief holds for any team. To those who
    look on it shows beliefs about the whole team, in which absent robots stand.

    Args:
        stages: each stage and the robot's agent in it, None where it does not take part.
    """

    def __init__(self, stages: Sequence[tuple[Stage, Agent | None]]) -> None:
        self._stages = tuple(stages)
        self.config = next(agent.config for _, agent in stages if agent is not None)

    def reset(self, seeds: Sequence[int]) -> None:
        """Begin the schedule anew."""
        self._left = list(self._stages)
        self._step = 0
        self._now: Agent | None = None
        self._before: Agent | None = None
        self.belief = None
        for _, agent in self._stages:
            if agent is not None:
                agent.reset(seeds)
        self._begin()

    def act(self, observation: Observation) -> Float[Tensor, "b 2"]:
        """Return commands [v, omega] for this control step: 0 while it does not take part."""
        self._begin()
        self._step += 1
        if self._now is None:
            self.goal = self.waypoint = observation.pose[:, :2]
            self.belief = None
            self.command = torch.zeros_like(observation.velocity)
            return self.command
        before = self._now.belief
        self.command = self._now.act(restricted(observation, self._stage.present))
        self.goal, self.waypoint = self._now.goal, self._now.waypoint
        if self._now.belief is not before or self.belief is None:
            self.belief = self._shown(self._now.belief, observation)
        return self.command

    def plan_seconds(self, observation: Observation, repeats: int) -> list[float]:
        """Return wall times of plans of the present stage; none while the robot does not take part."""
        if self._now is None:
            return []
        return self._now.plan_seconds(restricted(observation, self._stage.present), repeats)

    def _begin(self) -> None:
        """Take up the stage that has begun, if one has."""
        while self._left and self._left[0][0].begun(self._step):
            self._stage, self._now = self._left.pop(0)
            self.present = self._now is not None
            if self._now is not None:
                if self._before is not None:
                    self._now.carry_over(self._before.memory())
                self._before = self._now
            self.belief = None

    def _shown(self, belief: Belief | None, observation: Observation) -> Belief | None:
        """Return a belief in which those who do not take part stand where they are."""
        if belief is None or belief.imagination is None:
            return belief
        imagined = belief.imagination.trajectories
        team = observation.team_poses[:, None, None].repeat(1, *imagined.poses.shape[1:3], 1, 1)
        team[..., list(self._stage.present), :] = imagined.poses
        shown = replace(belief.imagination, trajectories=Trajectories(team, imagined.times))
        return Belief(belief.goal, belief.mean, belief.std, shown)
