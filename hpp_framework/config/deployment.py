"""What a team file says of real robots: the topics of each, and the limits of its safety gate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import AfterValidator

from hpp_framework.config.yaml_files import FileModel
from hpp_framework.utils.validation import Flag, NonNegative, Number, Positive, Share, Text, mistake, numbers

Fence = tuple[Number, Number, Number, Number]


class Topics(FileModel):
    """Where a robot's data comes and goes; names without a leading slash lie below its namespace.

    Attributes:
        namespace: of the robot; without it, ``/`` and its id.
        scan: LaserScan.
        odom: Odometry.
        pose: PoseWithCovarianceStamped in the map's frame; the only topic that teammates read.
        cmd_vel: Twist, or TwistStamped.
        stamped: whether commands are TwistStamped.
        scan_yaw: angle in radians from the lidar of the robot's description to the frame of its scans.
        scan_flipped: whether the lidar is mounted upside down.
    """

    namespace: Text | None = None
    scan: Text = "scan"
    odom: Text = "odom"
    pose: Text = "amcl_pose"
    cmd_vel: Text = "cmd_vel"
    stamped: Flag = False
    scan_yaw: Number = 0.0
    scan_flipped: Flag = False

    def full(self, name: str, robot: str) -> str:
        """Return the absolute name of a topic of a robot.

        Args:
            name: with a leading slash or without.
            robot: its id.
        """
        if name.startswith("/"):
            return name
        return f"/{(self.namespace or robot).strip('/')}/{name}"


def _ordered(fence: Fence | None) -> Fence | None:
    if fence is not None and not (fence[0] < fence[2] and fence[1] < fence[3]):
        raise mistake(f"encloses nothing: {list(fence)}", "Write [x_min, y_min, x_max, y_max] in metres.")
    return fence


class GateLimits(FileModel):
    """Limits of a robot's safety gate.

    Attributes:
        stale: seconds without a new scan, own pose or odometry before the robot brakes; two control periods.
        late: seconds by which stamps may differ from the robot's clock.
        silence: seconds without a pose of a teammate before the robot brakes.
        jump: metres by which the own pose may differ from what odometry says between two control steps.
        turn_jump: the same of the heading, radians.
        settle: seconds at rest without a fault of its senses before the robot drives again.
        unseen: share of the beams that may send no range.
        geofence: x_min, y_min, x_max, y_max in metres that the robot must not leave.
        protect: whether the robot slows down so that it can stop before what its lidar sees on its arc.
        margin: metres that it keeps from what it sees; other robots may be wider below their lidar's plane.
        shape: whether commands speed up no faster than the drive can.
    """

    stale: Positive = 0.4
    late: Positive = 1.0
    silence: Positive = 1.0
    jump: Positive = 0.5
    turn_jump: Positive = 0.5
    settle: NonNegative = 1.0
    unseen: Share = 0.5
    geofence: Annotated[
        Fence | None, numbers("x_min", "y_min", "x_max", "y_max"), AfterValidator(_ordered)
    ] = None
    protect: Flag = True
    margin: NonNegative = 0.08
    shape: Flag = True


def topics_of(members: Mapping[str, Any], robot: str) -> Topics:
    """Return the topics of a robot.

    Args:
        members: an effective team; empty for a team without a file.
        robot: its id.
    """
    return Topics(**_entry(members, robot).get("topics", {}))


def gate_of(members: Mapping[str, Any], robot: str) -> GateLimits:
    """Return the gate of a robot; see :func:`topics_of`."""
    return GateLimits(**_entry(members, robot).get("gate", {}))


def _entry(members: Mapping[str, Any], robot: str) -> Mapping[str, Any]:
    return next((entry for entry in members.get("members", ()) if entry["id"] == robot), {})
