"""The safety gate between an agent and its wheels, and the watchdog beside the wheels.

The gate trusts nothing that it is told: it looks at when messages came and whether they fit together, brakes
while something is wrong, and lets no command through that the drive cannot follow.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np

from hpp_framework.config.deployment import GateConfig
from hpp_framework.core.robot import DriveLimits
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.deploy.port import HALT, Command, Fix, Inbox, Motion, Scan

WATCHDOG = 0.5
"""Seconds without a command after which the wheels stop."""
STILL = 0.05
"""m/s and rad/s below which a robot stands."""
STEPPED = 0.1
"""Seconds by which the clock may run faster or slower than time passes between two control steps."""
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
OWN = frozenset({"late", "scan", "odometry", "pose", "stamps", "clock", "blind", "frozen", "jump"})
"""Reasons after which what was estimated and remembered is not to be trusted."""


class Gate:
    """Decides whether one robot may drive, and limits how.

    Args:
        drive: of the robot.
        me: its id.
        team: ids of all robots.
        config: its limits.

    Attributes:
        counts: control steps braked by reason, and commands limited (``"limited"``).
    """

    def __init__(self, drive: DriveLimits, me: str, team: Sequence[str], config: GateConfig) -> None:
        self.drive, self.me, self.team, self.config = drive, me, tuple(team), config
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
        for each in found & OWN:
            self._until[each] = inbox.now + self.config.settle
        held = {each for each, until in self._until.items() if inbox.now < until - SLACK}
        return tuple(sorted(found | held))

    def passed(self, command: Command, reasons: Sequence[str]) -> Command:
        """Return what may be sent of a command: all of it, what the drive can follow of it, or a halt."""
        if not all(map(math.isfinite, command)):
            reasons = [*reasons, "command"]
        self.counts.update(reasons)
        wanted = HALT if reasons else limited(command, self.drive)
        self.counts["limited"] += bool(not reasons and wanted != command)
        if self.config.shape:
            gains = (self.drive.acceleration * CONTROL_PERIOD, self.drive.turn_acceleration * CONTROL_PERIOD)
            pairs = list(zip(wanted, self._wheels, gains, strict=True))
            # a halt is never softened: the wheels know best how to brake
            wanted = tuple(np.clip(to, min(at, 0) - gain, max(at, 0) + gain).item() for to, at, gain in pairs)
            follow = [at + np.clip(to - at, -gain, gain).item() for to, (_, at, gain) in zip(wanted, pairs)]
            self._wheels = (follow[0], follow[1])
        return wanted[0], wanted[1]

    def _missing(self, inbox: Inbox) -> list[str]:
        config = self.config
        own = {"scan": inbox.scan, "odometry": inbox.motion, "pose": inbox.fixes.get(self.me)}
        found = [
            name for name, each in own.items() if each is None or inbox.now - each.arrived > config.stale + SLACK
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
        speed, turn = map(abs, motion.velocity)
        distance = math.dist(before.pose[:2], fix.pose[:2])
        turned = abs(math.remainder(fix.pose[2] - before.pose[2], 2 * math.pi))
        passed = min(passed, 1.0)
        return (
            distance > self.config.jump + speed * passed or turned > self.config.turn_jump + turn * passed
        )

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
