"""The simulator itself as a predictor: what would really happen if everybody shared a goal."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from hpp_framework.control.stop_on_success import Rest
from hpp_framework.control.terminal_approach import dockings
from hpp_framework.core.predictor import ImaginePlaces, Predictor
from hpp_framework.core.privileged import PrivilegedPredictor
from hpp_framework.core.task import Task
from hpp_framework.core.team import Team
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import Observation, State, Trajectories
from hpp_framework.core.world import World
from hpp_framework.plugins.build import make_skills
from hpp_framework.sim.batch.simulator import BatchSimulator

ROWS = 2048
"""Imagined episodes at a time, so that memory stays bounded."""
ROOM = 10
"""Entries that a history takes before it is moved."""
LOOK = 5
"""Control steps between looks for imagined episodes that have come to rest."""
STILL = 1e-4
"""m/s and rad/s below which a robot stands."""


class TruePredictor(PrivilegedPredictor):
    """Simulates every goal from the true state, with everybody's real skill, until all rest and stand.

    Large teams find room as they really do: each robot has its spot around the shared goal, and docks.

    The imagined episodes are free of noise and run in the batch simulator, also where the real ones run in
    SAPIEN.

    Args:
        team: everybody.
        task: decides when robots rest, as agents do.
        like: the predictor whose times are answered for.
    """

    def __init__(self, team: Team, task: Task, like: Predictor) -> None:
        self.robots = team.robots
        self.skills = make_skills(team)
        self.task = task
        self.rest = Rest(task, team.robots) if task.halts else None
        self.docking = dockings(team.robots, task)
        self.like = like
        self.simulator = BatchSimulator(team.robots)
        self._times: dict[int, Tensor] = {}

    @torch.no_grad()
    def rollout(self, observation: Observation, goals: Float[Tensor, "b g 2"], horizon: int) -> Trajectories:
        """Imagine the motion of the team; episodes that are decided stand still."""
        everybody = goals[:, :, None].expand(-1, -1, len(self.robots), -1)
        return self.condition_places(observation, horizon)(everybody)

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
        state = self.truth.state
        poses = state.poses[:, None, None].repeat(1, candidates, len(times), 1, 1)
        flat, wanted = poses.flatten(0, 1), goals.flatten(0, 1)
        running = self.truth.running.repeat_interleave(candidates).nonzero()[:, 0]
        episode = torch.arange(size).repeat_interleave(candidates)
        marks = (times / CONTROL_PERIOD).round().long().tolist()
        for rows in running.split(ROWS):
            flat[rows] = self._imagine(episode[rows], wanted[rows], marks)
        return Trajectories(flat.unflatten(0, (size, candidates)), times)

    def _imagine(
        self, episode: Int[Tensor, "r"], goals: Float[Tensor, "r n 2"], marks: Sequence[int]
    ) -> Float[Tensor, "r t n 3"]:
        """Return the poses at the marked steps of as many imagined episodes as there are goals."""
        crowd = _Crowd(self, episode, goals)
        out = goals.new_empty(len(goals), len(marks), len(self.robots), 3)
        rows, taken = torch.arange(len(goals)), 0
        for step in range(1, marks[-1] + 1):
            standing = crowd.step()
            while taken < len(marks) and marks[taken] == step:
                out[rows, taken] = crowd.state.poses
                taken += 1
            if step % LOOK == 0 and bool(standing.any()):
                out[rows[standing], taken:] = crowd.state.poses[standing][:, None]
                rows = rows[~standing]
                if not len(rows):
                    break
                crowd.keep(~standing)
        return out


class _Crowd:
    """Imagined episodes side by side."""

    def __init__(self, owner: TruePredictor, episode: Tensor, goals: Tensor) -> None:
        self.owner, self.goals = owner, goals
        truth = owner.truth
        self.worlds = [truth.worlds[index] for index in episode.tolist()]
        self.poses = [_History(seen.poses[episode]) for seen in truth.observations]
        self.scans = [_History(seen.scans[episode]) for seen in truth.observations]
        state = truth.state
        self.state = State(*(part[episode] for part in _parts(state)))
        self._place()

    def step(self) -> Bool[Tensor, "r"]:
        """Let everybody act once, and return which episodes will never change again."""
        seen = [
            Observation(i, poses.window(), scans.window(), self.state.velocities[:, i])
            for i, (poses, scans) in enumerate(zip(self.poses, self.scans, strict=True))
        ]
        goals = self._spots()
        skills = zip(self.owner.skills, seen, goals.unbind(1), strict=True)
        wanted = [skill.act(o, goal) for skill, o, goal in skills]
        if self.owner.docking is not None:
            docked = zip(self.owner.docking, seen, goals.unbind(1), wanted, strict=True)
            wanted = [docking(o, goal, command) for docking, o, goal, command in docked]
        commands = torch.stack(wanted, 1)
        resting = torch.zeros(commands.shape[:2], dtype=torch.bool)
        if self.owner.rest is not None:
            resting = torch.stack([self.owner.rest(o) for o in seen], 1)
            commands = commands.masked_fill(resting[..., None], 0.0)
        self.state = self.owner.simulator.advance(commands)
        for i, robot in enumerate(self.owner.robots):
            self.poses[i].push(self.state.poses)
            lidar = robot.lidar
            scan = self.state.scans[:, i, : lidar.beams].clamp(lidar.min_range, lidar.max_range)
            self.scans[i].push(scan)
        return resting.all(1) & (self.state.velocities.abs() < STILL).all(-1).all(-1)

    def _spots(self) -> Float[Tensor, "r n 2"]:
        """Return where each robot drives: to its goal, or to its spot around the one that all share."""
        spots = self.owner.task.parking(self.goals[:, 0], self.state.poses)
        return self.goals if spots is None else spots

    def keep(self, chosen: Bool[Tensor, "r"]) -> None:
        """Go on with some of the episodes."""
        self.goals = self.goals[chosen]
        self.worlds = [world for world, kept in zip(self.worlds, chosen.tolist(), strict=True) if kept]
        self.poses = [history.keep(chosen) for history in self.poses]
        self.scans = [history.keep(chosen) for history in self.scans]
        self.state = State(*(part[chosen] for part in _parts(self.state)))
        self._place()

    def _place(self) -> None:
        """Bring the simulator into the crowd's state."""
        pool, index = _pool(self.worlds)
        simulator = self.owner.simulator
        simulator.load(pool, episodes=len(self.worlds))
        everybody = torch.ones(self.state.poses.shape[:2], dtype=torch.bool)
        self.state = simulator.place(index, everybody, self.state.poses, self.state.velocities)


class _History:
    """The newest entries of something, oldest first; taking one more in copies nothing but that one.

    Args:
        entries: (b, h, ...) to begin with.
    """

    def __init__(self, entries: Tensor) -> None:
        self.length = entries.shape[1]
        self._data = entries.new_empty(self.length + ROOM, len(entries), *entries.shape[2:])
        self._data[: self.length] = entries.transpose(0, 1)
        self._end = self.length

    def push(self, newest: Tensor) -> None:
        """Take in one more entry (b, ...)."""
        if self._end == len(self._data):
            kept = self.length - 1
            self._data[:kept] = self._data[self._end - kept :].clone()
            self._end = kept
        self._data[self._end] = newest
        self._end += 1

    def window(self) -> Tensor:
        """Return the newest entries (b, h, ...); they share memory with the history."""
        return self._data[self._end - self.length : self._end].transpose(0, 1)

    def keep(self, chosen: Tensor) -> _History:
        """Return the history of some of the rows."""
        return _History(self.window()[chosen])


def _parts(state: State) -> tuple[Tensor, ...]:
    return state.poses, state.velocities, state.scans, state.touched_obstacle, state.touched_robot


def _pool(worlds: Sequence[World]) -> tuple[list[World], Int[Tensor, "r"]]:
    """Return the different worlds, and which of them each row has."""
    place: dict[int, int] = {}
    pool: list[World] = []
    for world in worlds:
        if id(world) not in place:
            place[id(world)] = len(pool)
            pool.append(world)
    return pool, torch.tensor([place[id(world)] for world in worlds], dtype=torch.int32)
