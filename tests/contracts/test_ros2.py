"""The ROS 2 backend over real topics on this machine; skipped where ROS 2 is missing."""

from __future__ import annotations

import os
import time

import numpy as np
import pytest

pytestmark = pytest.mark.ros
pytest.importorskip("rclpy", reason="needs ROS 2: pip install 'hpp-framework[ros]'")

from hpp_framework.deploy.backends import open_port, open_team_port  # noqa: E402  # after the skip
from hpp_framework.deploy.port import Fix, Motion, Scan, View  # noqa: E402  # after the skip
from hpp_framework.plugins.build import parse_team  # noqa: E402  # after the skip

TEAM = parse_team("fetch,freight", skill="p2p")
MEMBERS = {"members": [{"id": "fetch", "robot": "fetch", "topics": {"stamped": True, "scan": "base_scan"}}]}


@pytest.fixture
def ends(monkeypatch):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(100 + os.getpid() % 100))
    robot = open_port("ros2", TEAM, 0, MEMBERS, rehearsed=True)
    world = open_team_port("ros2", TEAM, MEMBERS)
    yield robot, world
    robot.close()
    world.close()


def _until(condition, *ends):
    limit = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < limit, "nothing came"
        for end in ends:
            end.wait(time.monotonic() + 0.05)


def test_messages_come_as_they_were_sent(ends):
    robot, world = ends
    ranges = np.array([1.0, np.inf, -np.inf, np.nan, 2.5], np.float32)

    def send() -> bool:
        now, clock = world.times()
        times = {"stamp": clock - 0.1, "arrived": now}
        scan = Scan(
            ranges=ranges, angle_min=-1.0, angle_increment=0.5, range_min=0.05, range_max=25.0, **times
        )
        for index in range(2):
            pose = Fix(pose=(1.0 + index, -2.0, 3.0), **times)
            world.publish(index, scan, Motion(velocity=(0.3, -0.7), **times), pose)
        return len(robot.latest().fixes) == 2 and robot.latest().scan is not None

    _until(send, robot)
    inbox = robot.latest()
    assert np.array_equal(inbox.scan.ranges, ranges, equal_nan=True)
    assert inbox.motion.velocity == (0.3, -0.7)
    assert inbox.fixes["freight"].pose == pytest.approx((2.0, -2.0, 3.0))
    assert inbox.clock - inbox.scan.stamp == pytest.approx(0.1, abs=2.0)
    assert {each.topic: each.count > 0 for each in robot.traffic()} == {
        "/fetch/base_scan": True, "/fetch/odom": True, "/fetch/amcl_pose": True, "/freight/amcl_pose": True,
    }  # fmt: skip
    world.begin(7)
    _until(lambda: robot.episode == 7, robot)
    assert robot.latest().scan is None, "an episode begins with nothing"


def test_commands_and_plans_reach_the_other_end(ends):
    robot, world = ends
    found: list[tuple[int, tuple[float, float]]] = []
    paths = np.zeros((2, 3, 2))

    def send() -> bool:
        robot.send((0.5, -0.25))
        robot.show(View(goal=(1.0, 2.0), waypoint=(0.0, 0.0), mean=(1.0, 2.0), std=(0.3, 0.3), paths=paths))
        found.extend(world.wait(time.monotonic() + 0.05))
        return bool(found) and world.goals[0] == (1.0, 2.0)

    _until(send)
    assert found[0] == (0, (0.5, -0.25))


def test_an_emergency_stop_holds_until_it_is_released(ends):
    from std_msgs.msg import Bool

    robot, world = ends
    publisher = world._ros.node.create_publisher(Bool, "/hpp/stop", 1)
    for pressed in (True, False):
        message = Bool(data=pressed)
        _until(lambda m=message, p=pressed: publisher.publish(m) or robot.latest().stopped is p, robot)
