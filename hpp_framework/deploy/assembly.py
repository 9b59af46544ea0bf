"""From messages to what an agent observes: resampled, estimated and remembered as in simulation."""

from __future__ import annotations

import math

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from hpp_framework.config.deployment import Topics
from hpp_framework.core.estimator import Estimator, Reading
from hpp_framework.core.robot import Lidar
from hpp_framework.core.team import Team
from hpp_framework.core.types import Observation
from hpp_framework.deploy.port import Command, Fix, Inbox, Message, Motion, Scan
from hpp_framework.perception.sensing import HISTORY, KEYFRAMES, ObservationMemory
from hpp_framework.utils.errors import ConfigError

MARGIN = 2
"""Beams of the robot's description at either end that a lidar need not have; estimators fill them."""


def usable_ranges(scan: Scan, lidar: Lidar) -> Float[np.ndarray, "k"]:
    """Return a scan's ranges: no hit reads the robot's maximum, too close its minimum, no range NaN."""
    ranges = np.asarray(scan.ranges, np.float32)
    none = np.isnan(ranges) | (ranges < scan.range_min) | (ranges > scan.range_max)
    found = np.where(none, np.float32(np.nan), ranges.clip(lidar.min_range, lidar.max_range))
    found = np.where(np.isposinf(ranges), np.float32(lidar.max_range), found)
    return np.where(np.isneginf(ranges), np.float32(lidar.min_range), found).astype(np.float32)


class Resampler:
    """Turns scans of any lidar into the beams that a robot's description has.

    Each message beam counts for the nearest beam of the description. Of several the nearest range counts, so
    that nothing thin is lost; a beam with none takes the message beam next to it.

    Args:
        lidar: of the robot's description.
        yaw: from the description's lidar to the frame of the scans, radians.
        flipped: whether the lidar is upside down.
        robot: its id, for messages.
    """

    def __init__(self, lidar: Lidar, yaw: float = 0.0, flipped: bool = False, robot: str = "") -> None:
        self.lidar, self.yaw, self.flipped, self.robot = lidar, yaw, flipped, robot
        self._layout: tuple[int, float, float] | None = None

    def __call__(self, scan: Scan) -> Float[np.ndarray, "k"]:
        """Return ranges of the description's beams, metres; NaN where there is no range.

        Raises:
            ConfigError: if the lidar does not see all that the description does.
        """
        layout = (len(scan.ranges), scan.angle_min, scan.angle_increment)
        if layout != self._layout:
            self._target, self._source = self._match(scan)
            self._layout = layout
        ranges = usable_ranges(scan, self.lidar)
        found = np.full(self.lidar.beams, np.inf, np.float32)
        np.minimum.at(found, self._target, np.where(np.isnan(ranges), np.inf, ranges)[self._source])
        return np.where(np.isinf(found), np.float32(np.nan), found)

    def _match(self, scan: Scan) -> tuple[Int[np.ndarray, "m"], Int[np.ndarray, "m"]]:
        """Return pairs of beams of the description and of the message."""
        wanted = self.lidar.angles()
        angles = scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
        angles = (-angles if self.flipped else angles) + self.yaw
        apart = np.abs(_wrapped(wanted[:, None] - angles))
        step = self.lidar.field_of_view / (self.lidar.beams - 1)
        reach = max(step, abs(scan.angle_increment))
        self._check(apart.min(1) <= reach)
        nearest = apart.argmin(0)
        counts = apart[nearest, np.arange(len(angles))] <= step / 2 + 1e-6
        target, source = nearest[counts], np.flatnonzero(counts)
        empty = np.setdiff1d(np.flatnonzero(apart.min(1) <= reach), target)
        return np.concatenate([target, empty]), np.concatenate([source, apart[empty].argmin(1)])

    def _check(self, seen: Bool[np.ndarray, "k"]) -> None:
        if not bool(seen[MARGIN:-MARGIN].all()):
            half = math.degrees(self.lidar.field_of_view / 2)
            raise ConfigError(
                f"the lidar of '{self.robot}' covers {seen.mean():.0%} of the {-half:.0f} to {half:.0f} "
                "degrees of its description. Set topics.scan_yaw or topics.scan_flipped in the team file, "
                "or describe the robot as it is: hpp new robot."
            )


def _wrapped(angle: Float[np.ndarray, "*s"]) -> Float[np.ndarray, "*s"]:
    return (angle + np.pi) % (2 * np.pi) - np.pi


class Assembly:
    """Makes one agent's observations of what comes to its robot.

    Args:
        team: all robots.
        me: index of the agent.
        estimator: of the agent.
        topics: of the robot, for how its lidar is mounted.
    """

    def __init__(self, team: Team, me: int, estimator: Estimator, topics: Topics) -> None:
        self.team, self.me, self.estimator = team, me, estimator
        robot = team.robots[me]
        self._resampled = Resampler(robot.lidar, topics.scan_yaw, topics.scan_flipped, team.ids[me])
        self._memory = ObservationMemory(me, HISTORY, KEYFRAMES)
        self._stamps: dict[str, float] = {}

    def missing(self, inbox: Inbox) -> list[str]:
        """Return what has not come yet, in words."""
        own = [("scan", inbox.scan), ("odometry", inbox.motion)]
        absent = [f"no {name}" for name, message in own if message is None]
        return absent + [f"no pose of {name}" for name in self.team.ids if name not in inbox.fixes]

    def reading(self, inbox: Inbox) -> Reading | None:
        """Return what reaches the agent now; None while something has never come.

        Raises:
            ConfigError: if the lidar does not see what the robot's description says.
        """
        if inbox.scan is None or inbox.motion is None or self.missing(inbox):
            return None
        fixes = [inbox.fixes[name] for name in self.team.ids]
        fresh = [self._is_new(name, fix) for name, fix in zip(self.team.ids, fixes, strict=True)]
        return Reading(
            self.me,
            torch.tensor([[fix.pose for fix in fixes]], dtype=torch.float32),
            torch.tensor([[age(fix, inbox) for fix in fixes]], dtype=torch.float32),
            torch.tensor([fresh]),
            torch.tensor([inbox.motion.velocity], dtype=torch.float32),
            torch.from_numpy(self._resampled(inbox.scan))[None],
        )

    def empty_room(self) -> Inbox:
        """Return what would come if all robots stood in an endless empty room, 3 m apart."""
        lidar = self.team.robots[self.me].lidar
        scan = Scan(
            stamp=0.0, arrived=0.0, ranges=np.full(721, np.inf, np.float32),
            angle_min=-math.pi, angle_increment=math.pi / 360,
            range_min=lidar.min_range, range_max=lidar.max_range,
        )  # fmt: skip
        poses = {name: (3.0 * place, 0.0, 0.0) for place, name in enumerate(self.team.ids)}
        fixes = {name: Fix(stamp=0.0, arrived=0.0, pose=pose) for name, pose in poses.items()}
        motion = Motion(stamp=0.0, arrived=0.0, velocity=(0.0, 0.0))
        return Inbox(now=0.0, clock=0.0, scan=scan, motion=motion, fixes=fixes)

    def begin(self, reading: Reading) -> None:
        """Begin anew: the robot is at rest and nothing is remembered."""
        self._memory.reset(self.estimator.reset(reading))

    def update(self, reading: Reading, command: Command) -> None:
        """Go on by one control step.

        Args:
            reading: that came.
            command: sent since the reading before.
        """
        self._memory.append(self.estimator.update(reading, torch.tensor([command], dtype=torch.float32)))

    def observation(self) -> Observation:
        """Return what the agent knows."""
        return self._memory.observation()

    def _is_new(self, name: str, fix: Fix) -> bool:
        """Return whether a pose came since the reading before, by its stamp: clocks of others may differ."""
        new = self._stamps.get(name) != fix.stamp
        self._stamps[name] = fix.stamp
        return new


def age(message: Message, inbox: Inbox) -> float:
    """Return seconds since a message was measured, by its stamp."""
    return inbox.clock - message.stamp
