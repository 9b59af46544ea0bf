"""Data that travels between the rooms: states, observations, trajectories.

Everything is a torch tensor with a leading batch dimension ``b`` (episodes). The letters in shapes:
``b`` episodes, ``n`` robots, ``k`` lidar beams, ``h`` history entries (oldest first), ``m`` keyframes, ``g``
goal candidates, ``t`` predicted times.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

from jaxtyping import Bool, Float, Int
from torch import Tensor

from hpp_framework.core.world import World

Answer = TypeVar("Answer")


@dataclass(frozen=True)
class People:
    """Who walks around, side by side for all episodes; rows beyond the people of an episode are NaN.

    Attributes:
        poses: x, y in metres and walking direction in radians, world frame.
        velocities: along x and y of the world frame, in m/s.
        progress: next place of the route, direction along it (1 or -1), seconds of getting nowhere.
        time: since the episode began, in substeps of the simulator.
    """

    poses: Float[Tensor, "b p 3"]
    velocities: Float[Tensor, "b p 2"]
    progress: Float[Tensor, "b p 3"]
    time: Int[Tensor, "b"]

    def episodes(self, chosen: slice | Tensor) -> People:
        """Return the people of some of the episodes."""
        return People(*(getattr(self, each.name)[chosen] for each in fields(self)))


@dataclass(frozen=True)
class State:
    """What a simulator knows after a step; noise-free.

    Attributes:
        poses: x, y in metres and heading in radians, world frame.
        velocities: forward speed in m/s and turn rate in rad/s.
        scans: lidar ranges in metres, beam 0 at the most clockwise angle; a robot with fewer beams than the
            widest lidar of the team is padded with its maximum range.
        touched_obstacle: whether the robot touched an obstacle during the last control step.
        touched_robot: whether it touched another robot during the last control step.
        touched_person: whether it touched a person while it was driving, during the last control step; None
            where nothing moves but robots.
        people: who walks around, and the time; None where nothing moves but robots.
    """

    poses: Float[Tensor, "b n 3"]
    velocities: Float[Tensor, "b n 2"]
    scans: Float[Tensor, "b n k"]
    touched_obstacle: Bool[Tensor, "b n"]
    touched_robot: Bool[Tensor, "b n"]
    touched_person: Bool[Tensor, "b n"] | None = None
    people: People | None = None

    @property
    def collided(self) -> Bool[Tensor, "b n"]:
        """Whether the robot touched anything during the last control step."""
        touched = self.touched_obstacle | self.touched_robot
        return touched if self.touched_person is None else touched | self.touched_person

    def episodes(self, chosen: slice | Tensor) -> State:
        """Return the state of some of the episodes."""
        known = [each.name for each in fields(self) if getattr(self, each.name) is not None]
        rows: dict[str, Any] = {name: getattr(self, name)[chosen] for name in known if name != "people"}
        return State(**rows, people=self.people and self.people.episodes(chosen))


@dataclass(frozen=True)
class Keyframes:
    """What an agent remembers of the last seconds: now and then a scan, and all robots' poses at that time.

    Attributes:
        poses: noisy poses of all robots in the world frame, oldest first.
        scans: own lidar, oldest first.
    """

    poses: Float[Tensor, "b m n 3"]
    scans: Float[Tensor, "b m k"]


@dataclass(frozen=True)
class Privileged:
    """What no robot knows: for oracles, upper bounds to compare decentralised planners with.

    Attributes:
        worlds: one per episode.
        state: of the simulator, noise-free.
        observations: of all agents, in team order.
        running: episodes that are not decided yet.
    """

    worlds: Sequence[World]
    state: State
    observations: Sequence[Observation]
    running: Bool[Tensor, "b"]
    _answers: dict[str, Any] = field(default_factory=lambda: dict[str, Any](), repr=False, compare=False)

    def once(self, question: str, answer: Callable[[], Answer]) -> Answer:
        """Return the answer to a question, worked out for the first agent that asks and the same for all.

        Args:
            question: what is asked; questions of different planners need different names.
            answer: works it out.
        """
        if question not in self._answers:
            self._answers[question] = answer()
        return self._answers[question]

    def episodes(self, chosen: slice) -> Privileged:
        """Return what is known of some of the episodes."""
        seen = [observation.episodes(chosen) for observation in self.observations]
        return Privileged(self.worlds[chosen], self.state.episodes(chosen), seen, self.running[chosen])


@dataclass(frozen=True)
class Observation:
    """What one agent knows: noisy poses of the team, its own lidar, its own odometry.

    Attributes:
        agent: index of the observing robot in the team.
        poses: noisy poses of all robots in the world frame, oldest first.
        scans: own lidar, oldest first.
        velocity: own forward speed (m/s) and turn rate (rad/s).
        keyframes: what it remembers beyond the history; None where they are not kept.
        velocities: estimated speed (m/s) and turn rate (rad/s) of all robots; None where no estimator says.
        std: standard deviations of each robot's position along each axis (m), heading (rad) and speed (m/s):
            relative to the agent; of its own, in the world. None where no estimator says.
        ages: seconds since each robot was last heard of or seen; None where no estimator says.
        scan_age: seconds since the lidar last sent what can be believed; None where no estimator checks.
        jitter: seconds by which the next command may act earlier or later than the poses are for; None where
            no estimator says.
        privileged: what no robot knows, where the episodes are run by who does; None elsewhere. Only oracles
            may read it.
    """

    agent: int
    poses: Float[Tensor, "b h n 3"]
    scans: Float[Tensor, "b h k"]
    velocity: Float[Tensor, "b 2"]
    keyframes: Keyframes | None = None
    velocities: Float[Tensor, "b n 2"] | None = None
    std: Float[Tensor, "b n 3"] | None = None
    ages: Float[Tensor, "b n"] | None = None
    scan_age: Float[Tensor, "b"] | None = None
    jitter: Float[Tensor, "b"] | None = None
    privileged: Privileged | None = field(default=None, repr=False)

    def episodes(self, chosen: slice | Int[Tensor, "k"]) -> Observation:
        """Return what the agent itself knows in some of the episodes."""
        kept = self.keyframes and Keyframes(self.keyframes.poses[chosen], self.keyframes.scans[chosen])
        believed = (self.velocities, self.std, self.ages, self.scan_age, self.jitter)
        velocities, std, ages, scan_age, jitter = (None if e is None else e[chosen] for e in believed)
        return Observation(
            self.agent, self.poses[chosen], self.scans[chosen], self.velocity[chosen], kept, velocities, std,
            ages, scan_age, jitter,
        )  # fmt: skip

    @property
    def pose(self) -> Float[Tensor, "b 3"]:
        """The agent's own newest pose."""
        return self.poses[:, -1, self.agent]

    @property
    def team_poses(self) -> Float[Tensor, "b n 3"]:
        """Newest poses of all robots."""
        return self.poses[:, -1]

    @property
    def scan(self) -> Float[Tensor, "b k"]:
        """The newest scan."""
        return self.scans[:, -1]


@dataclass(frozen=True)
class Trajectories:
    """Imagined motion of a whole team for each goal candidate.

    Attributes:
        poses: predicted poses in the world frame; the heading is NaN where a predictor gives positions only.
        times: seconds ahead of now, one per predicted step, increasing.
        std: standard deviation of the predicted positions in metres, along each axis; None where a predictor
            does not say how sure it is.
    """

    poses: Float[Tensor, "b g t n 3"]
    times: Float[Tensor, "t"]
    std: Float[Tensor, "b g t n"] | None = None
