"""Robots from URDF: every number against one worked out by hand, and what is missing is asked for."""

from __future__ import annotations

import ast
import math
import pickle

import pytest
import trimesh

from hpp_framework.cli.main import main
from hpp_framework.onboarding.names import Name
from hpp_framework.onboarding.urdf.module import module_of_urdf
from hpp_framework.onboarding.urdf.robot import robot_from_urdf
from hpp_framework.testing import check_robot
from hpp_framework.utils.errors import ConfigError

# the root lies at the back; the axle is 0.1 m ahead of it and 0.05 m up, the wheels have radius 0.08 m:
# the floor is 0.03 m below the root
CHASSIS = """
  <link name="base">
    <inertial><mass value="10.5"/></inertial>
    <collision><origin xyz="0.1 0 0.10"/><geometry><box size="0.30 0.20 0.10"/></geometry></collision>
    <collision><origin xyz="0.1 0 0.20"/>
      <geometry><cylinder radius="0.06" length="0.16"/></geometry></collision>
  </link>
  <link name="bumper"><collision><geometry><sphere radius="0.02"/></geometry></collision></link>
  <joint name="bumper_joint" type="fixed"><parent link="base"/><child link="bumper"/>
    <origin xyz="0.29 0 0.10"/></joint>
"""
WHEEL = """
  <link name="{side}_wheel"><inertial><mass value="0.75"/></inertial>
    <collision><origin rpy="1.5707963267948966 0 0"/>
      <geometry><cylinder radius="0.08" length="0.03"/></geometry></collision></link>
  <joint name="{side}_joint" type="continuous"><parent link="base"/><child link="{side}_wheel"/>
    <origin xyz="0.1 {y} 0.05"/><axis xyz="0 1 0"/>{limit}</joint>
"""
LIMIT = '<limit effort="5" velocity="10"/>'
LIDAR = """
  <link name="front_laser"/>
  <joint name="laser_joint" type="fixed"><parent link="base"/><child link="front_laser"/>
    <origin xyz="0.20 0.02 0.22" rpy="0 0 0.1"/></joint>
"""
SENSOR = """
  <gazebo reference="front_laser"><sensor type="ray"><ray>
    <scan><horizontal><samples>180</samples><min_angle>-1.5</min_angle><max_angle>1.5</max_angle></horizontal></scan>
    <range><min>0.06</min><max>8.0</max></range><noise><type>gaussian</type><stddev>0.015</stddev></noise>
  </ray></sensor></gazebo>
"""
MEASURES = {"beams": 90, "field_of_view": 3.0, "min_range": 0.1, "max_range": 10.0, "noise_std": 0.01}
ANSWERS = {"reverse_speed": 0.0, "acceleration": 0.5, "turn_acceleration": 2.0}


def wheels(limit=LIMIT):
    return "".join(
        WHEEL.format(side=side, y=y, limit=limit) for side, y in (("left", 0.15), ("right", -0.15))
    )


def write(folder, *parts):
    file = folder / "cart.urdf"
    file.write_text('<?xml version="1.0"?>\n<robot name="cart">' + "".join(parts) + "</robot>")
    return file


@pytest.fixture
def cart(tmp_path):
    return write(tmp_path, CHASSIS, wheels(), LIDAR, SENSOR)


def test_every_number_is_as_worked_out_by_hand(cart):
    robot = robot_from_urdf(cart, "cart", ANSWERS)
    # 10 rad/s on wheels of 0.08 m, 0.30 m apart
    assert robot.drive.speed == (0.0, 0.8)
    assert robot.drive.turn_rate == pytest.approx(2 * 0.8 / 0.30, abs=1e-4)
    assert (robot.drive.acceleration, robot.drive.turn_acceleration) == (0.5, 2.0)
    # the bumper's front, 0.29 - 0.1 + 0.02 m ahead of the axle, is the farthest of all; the wheels reach
    # hypot(0.08, 0.165) = 0.183 m and the corners of the box hypot(0.15, 0.10) = 0.180 m
    assert robot.footprint_radius == pytest.approx(0.21, abs=1e-4)
    assert robot.height == pytest.approx(0.28 + 0.03)
    assert robot.mass == pytest.approx(10.5 + 2 * 0.75)
    assert robot.lidar.mount == pytest.approx((0.10, 0.02, 0.1))
    assert robot.lidar.height == pytest.approx(0.22 + 0.03)
    # at that height there is the mast alone
    assert robot.profile_radius == pytest.approx(0.06)
    assert (robot.lidar.beams, robot.lidar.field_of_view, robot.lidar.noise_std) == (180, 3.0, 0.015)
    assert (robot.lidar.min_range, robot.lidar.max_range) == (0.06, 8.0)
    assert "cart.urdf: mass 12, <inertial> of 3 of 5 links, added up" in robot.sources
    assert "cart.urdf: acceleration 0.5, answered" in robot.sources


def test_the_body_is_the_collision_shapes_where_they_are(cart):
    robot = robot_from_urdf(cart, "cart", ANSWERS)
    box, mast, bumper, left, _ = robot.build_body()
    assert (box.shape, box.size, box.position) == ("box", (0.30, 0.20, 0.10), (0.0, 0.0, 0.13))
    assert (mast.shape, mast.size[:2], mast.position) == ("cylinder", (0.06, 0.16), (0.0, 0.0, 0.23))
    assert (bumper.shape, bumper.size[0], bumper.position) == ("sphere", 0.02, (0.19, 0.0, 0.13))
    assert left.position == pytest.approx((0.0, 0.15, 0.08))
    assert left.rotation == pytest.approx((math.pi / 2, 0, 0), abs=1e-6)


def test_it_passes_its_check_and_travels_to_workers(cart):
    robot = robot_from_urdf(cart, "cart", ANSWERS)
    check_robot(robot)
    assert pickle.loads(pickle.dumps(robot)) == robot
    assert robot_from_urdf(cart, "cart", ANSWERS) == robot


def test_what_the_file_does_not_say_is_asked_for_and_not_guessed(tmp_path):
    bare = write(
        tmp_path, CHASSIS.replace('<inertial><mass value="10.5"/></inertial>', ""), wheels(""), LIDAR
    )
    bare.write_text(bare.read_text().replace('<inertial><mass value="0.75"/></inertial>', ""))
    with pytest.raises(ConfigError) as caught:
        robot_from_urdf(bare, "cart")
    asked = [line.split(":")[0].strip() for line in str(caught.value).splitlines()[1:]]
    assert sorted(asked) == sorted(["speed", "turn_rate", "mass", *ANSWERS, *MEASURES])
    for said in (
        "m/s^2: no URDF says",
        "the wheels' joints have no velocity limits",
        "no link has an <inertial>",
    ):
        assert said in str(caught.value)
    answers = {**ANSWERS, **MEASURES, "speed": 1.0, "turn_rate": 2.0, "mass": 9.0}
    for left_out in answers:
        with pytest.raises(ConfigError, match=f"--answers FILE:\n  {left_out}:  #"):
            robot_from_urdf(
                bare, "cart", {name: value for name, value in answers.items() if name != left_out}
            )
    assert robot_from_urdf(bare, "cart", answers).drive.speed == (0.0, 1.0)


def test_a_profile_that_nothing_shows_is_asked_for(tmp_path):
    above = write(tmp_path, CHASSIS, wheels(), LIDAR.replace("0.02 0.22", "0.02 0.40"), SENSOR)
    with pytest.raises(
        ConfigError, match="profile_radius:  # .* no collision shape lies .* height of 0.43 m"
    ):
        robot_from_urdf(above, "cart", ANSWERS)


def test_an_answer_goes_before_the_file(cart):
    assert robot_from_urdf(cart, "cart", {**ANSWERS, "speed": 0.4, "reverse_speed": 0.3}).drive.speed == (
        -0.3,
        0.4,
    )


def test_meshes_are_read_from_beside_the_file_and_from_packages(tmp_path):
    (tmp_path / "meshes").mkdir()
    trimesh.creation.box((600, 100, 100)).export(tmp_path / "meshes" / "shell.stl")
    for name in ("meshes/shell.stl", "package://cart_description/meshes/shell.stl"):
        mesh = f'<mesh filename="{name}" scale="0.001 0.001 0.001"/>'
        file = write(tmp_path, CHASSIS.replace('<box size="0.30 0.20 0.10"/>', mesh), wheels(), LIDAR, SENSOR)
        robot = robot_from_urdf(file, "cart", ANSWERS)
        assert robot.footprint_radius == pytest.approx(math.hypot(0.3, 0.05), abs=1e-4)
        assert robot.build_body()[0].size == pytest.approx((0.6, 0.1, 0.1))


CASTOR = WHEEL.format(side="castor", y=0.0, limit="").replace('xyz="0.1 0.0 0.05"', 'xyz="-0.05 0.0 0.05"')


def test_a_castor_is_no_driven_wheel(tmp_path):
    file = write(tmp_path, CHASSIS, wheels(), CASTOR, LIDAR, SENSOR)
    assert robot_from_urdf(file, "cart", ANSWERS).drive.speed == (0.0, 0.8)


WHOLE = (CHASSIS, wheels(), LIDAR)
NO_MESH = CHASSIS.replace('<sphere radius="0.02"/>', '<mesh filename="a.stl"/>')
SHORT_BOX = CHASSIS.replace("0.30 0.20 0.10", "0.30 0.20")
TILTED = LIDAR.replace('rpy="0 0 0.1"', 'rpy="0 0.5 0"')


@pytest.mark.parametrize(
    ("parts", "answers", "message"),
    [
        ((CHASSIS, LIDAR), {}, "which two wheels drive it. Found: no wheel at all"),
        (WHOLE, {"wheels": ["left_joint", "laser_joint"]}, "joint 'laser_joint' is no wheel"),
        (WHOLE, {"wheels": "left_joint"}, "wheels must be the joints .LEFT, RIGHT."),
        (WHOLE[:2], {}, "which link is the lidar. no link sounds like one. Name it: 'lidar_link: LINK'"),
        (WHOLE, {"lidar_link": "nose"}, "has no link 'nose' for a lidar"),
        (WHOLE, {"acceleratoin": 1}, "'acceleratoin' is unknown. Did you mean 'acceleration'"),
        (WHOLE, {"mass": "heavy"}, "mass must be a number, got 'heavy'"),
        ((*WHOLE[:2], TILTED), {}, "not look around in a level"),
        ((SHORT_BOX, *WHOLE[1:]), {}, "'0.30 0.20' must be 3 numbers"),
        ((NO_MESH, *WHOLE[1:]), {}, "the mesh 'a.stl'"),
        ((*WHOLE, '<link name="lost"/>'), {}, "one link must be the root of all, found base, lost"),
        (("</robot><x>",), {}, "is no XML"),
    ],
)
def test_what_cannot_be_read_is_said(tmp_path, parts, answers, message):
    with pytest.raises(ConfigError, match=message):
        robot_from_urdf(write(tmp_path, *parts), "cart", answers)


@pytest.mark.parametrize(
    ("number", "message"),
    [
        ("field_of_view: 220", "'field_of_view' must be at most 6.28319, got 220"),
        ("max_range: 10000", "[units] lidar.max_range is 10000, more than any robot's (400)"),
        ("mass: 0", "'mass' must be greater than 0, got 0"),
        ("beams: 1", "'beams' must be at least 2, got 1"),
    ],
)
def test_nothing_is_written_of_a_robot_that_cannot_be(cart, tmp_path, capsys, number, message):
    answers = tmp_path / "cart.yaml"
    answers.write_text("\n".join([*(f"{name}: {value}" for name, value in ANSWERS.items()), number]))
    with pytest.raises(SystemExit) as stop:
        main(f"new robot my-lab/cart --urdf {cart} --answers {answers} --out {tmp_path}".split())
    assert stop.value.code == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "my-lab").exists()


def test_answers_that_are_not_there_are_named(cart, tmp_path):
    nowhere = tmp_path / "nowhere.yaml"
    with pytest.raises(ConfigError, match="cannot read the answers in '.*nowhere.yaml': No such file or dir"):
        module_of_urdf(Name("my-lab", "cart"), cart, nowhere)


def test_a_whole_turn_may_be_rounded_up(cart):
    robot = robot_from_urdf(cart, "cart", {**ANSWERS, "field_of_view": 6.284, "profile_radius": 0.01})
    assert robot.lidar.field_of_view == 2 * math.pi


def test_a_package_holds_the_numbers_and_their_sources(cart, tmp_path, capsys):
    answers = tmp_path / "cart.yaml"
    answers.write_text("\n".join(f"{name}: {value}" for name, value in ANSWERS.items()))
    command = f"new robot my-lab/cart --urdf {cart} --out {tmp_path}"
    with pytest.raises(SystemExit):
        main(command.split())
    assert "acceleration:  # highest acceleration in m/s^2" in capsys.readouterr().err
    assert not (tmp_path / "my-lab").exists()
    main(f"{command} --answers {answers}".split())
    source = (tmp_path / "my-lab" / "my_lab" / "cart.py").read_text()
    assert "# collision shape of link bumper, the farthest out\n        footprint_radius=0.21," in source
    assert "# reverse_speed: answered\n" in source
    space = {}
    exec(compile(ast.parse(source), "cart.py", "exec"), space)
    written, read = space["cart"](), robot_from_urdf(cart, "cart", ANSWERS)
    assert written.build_body() == read.build_body()
    for name in ("name", "drive", "lidar", "footprint_radius", "profile_radius", "height", "mass"):
        assert getattr(written, name) == getattr(read, name)
