"""The tracker: a Kalman filter a robot, corrected by messages and by what the lidar sees of teammates.

Localisation errs slowly, and all that counts for a team that gathers is where robots are *relative* to each
other. So a track has, beside pose and speeds, the error of that robot's localisation against the agent's own
frame; messages tell the sum of both, the lidar the position alone. What is estimated is moved on to the
moment at which the next command acts, and the own scan with it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hpp_framework.config.settings import altered
from hpp_framework.core.disturbances import Disturbances
from hpp_framework.core.estimator import Estimate, Estimator, EstimatorContext, Reading
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.perception.estimators import tracker_kernels as kernels
from hpp_framework.perception.estimators.raw import cleaned
from hpp_framework.utils.kernels import vectors, wp
from hpp_framework.utils.validation import Flag, NonNegative, Positive, Share, validated

LEVER = 2.0
"""Metres at which an error of the own heading displaces others in the own frame."""
MANOEUVRE = 1.0
"""Seconds for which a robot speeds up or slows down (Singer 1970)."""
STILL = 0.05
"""m/s and rad/s below which a robot stands."""
RECENT, EVERY = 16, 2
"""Control steps for which scans are kept, and the distance of those that are used."""
FEW = 8
"""Beams that must have hit something to tell whether a lidar works."""


@validated
class TrackerConfig:
    """What the tracker counts on.

    Attributes:
        sightings: whether the lidar corrects where teammates are.
        noise: factor on the standard deviations that a calibration gives; 1 if it is right.
        delay: factor on the delays that a calibration gives; 1 if it is right.
        agility: share of the deceleration of other robots' drives with which their speeds may change.
        ahead: seconds without news for which a robot is taken to go on as before.
        missing: share of the beams that should hit something and miss, from which on a scan is not believed.
        patience: seconds after which a robot at rest believes its lidar again.
    """

    sightings: Flag = True
    noise: Positive = 1.0
    delay: NonNegative = 1.0
    agility: Share = 1.0
    ahead: NonNegative = 1.0
    missing: Share = 0.3
    patience: NonNegative = 10.0


@dataclass
class _Tracks:
    """What changes, in memory that Warp shares."""

    states: Tensor
    covariances: Tensor
    silent: Tensor

    def arrays(self) -> tuple[Any, Any, Any]:
        return (
            wp.from_torch(self.silent),
            wp.from_torch(self.states, dtype=kernels.Vec9),
            wp.from_torch(self.covariances, dtype=kernels.Mat99),
        )


@dataclass(frozen=True)
class _Seen:
    """A scan, the pose it was taken from, and where the team was then."""

    pose: Float[Tensor, "b 3"]
    scan: Float[Tensor, "b k"]
    team: Float[Tensor, "b n 2"]

    def where(self, chosen: Bool[Tensor, "b"], other: _Seen) -> _Seen:
        """Return this one where chosen, the other elsewhere."""
        return _Seen(
            torch.where(chosen[:, None], self.pose, other.pose),
            torch.where(chosen[:, None], self.scan, other.scan),
            torch.where(chosen[:, None, None], self.team, other.team),
        )


class Tracker(Estimator):
    """Tracks all robots of a team for one of them.

    Args:
        robots: the team.
        agent: index of the robot that tracks.
        disturbances: of each robot: what a calibration of it would find.
        config: what it counts on.
    """

    def __init__(
        self,
        robots: Sequence[RobotSpec],
        agent: int,
        disturbances: Sequence[Disturbances],
        config: TrackerConfig | None = None,
    ) -> None:
        self.config = config or TrackerConfig()
        self.agent = agent
        self.lidar = robots[agent].lidar
        own = disturbances[agent]
        self.sensing = self.config.delay * own.sensing_delay
        self.horizon = self.config.delay * own.latency
        self.jitter = self.config.delay * (own.sensing_jitter + own.command_jitter)
        self._durations = _durations(self.horizon)
        numbers = [
            _track(robot, theirs, None if i == agent else own, self.config)
            for i, (robot, theirs) in enumerate(zip(robots, disturbances, strict=True))
        ]
        self._tracks = wp.array(numbers, dtype=kernels.Track)
        self._view = _view(robots[agent], own)
        self._drive = _drive(robots[agent])
        angles = torch.from_numpy(self.lidar.angles()).float()
        self._beams = torch.stack([angles.cos(), angles.sin()], -1)

    def reset(self, reading: Reading) -> Estimate:
        """Begin tracks of robots at rest."""
        size, count = reading.poses.shape[:2]
        self._now = _Tracks(
            torch.zeros(size, count, 9), torch.zeros(size, count, 9, 9), torch.zeros(size, count)
        )
        self._commands = torch.zeros(size, len(self._durations), 2)
        self._scan_age = torch.zeros(size)
        self._begin(reading, torch.ones(size, count, dtype=torch.bool))
        self._scan = cleaned(reading.scan, self.lidar)
        self._sent = reading.scan
        self._pose = self._own_pose()
        self._recent: list[_Seen] = [self._seen()]
        return self._estimate()

    def update(self, reading: Reading, command: Float[Tensor, "b 2"]) -> Estimate:
        """Return the team as it will be once the next command acts."""
        if len(self._durations):
            self._commands = torch.cat([self._commands[:, 1:], command[:, None]], 1)
        silent, states, covariances = self._now.arrays()
        wp.launch(
            kernels.follow,
            dim=reading.poses.shape[:2],
            inputs=[
                self.agent, CONTROL_PERIOD, self.sensing, self.config.ahead, vectors(reading.poses),
                wp.from_torch(reading.ages.contiguous()), wp.from_torch(reading.fresh.contiguous()),
                vectors(reading.velocity), self._tracks, silent, states, covariances,
            ],
        )  # fmt: skip
        pose = self._own_pose()
        self._believe_scan(reading, pose)
        self._pose = pose
        self._recent = [self._seen(), *self._recent[: RECENT - 1]]
        if self.config.sightings:
            wp.launch(
                kernels.sight,
                dim=reading.poses.shape[:2],
                inputs=[
                    self.agent, wp.from_torch(self._scan), vectors(self._beams),
                    wp.from_torch(self._scan_age == 0), self._view, self._tracks, silent, states, covariances,
                ],
            )  # fmt: skip
        return self._estimate()

    def restart(self, reading: Reading, robots: Bool[Tensor, "b n"]) -> Estimate:
        """Begin some of the tracks anew."""
        self._begin(reading, robots)
        mine = robots[:, self.agent]
        self._commands = self._commands.masked_fill(mine[:, None, None], 0.0)
        self._scan_age = self._scan_age.masked_fill(mine, 0.0)
        self._scan = torch.where(mine[:, None], cleaned(reading.scan, self.lidar), self._scan)
        self._sent = torch.where(mine[:, None], reading.scan, self._sent)
        self._pose = self._own_pose()
        now = self._seen()
        self._recent = [now.where(robots.any(1), seen) for seen in self._recent]
        return self._estimate()

    def _begin(self, reading: Reading, chosen: Bool[Tensor, "b n"]) -> None:
        silent, states, covariances = self._now.arrays()
        wp.launch(
            kernels.begin,
            dim=chosen.shape,
            inputs=[
                wp.from_torch(chosen.contiguous()), vectors(reading.poses), self._tracks, states, covariances
            ],
        )  # fmt: skip
        del silent
        self._now.silent.masked_fill_(chosen, 0.0)

    def _own_pose(self) -> Float[Tensor, "b 3"]:
        return self._now.states[:, self.agent, :3].clone()

    def _believe_scan(self, reading: Reading, pose: Float[Tensor, "b 3"]) -> None:
        """Take the new scan, or where it cannot be right the last one that could, moved along."""
        expected = self._moved(self._recent[:1], pose)
        sent, last = reading.scan, self._sent
        hit = sent < kernels.MISSED * self.lidar.max_range
        should = expected < 0.9 * self.lidar.max_range
        enough = should.sum(1) >= FEW
        blind = enough & ((should & ~hit).sum(1) > self.config.missing * should.sum(1))
        moves = (reading.velocity.abs() > STILL).any(1)
        frozen = enough & moves & ((sent == last) | ~hit).all(1) & hit.any(1)
        wrong = (blind | frozen) & (self._scan_age < self.config.patience)
        self._scan_age = torch.where(wrong, self._scan_age + CONTROL_PERIOD, 0.0)
        self._scan = torch.where(wrong[:, None], expected, cleaned(sent, self.lidar))
        self._sent = sent

    def _estimate(self) -> Estimate:
        size, count = self._now.silent.shape
        silent, states, covariances = self._now.arrays()
        poses, velocities = torch.empty(size, count, 3), torch.empty(size, count, 2)
        std = torch.empty(size, count, 3)
        wp.launch(
            kernels.forecast,
            dim=(size, count),
            inputs=[
                self.agent, self.horizon, self.config.ahead, vectors(self._commands),
                wp.array(self._durations, dtype=float), self._drive, self._tracks, silent, states,
                covariances, vectors(poses), vectors(velocities), vectors(std),
            ],
        )  # fmt: skip
        velocity, scan = velocities[:, self.agent], self._scan
        if self.horizon:
            scan = self._moved(self._recent[::EVERY], poses[:, self.agent])
        return Estimate(
            poses, velocity, scan, velocities=velocities, std=std, ages=self._now.silent.clone(),
            scan_age=self._scan_age, jitter=torch.full((size,), self.jitter),
        )  # fmt: skip

    def _seen(self) -> _Seen:
        return _Seen(self._pose, self._scan, self._now.states[..., :2].clone())

    def _moved(self, seen: Sequence[_Seen], after: Float[Tensor, "b 3"]) -> Float[Tensor, "b k"]:
        """Return what the newest scan, and earlier ones where it does not reach, show from another pose."""
        poses = torch.stack([each.pose for each in seen], 1)
        scans = torch.stack([each.scan for each in seen], 1)
        team = torch.stack([each.team for each in seen], 1)
        moved, told = torch.empty_like(self._scan), torch.empty(self._scan.shape, dtype=torch.int32)
        wp.launch(
            kernels.move_scans,
            dim=len(after),
            inputs=[
                vectors(poses), wp.from_torch(scans), vectors(team), vectors(after), self.agent,
                vectors(self._beams), self._view, self._tracks, wp.from_torch(told), wp.from_torch(moved),
            ],
        )  # fmt: skip
        return moved


def _durations(horizon: float) -> list[float]:
    """Return for how long each command that is under way acts before the next one does, oldest first."""
    whole, rest = divmod(horizon, CONTROL_PERIOD)
    begun = [rest] if rest > 1e-6 else []
    return [*begun, *[CONTROL_PERIOD] * round(whole)]


def _track(robot: RobotSpec, theirs: Disturbances, own: Disturbances | None, config: TrackerConfig) -> Any:
    """Return the numbers of a robot; of another one, its errors and the agent's own add up."""
    out = kernels.Track()
    scale = config.noise**2
    agents = [theirs] if own is None else [theirs, own]
    drift = sum(each.position_drift**2 for each in agents)
    still = sum(each.position_bias**2 for each in agents)
    turn = sum(each.heading_drift**2 + each.heading_bias**2 for each in agents)
    if own is not None:
        drift += (LEVER * own.heading_drift) ** 2
        still += (LEVER * own.heading_bias) ** 2
    out.white, out.white_turn = scale * theirs.position_std**2, scale * theirs.heading_std**2
    out.bias, out.bias_turn = scale * (drift + still), scale * turn
    # forgets as fast as the drift alone changes, whatever part of the error stays
    rate = drift / (theirs.drift_time * (drift + still)) if drift else 0.0
    out.decay = math.exp(-CONTROL_PERIOD * rate)
    out.jump = scale * sum(each.jump_size**2 for each in agents if each.jump_rate)
    out.acceleration = config.agility * robot.drive.acceleration
    out.steadiness = math.exp(-CONTROL_PERIOD / MANOEUVRE)
    out.turn_acceleration = config.agility * robot.drive.turn_acceleration
    out.top_speed, out.radius = robot.drive.speed[1], robot.profile_radius
    out.odometry = scale * (theirs.odometry_scale**2 + theirs.odometry_slip**2)
    return out


def _view(robot: RobotSpec, disturbances: Disturbances) -> Any:
    out, lidar = kernels.View(), robot.lidar
    out.mount = wp.vec3(*lidar.mount)
    out.half_view, out.step = lidar.field_of_view / 2, lidar.field_of_view / (lidar.beams - 1)
    out.beams, out.min_range, out.max_range = lidar.beams, lidar.min_range, lidar.max_range
    out.noise = lidar.noise_std if disturbances.scan_std is None else disturbances.scan_std
    return out


def _drive(robot: RobotSpec) -> Any:
    out, drive = kernels.Drive(), robot.drive
    out.speed_min, out.speed_max = drive.speed
    out.turn_rate = drive.turn_rate
    out.acceleration, out.turn_acceleration = drive.acceleration, drive.turn_acceleration
    return out


def tracker(context: EstimatorContext) -> Tracker:
    """Build the estimator."""
    config = altered(TrackerConfig(), context.settings, "estimator 'tracker'")
    return Tracker(context.robots, context.agent, context.disturbances, config)
