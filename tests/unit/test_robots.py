"""Every number of the bundled robots, pinned with the place it comes from."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import torch
from hpp_robots import base

from hpp_framework.core.robot import DriveLimits, Lidar, RobotSpec
from hpp_framework.core.world import World
from hpp_framework.plugins.registry import hub
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.errors import ConfigError

WHEEL_RADIUS, WHEEL_CENTRE = 0.0605, 0.0553
"""URDF 0.8.3: wheel joint height; radius 1 / 16.5289 of the drive's gear."""


@pytest.fixture(params=["fetch", "fetch-real", "freight", "freight-real"])
def robot(request) -> RobotSpec:
    return hub().robots.create(request.param)


@pytest.fixture(params=["fetch", "freight"])
def paper_robot(request) -> RobotSpec:
    return request.getfixturevalue(request.param)


def test_drive_limits_are_the_papers(paper_robot):
    # Wang et al. 2020, appendix C.1
    assert paper_robot.drive == DriveLimits(
        speed=(0.0, 1.0), turn_rate=3.0, acceleration=0.4, turn_acceleration=1.48
    )
    assert math.degrees(paper_robot.drive.turn_acceleration) == pytest.approx(85, abs=0.3)


@pytest.mark.parametrize(
    ("name", "speed", "acceleration"), [("fetch-real", 1.0, 0.75), ("freight-real", 1.5, 2.0)]
)
def test_drive_limits_are_the_published_ones(name, speed, acceleration):
    # fetch_robots' bringup of each robot; turning: defaults of robot_controllers' base controller
    assert hub().robots.create(name).drive == DriveLimits(
        speed=(0.0, speed), turn_rate=4.5, acceleration=acceleration, turn_acceleration=3.0
    )


@pytest.mark.parametrize("name", ["fetch", "freight"])
def test_robots_with_their_own_limits_have_the_same_body(name, request):
    paper, real = request.getfixturevalue(name), hub().robots.create(f"{name}-real")
    assert real.name == f"{name}-real"
    assert dataclasses.replace(real, name=name, drive=paper.drive) == paper


def test_lidar_is_the_papers_and_the_data_sheets(robot):
    lidar = robot.lidar
    assert lidar.beams == 222  # paper, appendix C.1
    assert math.degrees(lidar.field_of_view) == pytest.approx(220.0)  # paper, appendix C.1
    assert (lidar.min_range, lidar.max_range) == (0.05, 25.0)  # SICK TIM571
    assert lidar.noise_std == 0.02  # fetch_gazebo's sensor model
    assert lidar.mount == (0.235, 0.0, 0.0)  # URDF laser_joint
    assert lidar.height == pytest.approx(0.2878 + WHEEL_RADIUS - WHEEL_CENTRE, abs=3e-4)  # URDF laser_joint


def test_beams_run_from_the_most_clockwise_and_include_both_ends(robot):
    angles = np.degrees(robot.lidar.angles())
    assert angles.shape == (222,)
    assert angles[[0, -1]] == pytest.approx([-110, 110])
    assert np.diff(angles) == pytest.approx(np.full(221, 0.99548), abs=1e-5)


def test_footprint_and_profile(robot):
    assert robot.footprint_radius == 0.2877  # collision STL of base_link
    # at the lidar plane the shell spans x -0.282..0.050, y -0.264..0.264 (STL section); a centred disc
    assert 0.05 < robot.profile_radius < robot.footprint_radius


def test_the_lidar_does_not_see_its_own_robot(robot):
    """No beam of the 220 degrees meets the robot's own profile disc."""
    x = robot.lidar.mount[0]
    for angle in robot.lidar.angles():
        direction = np.array([math.cos(angle), math.sin(angle)])
        along = -x * direction[0]
        miss = math.hypot(x, 0) if along <= 0 else abs(x * direction[1])
        assert miss > robot.profile_radius


def test_masses_and_heights(fetch, freight):
    assert (fetch.mass, freight.mass) == (121.3, 78.85)  # URDF
    assert fetch.height == 1.10  # URDF, torso down
    assert freight.height == pytest.approx(0.36, abs=0.005)  # URDF
    assert freight.height == base.BASE_HEIGHT


def test_numbers_name_their_sources(robot):
    assert any("urdf" in source for source in robot.sources)
    drive = "fetch_robots" if robot.name.endswith("-real") else "Wang et al. 2020"
    assert any(drive in source for source in robot.sources)
    assert any("TIM571" in source for source in robot.sources)


def test_bodies_stay_within_footprint_and_height(robot):
    parts = robot.build_body()
    assert len(parts) > 5
    for part in parts:
        assert part.position[2] < robot.height + 0.03
        assert math.hypot(*part.position[:2]) < robot.footprint_radius + 0.01
        assert min(part.color) >= 0
        assert max(part.color) <= 1


def test_the_slot_frees_the_lidar_plane(robot):
    """Solid parts at lidar height lie within the profile disc, so that both simulators see the same robot."""
    low, high = base.SLOT
    assert low < robot.lidar.height < high
    for part in robot.build_body():
        if part.solid and part.shape == "cylinder":
            bottom, top = part.position[2] - part.size[1] / 2, part.position[2] + part.size[1] / 2
            if bottom < robot.lidar.height < top:
                assert part.size[0] == robot.profile_radius


def test_the_two_robots_differ_in_body_mass_and_height(fetch, freight):
    assert fetch.build_body() != freight.build_body()
    assert fetch.mass > freight.mass
    assert fetch.height > freight.height


def test_robots_are_frozen(robot):
    with pytest.raises(dataclasses.FrozenInstanceError):
        robot.mass = 1.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"speed": (0.1, 1.0)}, r"speed\[0\]' must be at most 0, got 0.1. .*low <= 0 < high"),
        ({"speed": (0.0, math.inf)}, r"speed\[1\]' must be finite"),
        ({"turn_rate": 0.0}, "'turn_rate' must be greater than 0"),
        ({"acceleration": -1.0}, "'acceleration' must be greater than 0"),
        ({"turn_acceleration": math.nan}, "'turn_acceleration' must be finite"),
    ],
)
def test_bad_drive_limits(change, message):
    good = {"speed": (0.0, 1.0), "turn_rate": 3.0, "acceleration": 0.4, "turn_acceleration": 1.48}
    with pytest.raises(ConfigError, match=message):
        DriveLimits(**(good | change))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"beams": 1}, "'beams' must be at least 2"),
        ({"field_of_view": 0.0}, "'field_of_view' must be greater than 0"),
        ({"field_of_view": 7.0}, "'field_of_view' must be at most 6.28319.*radians"),
        ({"min_range": 30.0}, "min_range < max_range"),
        ({"height": 0.0}, "'height' must be greater than 0"),
    ],
)
def test_bad_lidars(change, message):
    with pytest.raises(ConfigError, match=message):
        Lidar(**({f.name: getattr(base.LIDAR, f.name) for f in dataclasses.fields(Lidar)} | change))


def test_a_lidar_on_a_mast_in_the_middle_sees_all_around(fetch):
    lidar = dataclasses.replace(fetch.lidar, mount=(0.0, 0.0, 0.0), field_of_view=2 * math.pi, beams=361)
    robot = dataclasses.replace(fetch, lidar=lidar, profile_radius=0.1)
    room = World(name="room", bounds=(-3.0, -2.0, 3.0, 2.0))
    start = torch.tensor([[[1.0, 0.5, 0.3], [-2.0, -1.0, 0.0]]])
    scan = BatchSimulator([robot, robot]).reset([room], start).scans[0, 0].double()
    angle = torch.from_numpy(lidar.angles()) + 0.3
    walls = torch.stack([2.0 / angle.cos(), -4.0 / angle.cos(), 1.5 / angle.sin(), -2.5 / angle.sin()])
    expected = walls.where(walls > 0, torch.inf).amin(0)
    mate = (scan - expected).abs() > 0.01
    assert 1 <= mate.sum() <= 4, "the other robot's mast of 0.1 m hides a few beams"
    assert (scan[mate] - (3.0**2 + 1.5**2) ** 0.5).abs().max() < 0.15


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mass": 0.0}, "robot: 'mass' must be greater than 0"),
        ({"height": math.nan}, "'height' must be finite"),
        ({"profile_radius": 0.28}, "it would see itself"),
    ],
)
def test_bad_robots(fetch, change, message):
    with pytest.raises(ConfigError, match=message):
        dataclasses.replace(fetch, **change)
