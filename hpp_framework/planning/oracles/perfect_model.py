"""The simulator itself as a predictor: what would really happen if the team shared a goal."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from hpp_framework.core.disturbances import IDEAL
from hpp_framework.core.planner import PlannerContext
from hpp_framework.core.predictor import ImaginePlaces, Predictor
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import Observation, Privileged, Trajectories
from hpp_framework.core.world import World
from hpp_framework.perception.sensing import Sensing
from hpp_framework.plugins.build import make_skills
from hpp_framework.sim.batch.simulator import BatchSimulator

ROWS = 2048
"""Imagined episodes at a time, so that memory stays bounded."""
LOOK = 5
"""Control steps between looks for imagined episodes that have come to rest."""
STILL = 1e-4
"""m/s and rad/s below which a robot stands."""


class PerfectModel(Predictor):
    """Simulates every goal from the true state, as the real agents would drive there, until all stand.

    Each robot drives with its own skill and control stack, and its waypoint is redirected as often as the
    team plans. The imagined episodes are free of noise and run in the batch simulator, also where the real
    ones run in SAPIEN.

    Args:
        context: what a planner is told; its team, task and control count.
        like: the predictor whose times are answered for.
        plan_every: control steps between plans.
    """

    def __init__(self, context: PlannerContext, like: Predictor, plan_every: int) -> None:
        self.robots = context.team.robots
        self.skills = make_skills(context.team)
        self.task = context.task
        self.control = [context.control(index) for index in range(len(self.robots))]
        self.like = like
        self.plan_every = plan_every
        self.simulator = BatchSimulator(self.robots)
        self._times: dict[int, Tensor] = {}

    @torch.no_grad()
    def rollout(self, observation: Observation, goals: Float[Tensor, "b g 2"], horizon: int) -> Trajectories:
        """Imagine the motion of the team; episodes that are decided stand still."""
        shared = goals[:, :, None].expand(-1, -1, len(self.robots), -1)
        return self.condition_places(observation, horizon)(shared)

    def condition_places(self, observation: Observation, horizon: int) -> ImaginePlaces:
        """Prepare :meth:`rollout` for a team in which each robot has its own place."""
        return lambda places: self._simulate(observation, places, horizon)

    @torch.no_grad()
    def _simulate(
        self, observation: Observation, goals: Float[Tensor, "b g n 2"], horizon: int
    ) -> Trajectories:
        if horizon not in self._times:
            first = self.like.rollout(observation.episodes(slice(1)), goals[:1, :1, 0], horizon)
            self._times[horizon] = first.times
        times = self._times[horizon]
        size, candidates = goals.shape[:2]
        privileged = observation.privileged
        assert privileged is not None, "only an oracle asks this predictor"
        state = privileged.state
        poses = state.poses[:, None, None].repeat(1, candidates, len(times), 1, 1)
        flat, wanted = poses.flatten(0, 1), goals.flatten(0, 1)
        running = privileged.running.repeat_interleave(candidates).nonzero()[:, 0]
        episode = torch.arange(size).repeat_interleave(candidates)
        marks = (times / CONTROL_PERIOD).round().long().tolist()
        for rows in running.split(ROWS):
            flat[rows] = self._imagine(privileged, episode[rows], wanted[rows], marks)
        return Trajectories(flat.unflatten(0, (size, candidates)), times)

    def _imagine(
        self,
        privileged: Privileged,
        episode: Int[Tensor, "r"],
        goals: Float[Tensor, "r n 2"],
        marks: Sequence[int],
    ) -> Float[Tensor, "r t n 3"]:
        """Return the poses at the marked steps of as many imagined episodes as there are goals."""
        crowd = _Crowd(self, privileged, episode, goals)
        out = goals.new_empty(len(goals), len(marks), len(self.robots), 3)
        rows, taken = torch.arange(len(goals)), 0
        for step in range(1, marks[-1] + 1):
            stopped = crowd.step()
            while taken < len(marks) and marks[taken] == step:
                out[rows, taken] = crowd.state.poses
                taken += 1
            if step % LOOK == 0 and bool(stopped.any()):
                out[rows[stopped], taken:] = crowd.state.poses[stopped][:, None]
                rows = rows[~stopped]
                if not len(rows):
                    break
                crowd.keep(~stopped)
        return out


class _Crowd:
    """Imagined episodes side by side."""

    def __init__(
        self, owner: PerfectModel, privileged: Privileged, episode: Tensor, goals: Float[Tensor, "r n 2"]
    ) -> None:
        self.owner, self.goals = owner, goals
        self.worlds = [privileged.worlds[index] for index in episode.tolist()]
        self.state = privileged.state.episodes(episode)
        self.sensing = Sensing(owner.robots, IDEAL)
        self.sensing.resume([seen.episodes(episode) for seen in privileged.observations], self.state)
        self.waypoints = goals
        self._step = 0
        self._place()

    def step(self) -> Bool[Tensor, "r"]:
        """Let all robots act once, and return which episodes will never change again."""
        owner, count = self.owner, range(len(self.owner.robots))
        seen = [self.sensing.observe(i) for i in count]
        if self._step % owner.plan_every == 0:
            self.waypoints = self._redirected(seen)
        self._step += 1
        wanted = [owner.skills[i].act(seen[i], self.waypoints[:, i]) for i in count]
        sent = [owner.control[i].filter(seen[i], self.waypoints[:, i], wanted[i]) for i in count]
        commands = torch.stack(sent, 1)
        self.state = owner.simulator.advance(commands)
        self.sensing.update(self.state, commands)
        still = (commands == 0).all(-1) & (self.state.velocities.abs() < STILL).all(-1)
        return still.all(-1)

    def _redirected(self, seen: Sequence[Observation]) -> Float[Tensor, "r n 2"]:
        """Return where each skill is sent: to its own target around the goal that all share."""
        shared = self.goals[:, 0]
        found = self.owner.task.targets(shared, self.state.poses)
        targets = self.goals if found is None else found[..., :2]
        # where each robot has a target of its own already, none is sent to what they share
        same = (self.goals == self.goals[:, :1]).flatten(1).all(1, keepdim=True)
        goal = torch.where(same, shared, torch.nan)
        moved = [self.owner.control[i].redirect(own, goal, targets[:, i]) for i, own in enumerate(seen)]
        return torch.stack(moved, 1)

    def keep(self, chosen: Bool[Tensor, "r"]) -> None:
        """Go on with some of the episodes."""
        self.goals, self.waypoints = self.goals[chosen], self.waypoints[chosen]
        self.worlds = [world for world, kept in zip(self.worlds, chosen.tolist(), strict=True) if kept]
        self.sensing.keep(chosen)
        self.state = self.state.episodes(chosen)
        self._place()

    def _place(self) -> None:
        """Bring the simulator into the crowd's state."""
        pool, index = _pool(self.worlds)
        simulator = self.owner.simulator
        simulator.load(pool, episodes=len(self.worlds))
        whole_team = torch.ones(self.state.poses.shape[:2], dtype=torch.bool)
        self.state = simulator.place(
            index, whole_team, self.state.poses, self.state.velocities, self.state.people
        )


def _pool(worlds: Sequence[World]) -> tuple[list[World], Int[Tensor, "r"]]:
    """Return the different worlds, and which of them each row has."""
    place: dict[int, int] = {}
    pool: list[World] = []
    for world in worlds:
        if id(world) not in place:
            place[id(world)] = len(pool)
            pool.append(world)
    return pool, torch.tensor([place[id(world)] for world in worlds], dtype=torch.int32)
