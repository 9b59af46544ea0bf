"""From a simulator's state to what each agent observes: sensed, estimated, remembered."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.core import geometry
from hpp_framework.core.disturbances import Disturbances
from hpp_framework.core.estimator import Estimate, Estimator, Reading
from hpp_framework.core.robot import Lidar, RobotSpec
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import Keyframes, Observation, State
from hpp_framework.perception.estimators.raw import Raw
from hpp_framework.perception.sensors import Sensors
from hpp_framework.utils.seeding import EpisodeRng

HISTORY = 5
"""Entries of history that every observation holds (paper, appendix C.3: H = 5)."""

KEYFRAMES = 12
"""Keyframes that an observation holds beside the history."""
KEYFRAME_EVERY = 5
"""Control steps between two keyframes."""

BODY = 0.45
"""Metres from another robot's observed middle within which a point seen is on that robot."""


class Sensing:
    """Hands each agent its observation. Each senses and estimates alone: nothing is shared between agents.

    Args:
        robots: the team.
        disturbances: the same for all, or one for each robot.
        estimators: one for each agent; None takes what was sensed last as it is.
        history: entries that observations hold; fewer cost less.
        keyframes: that observations hold, one per second; 0 for none.
    """

    def __init__(
        self,
        robots: Sequence[RobotSpec],
        disturbances: Disturbances | Sequence[Disturbances],
        estimators: Sequence[Estimator] | None = None,
        *,
        history: int = HISTORY,
        keyframes: int = KEYFRAMES,
    ) -> None:
        self.robots = tuple(robots)
        self.keyframes = keyframes
        one = isinstance(disturbances, Disturbances)
        self.disturbances = tuple([disturbances] * len(robots) if one else disturbances)
        self.sensors = Sensors([robot.lidar for robot in robots], self.disturbances)
        self.estimators = list(estimators or [Raw(robot.lidar) for robot in robots])
        self._memories = [ObservationMemory(agent, history, keyframes) for agent in range(len(robots))]

    @property
    def rng(self) -> EpisodeRng:
        """Source of all that is drawn."""
        return self.sensors.rng

    def reset(self, state: State, rng: EpisodeRng) -> None:
        """Begin histories that repeat the first estimate.

        Args:
            state: at the start.
            rng: source of the disturbances.
        """
        for reading, estimator, memory in self._each(self.sensors.reset(state, rng)):
            memory.reset(estimator.reset(reading))

    def update(self, state: State, commands: Float[Tensor, "b n 2"]) -> None:
        """Append what is estimated after a control step.

        Args:
            state: after the step.
            commands: that the agents sent for it.
        """
        for reading, estimator, memory in self._each(self.sensors.read(state)):
            memory.append(estimator.update(reading, commands[:, reading.agent]))

    def restart(self, state: State, robots: Bool[Tensor, "b n"]) -> None:
        """Begin the histories of the chosen robots anew, as observers and as observed.

        The newest entry of all others is measured again.

        Args:
            state: after the restart.
            robots: which robots begin anew.
        """
        for reading, estimator, memory in self._each(self.sensors.restart(state, robots)):
            touched = robots | robots[:, reading.agent, None]
            memory.restart(estimator.restart(reading, touched), touched)

    def resume(self, observations: Sequence[Observation], state: State) -> None:
        """Go on, undisturbed, from what the agents of other episodes have observed.

        Args:
            observations: of all robots, in team order.
            state: of their episodes.
        """
        self.sensors.reset(state, EpisodeRng(range(len(state.poses))))
        for observation, memory in zip(observations, self._memories, strict=True):
            memory.resume(observation)

    def keep(self, episodes: Bool[Tensor, "b"]) -> None:
        """Go on, undisturbed, with some of the episodes."""
        for memory in self._memories:
            memory.keep(episodes)

    def observe(self, agent: int) -> Observation:
        """Return what one agent knows."""
        return self._memories[agent].observation()

    def _each(self, readings: Sequence[Reading]) -> Iterable[tuple[Reading, Estimator, ObservationMemory]]:
        return zip(readings, self.estimators, self._memories, strict=True)


class ObservationMemory:
    """What one agent remembers: a history of every control step, and keyframes of every second.

    Args:
        agent: index of the robot that remembers.
        history: entries of the history.
        keyframes: that are kept.
    """

    def __init__(self, agent: int, history: int, keyframes: int) -> None:
        self.agent, self.history, self.keyframes = agent, history, keyframes
        self._until_keyframe = KEYFRAME_EVERY

    def reset(self, estimate: Estimate) -> None:
        """Begin with a history that repeats the first estimate."""
        poses, scan = estimate.poses[:, None], estimate.scan[:, None]
        self._now = estimate
        self._poses = poses.repeat(1, self.history, 1, 1)
        self._scans = scan.repeat(1, self.history, 1)
        self._key_poses = poses.repeat(1, self.keyframes, 1, 1)
        self._key_scans = scan.repeat(1, self.keyframes, 1)
        self._until_keyframe = KEYFRAME_EVERY

    def append(self, estimate: Estimate) -> None:
        """Append the estimate of a control step."""
        self._now = estimate
        self._poses = _push(self._poses, estimate.poses)
        if estimate.velocities is not None:
            # of others the past is known late and piecewise; a motion that leads to the present is steadier
            trail = _trail(estimate.poses, estimate.velocities, self.history)
            trail[:, :, self.agent] = self._poses[:, :, self.agent]
            self._poses = trail
        self._scans = _push(self._scans, estimate.scan)
        self._until_keyframe -= 1
        if self.keyframes and self._until_keyframe == 0:
            self._until_keyframe = KEYFRAME_EVERY
            self._key_poses = _push(self._key_poses, estimate.poses)
            self._key_scans = _push(self._key_scans, estimate.scan)

    def restart(self, estimate: Estimate, robots: Bool[Tensor, "b n"]) -> None:
        """Begin anew what is remembered of some of the robots, and measure the rest again."""
        self._now = estimate
        self._poses[:, -1], self._scans[:, -1] = estimate.poses, estimate.scan
        poses, mine = robots[:, None, :, None], robots[:, self.agent, None, None]
        self._poses = torch.where(poses, estimate.poses[:, None], self._poses)
        self._key_poses = torch.where(poses, estimate.poses[:, None], self._key_poses)
        self._scans = torch.where(mine, estimate.scan[:, None], self._scans)
        self._key_scans = torch.where(mine, estimate.scan[:, None], self._key_scans)

    def resume(self, seen: Observation) -> None:
        """Go on from what an agent has observed."""
        self._now = Estimate(seen.team_poses, seen.velocity, seen.scan)
        self._poses, self._scans = seen.poses.clone(), seen.scans.clone()
        self.keyframes = 0 if seen.keyframes is None else seen.keyframes.poses.shape[1]
        if seen.keyframes is not None:
            self._key_poses, self._key_scans = seen.keyframes.poses.clone(), seen.keyframes.scans.clone()
        self._until_keyframe = KEYFRAME_EVERY

    def keep(self, episodes: Bool[Tensor, "b"]) -> None:
        """Go on with some of the episodes."""
        self._now = Estimate(
            self._now.poses[episodes], self._now.velocity[episodes], self._now.scan[episodes]
        )
        self._poses, self._scans = self._poses[episodes], self._scans[episodes]
        if self.keyframes:
            self._key_poses, self._key_scans = self._key_poses[episodes], self._key_scans[episodes]

    def observation(self) -> Observation:
        """Return what the agent knows."""
        now = self._now
        return Observation(
            agent=self.agent, poses=self._poses, scans=self._scans, velocity=now.velocity,
            keyframes=Keyframes(self._key_poses, self._key_scans) if self.keyframes else None,
            velocities=now.velocities, std=now.std, ages=now.ages, scan_age=now.scan_age,
            jitter=now.jitter,
        )  # fmt: skip


def _trail(poses: Float[Tensor, "b n 3"], velocities: Float[Tensor, "b n 2"], entries: int) -> Tensor:
    """Return the last poses (b, h, n, 3) of robots that have driven as they do now."""
    passed = CONTROL_PERIOD * torch.arange(entries - 1, -1, -1, device=poses.device)[:, None]
    speed, turn = velocities[:, None].unbind(-1)
    x, y, heading = poses[:, None].unbind(-1)
    between = heading - turn * passed / 2
    distance = speed * passed
    before = geometry.wrap_angle(heading - turn * passed)
    return torch.stack([x - distance * between.cos(), y - distance * between.sin(), before], -1)


def _push(entries: Tensor, newest: Tensor) -> Tensor:
    """Return entries (b, h, ...) without the oldest and with a new one."""
    return torch.cat([entries[:, 1:], newest[:, None]], 1)


def viewpoints(
    team_poses: Float[Tensor, "b n 3"], scan: Float[Tensor, "b k"], earlier: Keyframes | None
) -> Keyframes:
    """Return what an agent remembers and what it sees now, as one.

    Args:
        team_poses: present poses of all robots.
        scan: its present scan.
        earlier: its keyframes, None for nothing.
    """
    now = Keyframes(team_poses[:, None], scan[:, None])
    if earlier is None:
        return now
    return Keyframes(torch.cat([earlier.poses, now.poses], 1), torch.cat([earlier.scans, now.scans], 1))


def lidar_poses(lidar: Lidar, poses: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 3"]:
    """Return where the lidar is for poses of its robot, world frame."""
    return geometry.compose(poses, poses.new_tensor(lidar.mount).expand_as(poses))


def seen_points(observation: Observation, lidar: Lidar) -> tuple[Float[Tensor, "b q 2"], Bool[Tensor, "b q"]]:
    """Return the ends of all beams, world frame in metres, and which of them lie on things that stand still.

    Args:
        observation: of a robot; its keyframes count too.
        lidar: of the robot.
    """
    seen_from = viewpoints(observation.team_poses, observation.scan, observation.keyframes)
    poses, scans = seen_from.poses, seen_from.scans
    eyes = lidar_poses(lidar, poses[:, :, observation.agent])
    bearing = eyes[..., 2:] + torch.from_numpy(lidar.angles()).to(eyes)
    ends = eyes[:, :, None, :2] + scans[..., None] * torch.stack([bearing.cos(), bearing.sin()], -1)
    hit = scans < lidar.max_range - 0.01
    for robot in range(poses.shape[2]):
        if robot != observation.agent:
            hit &= (ends - poses[:, :, robot, None, :2]).norm(dim=-1) >= BODY
    return ends.flatten(1, 2), hit.flatten(1, 2)
