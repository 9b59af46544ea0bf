"""From a simulator's state to what reaches each agent: localisation, odometry, messages and lidars.

Disturbances live here, once, so that both simulators are disturbed in the same way.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.core import geometry
from hpp_framework.core.disturbances import Disturbances
from hpp_framework.core.estimator import Reading
from hpp_framework.core.robot import Lidar
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import State
from hpp_framework.perception.mailbox import Mailbox
from hpp_framework.utils.seeding import EpisodeRng

PANE = 0.5
"""Metres of a pane of glass."""


class Sensors:
    """Senses a team; keeps what errs slowly and what is under way.

    Args:
        lidars: of the team.
        disturbances: one for each robot: of its localisation, its odometry, its lidar and what it hears.

    Attributes:
        intensity: share of the disturbances' sizes that each episode has (b,), or None for all of it.
    """

    def __init__(self, lidars: Sequence[Lidar], disturbances: Sequence[Disturbances]) -> None:
        self.lidars = tuple(lidars)
        self.disturbances = tuple(disturbances)
        self.intensity: Tensor | None = None
        self.rng = EpisodeRng(())
        each = self.disturbances
        rows = [(d.position_std, d.position_std, d.heading_std) for d in each]
        self._white = torch.tensor(rows)
        self._drift = torch.tensor([(d.position_drift, d.position_drift, d.heading_drift) for d in each])
        self._bias = torch.tensor([(d.position_bias, d.position_bias, d.heading_bias) for d in each])
        self._decay = torch.tensor([math.exp(-CONTROL_PERIOD / d.drift_time) for d in each])
        self._jumps = torch.tensor([d.jump_rate * CONTROL_PERIOD for d in each])
        self._jump_size = torch.tensor([d.jump_size for d in each])
        self._scale = torch.tensor([d.odometry_scale for d in each])
        self._slip = torch.tensor([d.odometry_slip for d in each])
        self._sensing = torch.tensor([d.sensing_delay for d in each])
        self._late = any(
            d.message_delay or d.message_loss or d.message_sight or math.isfinite(d.message_range)
            for d in each
        )

    def reset(self, state: State, rng: EpisodeRng) -> list[Reading]:
        """Begin with a state of robots at rest, and return what reaches each agent.

        Args:
            state: at the start.
            rng: source of all that is drawn.
        """
        self.rng = rng
        poses = state.poses
        count = poses.shape[1]
        self._error = self._drawn(self._drift, poses)
        self._constant = self._drawn(self._bias, poses)
        self._scaled_by = 1 + self._drawn(self._scale[:, None], poses[..., :1])
        self._slipping = self._drawn(self._slip[:, None], poses[..., :1])
        clocks = torch.tensor([d.clock_offset for d in self.disturbances])[:, None]
        self._clock = self._drawn(clocks, poses.new_zeros(len(poses), count, count))
        self._dead = [
            self.rng.uniform() if d.dead_sector else poses.new_zeros(len(poses)) for d in self.disturbances
        ]
        self._failing = [poses.new_zeros(len(poses)) for _ in self.disturbances]
        self._half = [torch.zeros(len(poses), dtype=torch.bool) for _ in self.disturbances]
        fixes = self._fixes(poses)
        self._mail: Mailbox | None = None
        if self._late:
            longest = max(d.message_delay + d.message_jitter - d.sensing_delay for d in self.disturbances)
            self._mail = Mailbox(longest, fixes[:, None].repeat(1, count, 1, 1))
        self._last = [
            self._ranges(i, state.scans[:, i, : lidar.beams], poses[:, i])
            for i, lidar in enumerate(self.lidars)
        ]
        return self._readings(state, fixes)

    def read(self, state: State) -> list[Reading]:
        """Return what reaches each agent after a control step.

        Args:
            state: after the step.
        """
        poses = state.poses
        if bool(self._drift.any() or self._jumps.any()):
            decay = self._decay[:, None]
            self._error = decay * self._error + self._drawn(self._drift * (1 - decay**2).sqrt(), poses)
        if bool(self._jumps.any()):
            jumps, angle = self.rng.uniform(2, poses.shape[1]).to(poses).unbind(1)
            size = torch.where(jumps < self._jumps, self._jump_size, 0.0)
            angle = 2 * math.pi * angle
            self._error = self._error + torch.stack(
                [size * angle.cos(), size * angle.sin(), torch.zeros_like(size)], -1
            )
        if bool(self._slip.any()):
            decay = self._decay[:, None]
            change = self._drawn(self._slip[:, None] * (1 - decay**2).sqrt(), poses[..., :1])
            self._slipping = decay * self._slipping + change
        fixes = self._fixes(poses)
        if self._mail is not None:
            self._mail.send(fixes[:, None].expand_as(self._mail.content), self._delays(state))
        self._last = [
            self._sent(i, self._ranges(i, state.scans[:, i, : lidar.beams], poses[:, i]))
            for i, lidar in enumerate(self.lidars)
        ]
        return self._readings(state, fixes)

    def restart(self, state: State, robots: Bool[Tensor, "b n"]) -> list[Reading]:
        """Measure again after some robots have been put elsewhere.

        Args:
            state: after that.
            robots: which.
        """
        fixes = self._fixes(state.poses)
        if self._mail is not None:
            content = fixes[:, None].expand_as(self._mail.content)
            self._mail.restart(content, robots[:, :, None] | robots[:, None, :])
        for i, lidar in enumerate(self.lidars):
            self._failing[i] = self._failing[i].masked_fill(robots[:, i], 0.0)
            self._last[i] = self._ranges(i, state.scans[:, i, : lidar.beams], state.poses[:, i])
        return self._readings(state, fixes)

    def _fixes(self, poses: Float[Tensor, "b n 3"]) -> Float[Tensor, "b n 3"]:
        """Return where each robot's localisation has it."""
        if not bool(self._white.any() or self._drift.any() or self._bias.any() or self._jumps.any()):
            return poses
        found = poses + self._error + self._constant + self._drawn(self._white, poses)
        return torch.cat([found[..., :2], geometry.wrap_angle(found[..., 2:])], -1)

    def _readings(self, state: State, fixes: Float[Tensor, "b n 3"]) -> list[Reading]:
        count = len(self.lidars)
        velocities = state.velocities
        if bool(self._scale.any() or self._slip.any()):
            velocities = velocities * (self._scaled_by + self._slipping)
        heard = fixes[:, None].expand(-1, count, -1, -1)
        fresh = torch.ones(heard.shape[:3], dtype=torch.bool, device=fixes.device)
        ages = self._sensing[:, None].to(fixes).expand(heard.shape[:3])
        if self._mail is not None:
            own = torch.eye(count, dtype=torch.bool, device=fixes.device)
            content, new = self._mail.newest(0.0)
            heard = torch.where(own[..., None], heard, content)
            fresh = new | own
            stamped = self._mail.age.to(fixes) + self._sensing[:, None].to(fixes) + self._clock
            ages = torch.where(own, ages, stamped)
        return [
            Reading(i, heard[:, i], ages[:, i], fresh[:, i], velocities[:, i], self._last[i])
            for i in range(count)
        ]

    def _delays(self, state: State) -> Float[Tensor, "b n n"]:
        """Return when each observer's readings hold the pose that each robot sends now; never if it is lost.

        What an observer senses now reaches it late as well, and messages may come meanwhile.
        """
        poses = state.poses
        shape = (len(poses), len(self.lidars), len(self.lidars))
        draws, losses = self.rng.uniform(2, *shape[1:]).to(poses).unbind(1)

        def by_observer(values: Sequence[float]) -> Tensor:
            return poses.new_tensor(values)[:, None]

        delay = by_observer([d.message_delay - d.sensing_delay for d in self.disturbances])
        jitter = by_observer([d.message_jitter for d in self.disturbances])
        lost = losses < self._scaled(by_observer([d.message_loss for d in self.disturbances]), losses)
        gap = poses[:, None, :, :2] - poses[:, :, None, :2]
        distance = gap.norm(dim=-1)
        lost |= distance > by_observer([d.message_range for d in self.disturbances])
        for i, (disturbances, lidar) in enumerate(zip(self.disturbances, self.lidars, strict=True)):
            if disturbances.message_sight:
                lost[:, i] |= ~_in_sight(poses, i, state.scans[:, i, : lidar.beams], lidar)
        return (delay + jitter * (2 * draws - 1)).masked_fill(lost, torch.inf)

    def _ranges(
        self, robot: int, scan: Float[Tensor, "b k"], pose: Float[Tensor, "b 3"]
    ) -> Float[Tensor, "b k"]:
        """Return the ranges that a lidar measures."""
        lidar, disturbances = self.lidars[robot], self.disturbances[robot]
        if disturbances.glass:
            through = (scan < lidar.max_range) & _glass(_ends(scan, pose, lidar), disturbances.glass)
            scan = scan.masked_fill(through, lidar.max_range)
        std = lidar.noise_std if disturbances.scan_std is None else disturbances.scan_std
        if std:
            noise = self.rng.normal(*scan.shape[1:]).to(scan)
            scan = torch.where(scan < lidar.max_range, scan + self._scaled(std, scan) * noise, scan)
        if disturbances.lost_beams:
            share = self._scaled(disturbances.lost_beams, scan)
            scan = scan.masked_fill(self.rng.uniform(*scan.shape[1:]).to(scan) < share, lidar.max_range)
        if disturbances.dead_sector:
            width = round(disturbances.dead_sector * lidar.beams)
            first = (self._dead[robot] * (lidar.beams - width + 1)).long()[:, None]
            beam = torch.arange(lidar.beams, device=scan.device)
            scan = scan.masked_fill((beam >= first) & (beam < first + width), lidar.max_range)
        scan = scan.clamp(lidar.min_range, lidar.max_range)
        if disturbances.nan_beams:
            share = self._scaled(disturbances.nan_beams, scan)
            scan = scan.masked_fill(self.rng.uniform(*scan.shape[1:]).to(scan) < share, torch.nan)
        return scan

    def _sent(self, robot: int, scan: Float[Tensor, "b k"]) -> Float[Tensor, "b k"]:
        """Return what the lidar sends of the ranges that it measures: while it fails, something else."""
        disturbances, lidar = self.disturbances[robot], self.lidars[robot]
        if not disturbances.fault_rate:
            return scan
        begins, half = self.rng.uniform(2).to(scan).unbind(1)
        left = (self._failing[robot] - CONTROL_PERIOD).clamp(min=0)
        starts = (left == 0) & (begins < disturbances.fault_rate * CONTROL_PERIOD)
        self._failing[robot] = torch.where(starts, disturbances.fault_time, left)
        self._half[robot] = torch.where(starts, half < 0.5, self._half[robot])
        upper = torch.arange(lidar.beams, device=scan.device) >= lidar.beams // 2
        match disturbances.fault:
            case "frozen":
                failed = self._last[robot]
            case "blind":
                failed = torch.full_like(scan, lidar.max_range)
            case "nan":
                failed = torch.full_like(scan, torch.nan)
            case "half":
                failed = scan.masked_fill(upper == self._half[robot][:, None], lidar.max_range)
        return torch.where(self._failing[robot][:, None] > 0, failed, scan)

    def _drawn(self, std: Float[Tensor, "*s"], like: Float[Tensor, "b *s2"]) -> Float[Tensor, "b *s2"]:
        """Return normal numbers of a standard deviation; where that is 0 for all, none is drawn."""
        if not bool(std.any()):
            return torch.zeros_like(like)
        return self.rng.normal(*like.shape[1:]).to(like) * self._scaled(std.to(like), like)

    def _scaled(self, size: Tensor | float, like: Tensor) -> Tensor | float:
        if self.intensity is None:
            return size
        return self.intensity.to(like).reshape(-1, *[1] * (like.dim() - 1)) * size


def _ends(scan: Float[Tensor, "b k"], pose: Float[Tensor, "b 3"], lidar: Lidar) -> Float[Tensor, "b k 2"]:
    """Return where beams end, world frame, metres."""
    eye = geometry.compose(pose, pose.new_tensor(lidar.mount).expand_as(pose))
    bearing = eye[:, 2:] + torch.from_numpy(lidar.angles()).to(eye)
    return eye[:, None, :2] + scan[..., None] * torch.stack([bearing.cos(), bearing.sin()], -1)


def _glass(places: Float[Tensor, "b k 2"], share: float) -> Bool[Tensor, "b k"]:
    """Return which places lie on glass: the same places of a world for all robots at all times."""
    x, y = (places / PANE).floor().long().unbind(-1)
    mixed = (x * 73856093) ^ (y * 19349663)  # Teschner et al. 2003, a hash of grid cells
    return (mixed * 2654435761 % 2**32) < share * 2**32


def _in_sight(
    poses: Float[Tensor, "b n 3"], robot: int, scan: Float[Tensor, "b k"], lidar: Lidar
) -> Bool[Tensor, "b n"]:
    """Return which robots' middles lie in the view of one's lidar, no more than half a metre behind a hit."""
    eye = geometry.compose(poses[:, robot], poses.new_tensor(lidar.mount).expand_as(poses[:, robot]))
    distance, bearing = geometry.polar(eye[:, None], poses[..., :2]).unbind(-1)
    step = lidar.field_of_view / (lidar.beams - 1)
    beam = ((bearing + lidar.field_of_view / 2) / step).round().long()
    inside = (beam >= 0) & (beam < lidar.beams) & (distance < lidar.max_range)
    seen = scan.gather(1, beam.clamp(0, lidar.beams - 1))
    return inside & (seen > distance - PANE)
