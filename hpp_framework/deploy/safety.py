"""The safety gate between an agent and its wheels, and the watchdog beside the wheels.

The gate trusts nothing that it is told: it looks at when messages came and whether they fit together, brakes
while something is wrong, and lets no command through that the drive cannot follow.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from hpp_framework.config.deployment import GateLimits
from hpp_framework.core.robot import DriveLimits, RobotSpec
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.deploy.port import HALT, Command, Fix, Inbox, Motion, Scan

WATCHDOG = 0.4
"""Seconds without a command after which the wheels stop: two control periods."""
STILL = 0.05
"""m/s and rad/s below which a robot stands."""
STRIDE = 0.05
"""Metres between the places on an arc at which it is looked for obstacles."""
STEPPED = 0.1
"""Seconds by which the clock may run faster or slower than time passes between two control steps."""
GAP = 1.0
"""Seconds between two poses from which on they tell nothing about jumps."""
SLACK = 1e-6

REASONS = {
    "stopped": "an emergency stop is pressed. Release it.",
    "late": "control steps came late. Give the process a core of its own.",
    "scan": "no new scan. Check the lidar's driver and its topic.",
    "odometry": "no new odometry. Check the base's driver and its topic.",
    "pose": "no new own pose. Check localisation and its topic.",
    "stamps": "stamps differ from the robot's clock. Check that all machines share their time (chrony).",
    "clock": "the robot's clock was stepped. Let the time server slew it instead.",
    "blind": "too few beams of the lidar send a range. Clean or check it.",
    "frozen": "the scan does not change while the robot moves. Start the lidar's driver anew.",
    "jump": "the own pose jumped. Check localisation.",
    "fence": "the robot would leave its geofence. Drive it back by hand.",
    "silence": "a teammate's pose does not come. Check the network.",
    "command": "the agent's command was not finite.",
}
"""Why the gate brakes, and what to do."""
SENSES = frozenset({"late", "scan", "odometry", "pose", "stamps", "clock", "blind", "frozen", "jump"})
"""Reasons that hold until the senses have been well for a while."""
LOST = SENSES - {"blind", "frozen"}
"""Reasons after which what was estimated and remembered is not to be trusted."""


class Gate:
    """Decides whether one robot may drive, and limits how.

    Args:
        robot: its data.
        me: its id.
        team: ids of all robots.
        config: its limits.
        reaction: seconds from what the lidar sees to when a command that heeds it acts.

    Attributes:
        counts: control steps braked by reason, commands limited by the drive (``"limited"``) and slowed down
            before what the lidar sees (``"slowed"``).
    """

    def __init__(
        self, robot: RobotSpec, me: str, team: Sequence[str], config: GateLimits, reaction: float = 0.0
    ) -> None:
        self.robot, self.drive, self.me, self.team = robot, robot.drive, me, tuple(team)
        self.config, self.reaction = config, reaction + CONTROL_PERIOD
        self.counts: Counter[str] = Counter()
        self.reset()

    def reset(self) -> None:
        """Forget what came before, but not the counts."""
        self._before: Inbox | None = None
        self._until: dict[str, float] = {}
        self._frozen = False
        self._wheels: Command = HALT

    def judge(self, inbox: Inbox) -> tuple[str, ...]:
        """Return why the robot must brake now, keys of ``REASONS``; call once a control step."""
        found = set(self._missing(inbox))
        before, self._before = self._before, inbox
        if before is not None:
            found |= set(self._changed(before, inbox))
        if self._outside(inbox):
            found.add("fence")
        if inbox.stopped:
            found.add("stopped")
        held = {each for each, until in self._until.items() if inbox.now < until - SLACK}
        moves = inbox.motion is not None and max(map(abs, inbox.motion.velocity)) > STILL
        for each in found & SENSES | (held if moves else set()):
            self._until[each] = inbox.now + self.config.settle
        return tuple(sorted(found | held))

    def passed(
        self, command: Command, reasons: Sequence[str], ranges: Float[np.ndarray, "k"] | None = None
    ) -> Command:
        """Return what may be sent of a command: all of it, what the drive can follow of it, or a halt.

        Args:
            command: of the agent.
            reasons: to brake.
            ranges: of the lidar, metres; None looks at nothing.
        """
        if not all(map(math.isfinite, command)):
            reasons = [*reasons, "command"]
        self.counts.update(reasons)
        wanted = HALT if reasons else limited(command, self.drive)
        self.counts["limited"] += bool(not reasons and wanted != command)
        if self.config.protect and ranges is not None:
            slower = self._stoppable(wanted, ranges)
            self.counts["slowed"] += slower < abs(wanted[0]) - SLACK
            wanted = (math.copysign(min(abs(wanted[0]), slower), wanted[0]), wanted[1])
        return self._shaped(wanted) if self.config.shape else wanted

    def _shaped(self, command: Command) -> Command:
        """Return a command that speeds up no faster than the drive; a halt is never softened."""
        gains = (self.drive.acceleration * CONTROL_PERIOD, self.drive.turn_acceleration * CONTROL_PERIOD)
        sent, follow = list[float](), list[float]()
        for wanted, wheel, gain in zip(command, self._wheels, gains, strict=True):
            sent.append(max(min(wheel, 0.0) - gain, min(max(wheel, 0.0) + gain, wanted)))
            follow.append(wheel + max(-gain, min(gain, sent[-1] - wheel)))
        self._wheels = (follow[0], follow[1])
        return sent[0], sent[1]

    def _stoppable(self, command: Command, ranges: Float[np.ndarray, "k"]) -> float:
        """Return the highest speed from which the robot still stops before what its lidar sees on its arc."""
        speed, slowing = abs(command[0]), self.drive.acceleration
        if speed < SLACK:
            return speed
        lidar, radius = self.robot.lidar, self.robot.footprint_radius + self.config.margin
        bearings = lidar.angles() + lidar.mount[2]
        hit = ranges < 0.999 * lidar.max_range  # NaN is none
        points = np.stack([np.cos(bearings), np.sin(bearings)], -1)[hit] * ranges[hit, None]
        points += np.array(lidar.mount[:2])
        reach = speed * self.reaction + speed**2 / (2 * slowing)
        along = np.arange(0.0, reach + STRIDE, STRIDE)
        sign = math.copysign(1.0, command[0])
        turned = along * command[1] / speed
        middles = np.cumsum(STRIDE * np.stack([sign * np.cos(turned), sign * np.sin(turned)], -1), 0)
        middles = np.concatenate([np.zeros((1, 2)), middles[:-1]])
        near = np.linalg.norm(points - middles[:, None], axis=-1) < radius
        # what is beside or behind a robot does not keep it from leaving
        near[0] &= points[:, 0] * sign > 0
        near[1:] &= ~(np.linalg.norm(points, axis=-1) < radius)
        blocked = near.any(1)
        if not blocked.any():
            return speed
        free = along[max(int(blocked.argmax()) - 1, 0)]
        lag = slowing * self.reaction
        return math.sqrt(lag**2 + 2 * slowing * free) - lag

    def _missing(self, inbox: Inbox) -> list[str]:
        config = self.config
        own = {"scan": inbox.scan, "odometry": inbox.motion, "pose": inbox.fixes.get(self.me)}
        found = [
            name
            for name, each in own.items()
            if each is None or inbox.now - each.arrived > config.stale + SLACK
        ]
        if any(each is not None and abs(inbox.clock - each.stamp) > config.late for each in own.values()):
            found.append("stamps")
        others = [inbox.fixes.get(name) for name in self.team if name != self.me]
        if any(each is None or inbox.now - each.arrived > config.silence + SLACK for each in others):
            found.append("silence")
        if inbox.scan is not None and np.isnan(inbox.scan.ranges).mean() > config.unseen:
            found.append("blind")
        return found

    def _changed(self, before: Inbox, inbox: Inbox) -> list[str]:
        passed = inbox.now - before.now
        found: list[str] = []
        if passed > 2 * CONTROL_PERIOD + SLACK:
            found.append("late")
        if abs(inbox.clock - before.clock - passed) > STEPPED:
            found.append("clock")
        if self._is_frozen(before.scan, inbox.scan, inbox.motion):
            found.append("frozen")
        if self._jumped(before.fixes.get(self.me), inbox.fixes.get(self.me), inbox.motion):
            found.append("jump")
        return found

    def _is_frozen(self, before: Scan | None, scan: Scan | None, motion: Motion | None) -> bool:
        """Return whether the lidar repeats itself though the robot moves; so it is until a scan differs."""
        if before is None or scan is None or before.stamp == scan.stamp:
            return self._frozen
        same = np.array_equal(before.ranges, scan.ranges, equal_nan=True) and np.isfinite(scan.ranges).any()
        moves = motion is not None and max(map(abs, motion.velocity)) > STILL
        self._frozen = bool(same and (moves or self._frozen))
        return self._frozen

    def _jumped(self, before: Fix | None, fix: Fix | None, motion: Motion | None) -> bool:
        """Return whether two poses lie farther apart than the robot can have driven."""
        if before is None or fix is None or motion is None or before.stamp == fix.stamp:
            return False
        passed = max(abs(fix.stamp - before.stamp), CONTROL_PERIOD)
        if passed > GAP:
            return False
        speed, turn = map(abs, motion.velocity)
        distance = math.dist(before.pose[:2], fix.pose[:2])
        turned = abs(math.remainder(fix.pose[2] - before.pose[2], 2 * math.pi))
        return distance > self.config.jump + speed * passed or turned > self.config.turn_jump + turn * passed

    def _outside(self, inbox: Inbox) -> bool:
        """Return whether the robot would come to rest outside its fence if it braked after this step."""
        fence, fix, motion = self.config.geofence, inbox.fixes.get(self.me), inbox.motion
        if fence is None or fix is None or motion is None:
            return False
        speed = motion.velocity[0]
        ahead = speed * CONTROL_PERIOD + speed * abs(speed) / (2 * self.drive.acceleration)
        x = fix.pose[0] + ahead * math.cos(fix.pose[2])
        y = fix.pose[1] + ahead * math.sin(fix.pose[2])
        return not (fence[0] <= x <= fence[2] and fence[1] <= y <= fence[3])


def limited(command: Command, drive: DriveLimits) -> Command:
    """Return a command within a drive's speeds."""
    speed, turn = command
    low, high = drive.speed
    return max(low, min(high, speed)), max(-drive.turn_rate, min(drive.turn_rate, turn))


class Watchdog:
    """Beside the wheels: keeps the last command for half a second, then halts.

    Args:
        drive: whose limits hold here too.
    """

    def __init__(self, drive: DriveLimits) -> None:
        self.drive = drive
        self._command, self._heard = HALT, -math.inf

    @property
    def heard(self) -> float:
        """When a command came last."""
        return self._heard

    def take(self, command: Command, now: float) -> None:
        """Keep a command; one that is not finite is no command.

        Args:
            command: that came.
            now: seconds.
        """
        if all(map(math.isfinite, command)):
            self._command, self._heard = limited(command, self.drive), now

    def command(self, now: float) -> Command:
        """Return what the wheels are to do now."""
        return self._command if now - self._heard < WATCHDOG - SLACK else HALT
