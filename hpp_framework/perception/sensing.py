"""From a simulator's state to what each agent knows: noise, drop-outs and histories.

Noise lives here, once, so that both simulators are noisy in the same way.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.core import geometry
from hpp_framework.core.disturbances import NoiseModel
from hpp_framework.core.robot import Lidar, RobotSpec
from hpp_framework.core.types import Keyframes, Observation, State
from hpp_framework.utils.seeding import EpisodeRng

HISTORY = 5
"""Entries of history that every observation holds (paper, appendix C.3: H = 5)."""

KEYFRAMES = 12
"""Keyframes that an observation holds beside the history."""
KEYFRAME_EVERY = 5
"""Control steps between two keyframes."""

HEARD = 3
"""Poses of another robot that came last, from which its motion is read."""
MOVED_ON = 5
"""Control steps by which the last pose that came is moved on, at most: robots turn and stop."""

BODY = 0.45
"""Metres from another robot's observed middle within which a point seen is on that robot."""


class Sensing:
    """Keeps histories and hands each agent its observation.

    Each agent sees its own draw of the pose noise: nothing is shared between agents.

    Args:
        robots: the team.
        noise: disturbances, the same for all or one for each robot as it observes.
        history: entries that observations hold; fewer cost less.
        keyframes: that observations hold, one a second; 0 for none.

    Attributes:
        intensity: share of the noise that each episode has (b,), or None for all of it; the delay is the same
            for all.
    """

    def __init__(
        self,
        robots: Sequence[RobotSpec],
        noise: NoiseModel | Sequence[NoiseModel],
        *,
        history: int = HISTORY,
        keyframes: int = KEYFRAMES,
    ) -> None:
        self.history = history
        self.keyframes = keyframes
        self.robots = tuple(robots)
        self.noises = [noise] * len(robots) if isinstance(noise, NoiseModel) else list(noise)
        self._delays = [each.delay for each in self.noises]
        self.delay = max(self._delays)
        self._reckons = self.delay > 0 or any(each.pose_dropout for each in self.noises)
        self.rng = EpisodeRng(())
        self.intensity: Tensor | None = None
        self._poses: Tensor = torch.empty(0)
        self._sent: Tensor = torch.empty(0)
        self._heard: Tensor = torch.empty(0)
        self._heard_at: Tensor = torch.empty(0)
        self._step = 0
        self._scans: list[Tensor] = []
        self._velocities: Tensor = torch.empty(0)
        self._key_poses: Tensor = torch.empty(0)
        self._key_scans: list[Tensor] = []
        self._until_keyframe = KEYFRAME_EVERY

    def reset(self, state: State, rng: EpisodeRng) -> None:
        """Begin histories that repeat the first measurement.

        Args:
            state: at the start.
            rng: source of the noise.
        """
        self.rng = rng
        poses, scans = self._measure(state)
        self._poses = poses[:, None].repeat(1, self.history, 1, 1, 1)
        self._sent = poses[:, None].repeat(1, self.delay + 1, 1, 1, 1)
        if self._reckons:  # as if nothing had moved before
            self._heard = poses[:, None].repeat(1, HEARD, 1, 1, 1)
            steps = torch.arange(1.0 - HEARD, 1.0).to(poses)[:, None] - poses.new_tensor(self._delays)
            self._heard_at = steps[None, :, :, None].expand(self._heard.shape[:4])
        self._step = 0
        self._scans = [scan[:, None].repeat(1, self.history, 1) for scan in scans]
        self._velocities = state.velocities
        self._key_poses = poses[:, None].repeat(1, self.keyframes, 1, 1, 1)
        self._key_scans = [scan[:, None].repeat(1, self.keyframes, 1) for scan in scans]
        self._until_keyframe = KEYFRAME_EVERY

    def update(self, state: State) -> None:
        """Append a measurement of everybody."""
        poses, scans = self._measure(state)
        self._sent = _push(self._sent, poses)
        self._step += 1
        poses = self._receive(poses)
        self._poses = _push(self._poses, poses)
        self._scans = [_push(old, new) for old, new in zip(self._scans, scans, strict=True)]
        self._velocities = state.velocities
        self._until_keyframe -= 1
        if self.keyframes and self._until_keyframe == 0:
            self._until_keyframe = KEYFRAME_EVERY
            self._key_poses = _push(self._key_poses, poses)
            self._key_scans = [_push(old, new) for old, new in zip(self._key_scans, scans, strict=True)]

    def restart(self, state: State, robots: Bool[Tensor, "b n"]) -> None:
        """Begin the histories of the chosen robots anew, as observers and as observed.

        The newest entry of everybody else is measured again.

        Args:
            state: after the restart.
            robots: which robots begin anew.
        """
        poses, scans = self._measure(state)
        touched = robots[:, :, None] | robots[:, None, :]
        self._sent[:, -1] = poses
        self._sent = torch.where(touched[:, None, :, :, None], poses[:, None], self._sent)
        if self._reckons:
            self._heard = torch.where(touched[:, None, :, :, None], poses[:, None], self._heard)
        self._poses[:, -1] = self._receive(poses)
        self._poses = torch.where(touched[:, None, :, :, None], poses[:, None], self._poses)
        self._key_poses = torch.where(touched[:, None, :, :, None], poses[:, None], self._key_poses)
        for i, scan in enumerate(scans):
            self._scans[i][:, -1] = scan
            self._scans[i] = torch.where(robots[:, None, i, None], scan[:, None], self._scans[i])
            self._key_scans[i] = torch.where(robots[:, None, i, None], scan[:, None], self._key_scans[i])
        self._velocities = state.velocities

    def resume(self, observations: Sequence[Observation], state: State) -> None:
        """Go on, without noise, from what the agents of other episodes have seen.

        Args:
            observations: of all robots, in team order.
            state: of their episodes.
        """
        self._poses = torch.stack([seen.poses for seen in observations], 2)
        self._scans = [seen.scans.clone() for seen in observations]
        self._velocities = state.velocities
        kept = [seen.keyframes for seen in observations if seen.keyframes is not None]
        self.keyframes = kept[0].poses.shape[1] if kept else 0
        if kept:
            self._key_poses = torch.stack([each.poses for each in kept], 2)
            self._key_scans = [each.scans.clone() for each in kept]
        self._until_keyframe = KEYFRAME_EVERY
        self._sent = self._poses[:, -1:]

    def keep(self, episodes: Bool[Tensor, "b"]) -> None:
        """Go on with some of the episodes."""
        for name in ("_poses", "_velocities", "_sent", "_key_poses"):
            setattr(self, name, getattr(self, name)[episodes])
        self._scans = [scan[episodes] for scan in self._scans]
        self._key_scans = [scan[episodes] for scan in self._key_scans]

    def observe(self, agent: int) -> Observation:
        """Return what one agent knows."""
        return Observation(
            agent=agent,
            poses=self._poses[:, :, agent],
            scans=self._scans[agent],
            velocity=self._velocities[:, agent],
            keyframes=Keyframes(self._key_poses[:, :, agent], self._key_scans[agent])
            if self.keyframes
            else None,
        )

    def _measure(self, state: State) -> tuple[Tensor, list[Tensor]]:
        """Return poses (b, observers, n, 3) and a scan (b, k) a robot."""
        count = len(self.robots)
        poses = state.poses[:, None].repeat(1, count, 1, 1)
        if any(noise.position_std or noise.heading_std for noise in self.noises):
            rows = [(noise.position_std, noise.position_std, noise.heading_std) for noise in self.noises]
            std = poses.new_tensor(rows)[:, None]
            poses = poses + self._normal(poses) * self._scaled(std, poses)
        return poses, [
            self._scan(state.scans[:, i, : robot.lidar.beams], robot, noise)
            for i, (robot, noise) in enumerate(zip(self.robots, self.noises, strict=True))
        ]

    def _receive(self, measured: Tensor) -> Tensor:
        """Return what everybody knows (b, observers, n, 3): its own pose at once, the others' as reckoned."""
        if not self._reckons:
            return measured
        lost_shares = [noise.pose_dropout for noise in self.noises]
        came = torch.stack([self._sent[:, -1 - delay, i] for i, delay in enumerate(self._delays)], 1)
        sent_at = self._step - came.new_tensor(self._delays)[:, None].expand(came.shape[:3])
        arrived = torch.ones(came.shape[:3], dtype=torch.bool, device=came.device)
        if any(lost_shares):
            share = self._scaled(measured.new_tensor(lost_shares)[:, None], measured[..., 0])
            arrived = self.rng.uniform(*measured.shape[1:3]).to(measured) >= share
        new = arrived[:, None]
        self._heard = torch.where(new[..., None], _push(self._heard, came), self._heard)
        self._heard_at = torch.where(new, _push(self._heard_at, sent_at), self._heard_at)
        own = torch.eye(len(self.robots), dtype=torch.bool, device=measured.device)
        return torch.where(own[:, :, None], measured, self._reckoned())

    def _reckoned(self) -> Tensor:
        """Return where everybody would be now (b, observers, n, 3) if it moved on as it was last heard to."""
        last, before = self._heard[:, -1], self._heard[:, 0]
        change = last - before
        change = torch.cat([change[..., :2], geometry.wrap_angle(change[..., 2:])], -1)
        passed = (self._heard_at[:, -1] - self._heard_at[:, 0]).clamp(min=1)
        age = (self._step - self._heard_at[:, -1]).clamp(max=MOVED_ON)
        return last + change * (age / passed)[..., None]

    def _scan(self, scan: Tensor, robot: RobotSpec, noise: NoiseModel) -> Tensor:
        std = robot.lidar.noise_std if noise.scan_std is None else noise.scan_std
        if std:
            hit = scan < robot.lidar.max_range
            scan = torch.where(hit, scan + self._scaled(std, scan) * self._normal(scan), scan)
        if noise.dropout:
            lost = self.rng.uniform(*scan.shape[1:]).to(scan) < self._scaled(noise.dropout, scan)
            scan = scan.masked_fill(lost, robot.lidar.max_range)
        return scan.clamp(robot.lidar.min_range, robot.lidar.max_range)

    def _scaled(self, strength: Tensor | float, like: Tensor) -> Tensor | float:
        if self.intensity is None:
            return strength
        return self.intensity.to(like).reshape(-1, *[1] * (like.dim() - 1)) * strength

    def _normal(self, like: Tensor) -> Tensor:
        return self.rng.normal(*like.shape[1:]).to(like)


def _push(entries: Tensor, newest: Tensor) -> Tensor:
    """Return entries (b, h, ...) without the oldest and with a new one."""
    return torch.cat([entries[:, 1:], newest[:, None]], 1)


def glimpses(
    team_poses: Float[Tensor, "b n 3"], scan: Float[Tensor, "b k"], earlier: Keyframes | None
) -> Keyframes:
    """Return what an agent remembers and what it sees now, as one.

    Args:
        team_poses: everybody's present poses.
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
    seen_from = glimpses(observation.team_poses, observation.scan, observation.keyframes)
    poses, scans = seen_from.poses, seen_from.scans
    eyes = lidar_poses(lidar, poses[:, :, observation.agent])
    bearing = eyes[..., 2:] + torch.from_numpy(lidar.angles()).to(eyes)
    ends = eyes[:, :, None, :2] + scans[..., None] * torch.stack([bearing.cos(), bearing.sin()], -1)
    hit = scans < lidar.max_range - 0.01
    for robot in range(poses.shape[2]):
        if robot != observation.agent:
            hit &= (ends - poses[:, :, robot, None, :2]).norm(dim=-1) >= BODY
    return ends.flatten(1, 2), hit.flatten(1, 2)
