"""Backend ``ros2``: topics by rclpy. The one module that imports ROS 2.

Everything runs in the thread of the control loop: messages are taken in while the loop waits.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import rclpy  # pyright: ignore[reportMissingImports]  # comes with ROS 2 or by the extra "ros"
from geometry_msgs.msg import (  # pyright: ignore[reportMissingImports]  # as above
    Point,
    PoseWithCovarianceStamped,
    Twist,
    TwistStamped,
)
from nav_msgs.msg import Odometry  # pyright: ignore[reportMissingImports]  # as above
from rclpy.executors import SingleThreadedExecutor  # pyright: ignore[reportMissingImports]  # as above
from rclpy.qos import (  # pyright: ignore[reportMissingImports]  # as above
    DurabilityPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from sensor_msgs.msg import LaserScan  # pyright: ignore[reportMissingImports]  # as above
from std_msgs.msg import Bool, UInt64  # pyright: ignore[reportMissingImports]  # as above
from visualization_msgs.msg import Marker, MarkerArray  # pyright: ignore[reportMissingImports]  # as above

from hpp_framework.deploy.port import (
    Command,
    Fix,
    Inbox,
    Motion,
    RobotPort,
    Scan,
    TeamPort,
    Traffic,
    View,
)
from hpp_framework.deploy.topics import EPISODE, TopicNames

NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Fits every publisher; old data are worth nothing."""
RELIABLE = QoSProfile(depth=10)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
MAP = "map"


@dataclass
class _Heard:
    """The newest message of a topic."""

    topic: str
    type: Any
    count: int = 0
    message: Any = None
    arrived: float = math.nan
    clock: float = math.nan


class _Node:
    """A node and its executor, in the caller's thread."""

    def __init__(self, name: str) -> None:
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self.node = rclpy.create_node(name, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def clock(self) -> float:
        return self.node.get_clock().now().nanoseconds * 1e-9

    def spin(self, until: float, ended: Callable[[], bool] = lambda: False) -> None:
        """Take messages in until a monotonic time, at least those that are there."""
        while not ended():
            left = until - time.monotonic()
            self._executor.spin_once(timeout_sec=max(left, 0.0))
            if left <= 0:
                return

    def close(self) -> None:
        if self._context.ok():
            self._executor.shutdown()
            self.node.destroy_node()
            rclpy.shutdown(context=self._context)


class Ros2Port(RobotPort):
    """One robot, by its topics.

    Args:
        robot: its id.
        names: of its topics.
        rehearsed: whether the world of a rehearsal may begin episodes.
    """

    def __init__(self, robot: str, names: TopicNames, *, rehearsed: bool = False) -> None:
        self.robot, self.names = robot, names
        self._ros = _Node("hpp_" + "".join(c if c.isalnum() else "_" for c in robot))
        node = self._ros.node
        types = {names.scan: LaserScan, names.odom: Odometry}
        types |= dict.fromkeys(names.poses.values(), PoseWithCovarianceStamped)
        self._heard = {topic: _Heard(topic, type_) for topic, type_ in types.items()}
        for topic, heard in self._heard.items():
            node.create_subscription(heard.type, topic, partial(self._take, heard), NEWEST)
        self._stops = dict.fromkeys(names.stops, False)
        for topic in names.stops:
            # twice: latched ones that were sent before, and those of publishers that latch nothing
            for profile in (LATCHED, NEWEST):
                node.create_subscription(Bool, topic, partial(self._stop, topic), profile)
        if rehearsed:
            node.create_subscription(UInt64, EPISODE, self._begin, LATCHED)
        self._command = node.create_publisher(
            TwistStamped if names.stamped else Twist, names.cmd_vel, RELIABLE
        )
        self._plan = node.create_publisher(MarkerArray, names.plan, RELIABLE)

    def latest(self) -> Inbox:
        """Return the newest of everything."""
        scan, motion = self._heard[self.names.scan], self._heard[self.names.odom]
        poses = {name: self._heard[topic] for name, topic in self.names.poses.items()}
        return Inbox(
            now=time.monotonic(), clock=self._ros.clock(),
            scan=None if scan.message is None else _scan(scan),
            motion=None if motion.message is None else _motion(motion),
            fixes={name: _fix(heard) for name, heard in poses.items() if heard.message is not None},
            stopped=any(self._stops.values()),
        )  # fmt: skip

    def send(self, command: Command) -> None:
        """Send a command to the wheels."""
        message = TwistStamped() if self.names.stamped else Twist()
        twist = message.twist if self.names.stamped else message
        twist.linear.x, twist.angular.z = command
        if self.names.stamped:
            message.header.stamp = self._ros.node.get_clock().now().to_msg()
            message.header.frame_id = "base_link"
        self._command.publish(message)

    def show(self, view: View) -> None:
        """Publish goal, waypoint, belief and predicted paths as markers."""
        stamp = self._ros.node.get_clock().now().to_msg()
        self._plan.publish(MarkerArray(markers=_markers(view, stamp)))

    def wait(self, until: float, *, for_scan: bool = False) -> None:
        """Let messages come until a monotonic time."""
        scan = self._heard[self.names.scan]
        count = scan.count
        self._ros.spin(until, lambda: for_scan and scan.count > count)

    def traffic(self) -> list[Traffic]:
        """Return what has come on each topic so far."""
        known = self._ros.node.get_topic_names_and_types()
        found: list[Traffic] = []
        for heard in self._heard.values():
            package, _, name = heard.type.__module__.partition(".")[0], None, heard.type.__name__
            same = tuple(topic for topic, types in known if f"{package}/msg/{name}" in types)
            found.append(
                Traffic(
                    topic=heard.topic, type=name, count=heard.count,
                    age=heard.clock - _seconds(heard.message.header.stamp) if heard.count else math.nan,
                    frame=heard.message.header.frame_id if heard.count else "",
                    others=() if heard.count else tuple(each for each in same if each not in self._heard),
                )
            )  # fmt: skip
        return found

    def close(self) -> None:
        """Leave the network."""
        self._ros.close()

    def _take(self, heard: _Heard, message: Any) -> None:
        heard.message, heard.count = message, heard.count + 1
        heard.arrived, heard.clock = time.monotonic(), self._ros.clock()

    def _stop(self, topic: str, message: Any) -> None:
        self._stops[topic] = bool(message.data)

    def _begin(self, message: Any) -> None:
        self.episode = int(message.data)
        for heard in self._heard.values():
            heard.message = None


class Ros2TeamPort(TeamPort):
    """All robots of a simulated team, by their topics.

    Args:
        names: of the topics of each robot.
        robots: their ids.
    """

    def __init__(self, names: Sequence[TopicNames], robots: Sequence[str]) -> None:
        self.robots = tuple(robots)
        self.goals = [(math.nan, math.nan)] * len(robots)
        self._ros = _Node("hpp_world")
        node = self._ros.node
        self._came: list[tuple[int, Command]] = []
        self._publishers: list[tuple[Any, Any, Any]] = []
        for index, (each, robot) in enumerate(zip(names, robots, strict=True)):
            self._publishers.append(
                (
                    node.create_publisher(LaserScan, each.scan, NEWEST),
                    node.create_publisher(Odometry, each.odom, RELIABLE),
                    node.create_publisher(PoseWithCovarianceStamped, each.poses[robot], RELIABLE),
                )
            )
            kind = TwistStamped if each.stamped else Twist
            node.create_subscription(kind, each.cmd_vel, partial(self._take, index), RELIABLE)
            node.create_subscription(MarkerArray, each.plan, partial(self._look, index), RELIABLE)
        self._episode = node.create_publisher(UInt64, EPISODE, LATCHED)

    def publish(self, robot: int, scan: Scan, motion: Motion, fix: Fix) -> None:
        """Send what one robot's sensors say."""
        name = self.robots[robot]
        ranges, odometry, pose = LaserScan(), Odometry(), PoseWithCovarianceStamped()
        ranges.header.stamp, ranges.header.frame_id = _stamp(scan.stamp), f"{name}/laser"
        ranges.angle_min, ranges.angle_increment = scan.angle_min, scan.angle_increment
        ranges.angle_max = scan.angle_min + scan.angle_increment * (len(scan.ranges) - 1)
        ranges.range_min, ranges.range_max = scan.range_min, scan.range_max
        ranges.ranges = scan.ranges.tolist()
        odometry.header.stamp, odometry.header.frame_id = _stamp(motion.stamp), f"{name}/odom"
        odometry.child_frame_id = f"{name}/base_link"
        odometry.twist.twist.linear.x, odometry.twist.twist.angular.z = motion.velocity
        pose.header.stamp, pose.header.frame_id = _stamp(fix.stamp), MAP
        _place(pose.pose.pose, *fix.pose)
        for publisher, message in zip(self._publishers[robot], (ranges, odometry, pose), strict=True):
            publisher.publish(message)

    def times(self) -> tuple[float, float]:
        """Return monotonic and ROS time."""
        return time.monotonic(), self._ros.clock()

    def wait(self, until: float) -> list[tuple[int, Command]]:
        """Return the commands, by robot, that come until a monotonic time."""
        self._ros.spin(until)
        came, self._came = self._came, []
        return came

    def begin(self, seed: int) -> None:
        """Tell all agents that a new episode begins, and let them take it in."""
        self._episode.publish(UInt64(data=seed))
        self.wait(time.monotonic() + 0.5)

    def close(self) -> None:
        """Leave the network."""
        self._ros.close()

    def _take(self, robot: int, message: Any) -> None:
        twist = getattr(message, "twist", message)
        self._came.append((robot, (twist.linear.x, twist.angular.z)))

    def _look(self, robot: int, message: Any) -> None:
        for marker in message.markers:
            if marker.ns == "goal":
                self.goals[robot] = (marker.pose.position.x, marker.pose.position.y)


def _seconds(stamp: Any) -> float:
    return stamp.sec + stamp.nanosec * 1e-9


def _stamp(seconds: float) -> Any:
    return rclpy.time.Time(nanoseconds=round(seconds * 1e9)).to_msg()


def _place(pose: Any, x: float, y: float, heading: float = 0.0) -> None:
    pose.position.x, pose.position.y = x, y
    pose.orientation.z, pose.orientation.w = math.sin(heading / 2), math.cos(heading / 2)


def _scan(heard: _Heard) -> Scan:
    message = heard.message
    return Scan(
        stamp=_seconds(message.header.stamp), arrived=heard.arrived,
        ranges=np.asarray(message.ranges, np.float32), angle_min=message.angle_min,
        angle_increment=message.angle_increment, range_min=message.range_min, range_max=message.range_max,
    )  # fmt: skip


def _motion(heard: _Heard) -> Motion:
    twist = heard.message.twist.twist
    return Motion(
        stamp=_seconds(heard.message.header.stamp), arrived=heard.arrived,
        velocity=(twist.linear.x, twist.angular.z),
    )  # fmt: skip


def _fix(heard: _Heard) -> Fix:
    pose, q = heard.message.pose.pose, heard.message.pose.pose.orientation
    heading = math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))
    return Fix(
        stamp=_seconds(heard.message.header.stamp), arrived=heard.arrived,
        pose=(pose.position.x, pose.position.y, heading),
    )  # fmt: skip


def _markers(view: View, stamp: Any) -> list[Any]:
    """Return markers: goal, waypoint, belief (one standard deviation), a path for each robot."""

    def marker(space: str, index: int, kind: int, color: tuple[float, float, float, float]) -> Any:
        found = Marker(ns=space, id=index, type=kind, action=Marker.ADD)
        found.header.frame_id, found.header.stamp = MAP, stamp
        found.color.r, found.color.g, found.color.b, found.color.a = color
        found.pose.orientation.w = 1.0
        return found

    def disc(space: str, at: tuple[float, float], size: Sequence[float], color: Any) -> Any:
        found = marker(space, 0, Marker.CYLINDER, color)
        _place(found.pose, *at)
        found.scale.x, found.scale.y, found.scale.z = max(size[0], 0.02), max(size[1], 0.02), 0.02
        return found

    braking = (0.9, 0.1, 0.1, 1.0) if view.reasons else (0.1, 0.7, 0.2, 1.0)
    found = [disc("goal", view.goal, (0.3, 0.3), braking)]
    found.append(disc("waypoint", view.waypoint, (0.2, 0.2), (0.2, 0.4, 0.9, 1.0)))
    if view.mean is not None and view.std is not None:
        found.append(disc("belief", view.mean, [2 * each for each in view.std], (0.9, 0.8, 0.2, 0.4)))
    for index, path in enumerate(view.paths if view.paths is not None else ()):
        line = marker("path", index, Marker.LINE_STRIP, (0.2, 0.6, 0.9, 0.9))
        line.scale.x = 0.04
        line.points = [Point(x=float(x), y=float(y)) for x, y in path]
        found.append(line)
    return found
