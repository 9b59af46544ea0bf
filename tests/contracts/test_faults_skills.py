"""Skills and robots, one thing wrong with each: (what is wrong, plugin, rule, words of the message)."""

from __future__ import annotations

import dataclasses
import functools
import math
import random

import numpy as np
import pytest
import torch

from hpp_framework import testing
from hpp_framework.core.geometry import polar
from hpp_framework.core.robot import DriveLimits, Lidar, Part, RobotSpec
from hpp_framework.core.skill import Skill
from hpp_framework.testing import CheckError, check_robot, check_skill
from hpp_framework.testing.build import find_source
from hpp_framework.utils.errors import CheckpointError, ConfigError


def box_body():
    return (Part(shape="box", size=(0.3, 0.3, 0.2), position=(0.0, 0.0, 0.15), solid=True),)


ROBOT = RobotSpec(
    name="disc",
    drive=DriveLimits(speed=(-0.2, 0.8), turn_rate=2.0, acceleration=0.5, turn_acceleration=1.5),
    lidar=Lidar(
        beams=60, field_of_view=math.radians(240), mount=(0.2, 0.0, 0.0), height=0.3, min_range=0.05,
        max_range=20.0, noise_std=0.01,
    ),
    footprint_radius=0.25, profile_radius=0.18, height=0.35, mass=30.0, body=box_body,
)  # fmt: skip


def robot(**changes):
    return dataclasses.replace(ROBOT, **changes)


def lidar(**changes):
    return robot(lidar=dataclasses.replace(ROBOT.lidar, **changes))


def drive(**changes):
    return robot(drive=dataclasses.replace(ROBOT.drive, **changes))


def part(**changes):
    return robot(body=lambda: (dataclasses.replace(box_body()[0], **changes),))


def raises():
    raise OSError("no rover.yaml")


masses = iter(range(1, 1000))

ROBOTS = [
    ("name with a slash", robot(name="my/disc"), "robot-name", "'my/disc' holds ['/']"),
    ("turn rate in degrees", drive(turn_rate=120.0), "units",
     "drive.turn_rate is 120, more than any robot's"),
    ("turning in degrees", drive(turn_acceleration=90.0), "units", "turn_acceleration is 90"),
    ("speed in cm/s", drive(speed=(0.0, 80.0)), "units", "drive.speed is 80"),
    ("footprint in millimetres", robot(footprint_radius=250.0), "units", "footprint_radius is 250"),
    ("height in kilometres", robot(height=0.001), "units", "height is 0.001, less than any robot's"),
    ("mass in grams", robot(mass=30_000.0), "units", "mass is 30000"),
    ("range in millimetres", lidar(max_range=20_000.0), "units", "lidar.max_range is 20000"),
    ("mount in degrees", lidar(mount=(0.2, 0.0, 90.0)), "units", "lidar.mount angle is 90"),
    ("negative noise", lidar(noise_std=-0.1), "robot-number", "lidar.noise_std is -0.1"),
    ("mount at NaN", lidar(mount=(math.nan, 0.0, 0.0)), "robot-number", "lidar.mount distance is nan"),
    ("lidar beside the robot", lidar(mount=(0.6, 0.0, 0.0)), "lidar-outside", "0.60 m from the centre"),
    ("lidar over the robot", lidar(height=1.5), "lidar-above",
     "is 1.50 m, above the robot's height of 0.35 m"),
    ("dead zone", lidar(min_range=1.2), "lidar-blind", "is 1.20 m, more than the footprint's 0.25 m"),
    ("no brakes", drive(acceleration=0.005), "braking", "takes 64.0 m to stop from 0.8 m/s"),
    ("seen larger than it is", robot(footprint_radius=0.21, profile_radius=0.22, lidar=dataclasses.replace(
        ROBOT.lidar, mount=(0.21, 0.0, 0.0), field_of_view=3.0)), "profile", "is 0.22 m, larger than"),
    ("body of a list", robot(body=lambda: [1, 2]), "body", "returned list that is no tuple of Part"),
    ("wide body", part(size=(1.0, 0.3, 0.2)), "body", "solid part 0 reaches 0.52 m from the centre"),
    ("tall body", part(position=(0.0, 0.0, 0.9)), "body", "and 1.00 m up"),
    ("colours of 0..255", part(color=(255, 0, 0)), "body", "a colour outside 0..1"),
    ("body raises", robot(body=raises), "body", "OSError: no rover.yaml"),
    ("another mass each time", lambda: robot(mass=float(next(masses))), "robot-varies", "other numbers"),
    ("factory raises", raises, "build", "raised OSError: no rover.yaml (test_faults_skills.py"),
    ("factory with a parameter", lambda path: ROBOT, "signature", "does not take () -> RobotSpec: missing"),
    ("no return", lambda: None, "kind", "returned None (is a 'return' missing?), which is no RobotSpec"),
    ("field of view in degrees", lambda: lidar(field_of_view=240.0), "build",
     "got 240.0. Use 6.28319 or less. It is in (0, 2*pi] radians."),
    ("one beam", lambda: lidar(beams=1), "build", "'beams' must be at least 2, got 1"),
    ("sees itself", lambda: lidar(mount=(0.0, 0.0, 0.0)), "build", "it would see itself"),
    ("limits the wrong way round", lambda: drive(speed=(0.8, -0.2)), "build", "low <= 0 < high"),
]  # fmt: skip


class Straight(Skill):
    """Turns on the spot until the goal lies ahead, then drives, and brakes in time."""

    def __init__(self, spec=ROBOT):
        self.limits = spec.drive

    def act(self, observation, goal):
        return self.command(observation, polar(observation.pose, goal))

    def command(self, observation, seen):
        distance, bearing = seen.unbind(-1)
        top, turn = self.limits.speed[1], self.limits.turn_rate
        speed = (self.limits.acceleration * distance).sqrt().clamp(0, top) * (bearing.abs() < 0.5)
        command = torch.stack([speed, (2 * bearing).clamp(-turn, turn)], -1)
        return torch.where((distance < 0.2)[:, None], 0.0, command)


def skill(change):
    """Return a skill whose commands are changed by a function of (skill, observation, goal, command)."""

    class Changed(Straight):
        def __init__(self, spec=ROBOT):
            super().__init__(spec)
            self.memory = torch.zeros(64, 2)
            self.rng = torch.Generator().manual_seed(0)
            self.calls = 0

        def act(self, observation, goal):
            return change(self, observation, goal, super().act(observation, goal))

    return Changed


def shakes(it, seen, goal, out):
    return out * (0.9 + 0.1 * torch.rand(len(out), 1))


def shakes_by_numpy(it, seen, goal, out):
    return out * np.random.uniform(0.9, 1.0)  # noqa: NPY002  # the fault


def shakes_by_python(it, seen, goal, out):
    return out * random.uniform(0.9, 1.0)


def shakes_by_itself(it, seen, goal, out):
    return out * (0.9 + 0.1 * torch.rand(len(out), 1, generator=it.rng))


def smooths(it, seen, goal, out):
    it.memory[: len(out)] = 0.8 * it.memory[: len(out)] + 0.2 * out
    return it.memory[: len(out)].clone()


def buffers(it, seen, goal, out):
    it.memory[: len(out)] = out
    return it.memory[: len(out)]


def shifts_goal(it, seen, goal, out):
    goal -= 0.01
    return out


def clamps_scans(it, seen, goal, out):
    seen.scans.clamp_(max=1.0)
    return out


def crossed(it, seen, goal, out):
    return it.command(seen, polar(seen.pose, goal) * torch.tensor([1.0, -1.0]))


def own_frame(it, seen, goal, out):
    return it.command(seen, polar(torch.zeros_like(seen.pose), goal))


def first_robot(it, seen, goal, out):
    return it.command(seen, polar(seen.team_poses[:, 0], goal))


def in_degrees(it, seen, goal, out):
    return out * torch.tensor([1.0, 180 / math.pi])


def never_brakes(it, seen, goal, out):
    fast = (seen.velocity[:, :1] > 0.6).expand_as(out)
    return torch.where(fast, torch.tensor([0.8, 0.0]), out)


def divides(it, seen, goal, out):
    distance = polar(seen.pose, goal)[:, :1]
    return out * (distance / distance)


def nearest(it, seen, goal, out):
    hits = [row[row < it_range].min() for row in seen.scan for it_range in (19.9,)]
    return out * (torch.stack(hits)[:, None] > 0)


def no_weights(spec):
    raise CheckpointError(f"there are no weights for robot '{spec.name}'")


def picky(spec):
    raise ConfigError("only for robots with wings")


@functools.cache
def cached(spec):
    return Straight(spec)


class Abstract(Skill):
    """Forgets act()."""


SKILLS = [
    ("transposed", skill(lambda it, seen, goal, out: out.T), "shape", "shape (2, 4), not (4, 2)"),
    ("speed alone", skill(lambda it, seen, goal, out: out[:, 0]), "shape", "has shape (4,), not (4, 2)"),
    ("a list", skill(lambda it, seen, goal, out: out.tolist()), "shape", "returned list, not a tensor"),
    ("numpy's", skill(lambda it, seen, goal, out: out.numpy()), "shape", "returned ndarray, not a tensor"),
    ("double", skill(lambda it, seen, goal, out: out.double()), "dtype", "torch.float64, not torch.float32"),
    ("not a number", skill(lambda it, seen, goal, out: out * math.nan), "not-finite", "8 of 8 numbers"),
    ("divides by the distance", skill(divides), "not-finite", "for a goal at the robot's own place has"),
    ("changes the goal", skill(shifts_goal), "mutates-input", "changed what it was given, by up to"),
    ("changes the scans", skill(clamps_scans), "mutates-input", "changed what it was given"),
    ("a view", skill(lambda it, seen, goal, out: seen.velocity), "shares-memory", "in an input's memory"),
    ("a buffer", skill(buffers), "reuses-memory", "changed its first answer at the second call"),
    ("torch's generator", skill(shakes), "global-rng", "drew from the global generator of torch"),
    ("numpy's generator", skill(shakes_by_numpy), "global-rng", "drew from the global generator of numpy"),
    ("Python's generator", skill(shakes_by_python), "global-rng", "Python's global generator, random"),
    ("a generator of its own", skill(shakes_by_itself), "not-repeatable",
     "the same question otherwise later"),
    ("remembers commands", skill(smooths), "not-repeatable", "the same question otherwise later"),
    ("mean of the batch", skill(lambda it, seen, goal, out: out - 0.1 * out.mean(0)), "batch", "alone"),
    ("one episode fails", skill(lambda it, seen, goal, out: out[[0, 1, *range(2, len(out))]]), "raises",
     "IndexError"),
    ("nothing in sight fails", skill(nearest), "raises", "where the lidar sees nothing raised"),
    ("too fast", skill(lambda it, seen, goal, out: out * 3), "beyond-limits", "disc does -0.2 .. 0.8 m/s"),
    ("turns in degrees", skill(in_degrees), "beyond-limits", "and 2 rad/s"),
    ("ignores the goal", skill(lambda it, seen, goal, out: torch.full_like(out, 0.5)), "goal-ignored",
     "commands [0.5, 0.5] for goals in all directions"),
    ("left and right crossed", skill(crossed), "no-progress", "after"),
    ("the goal taken for its own frame", skill(own_frame), "no-progress", "from goals 2.5 m away: ahead"),
    ("robot 0's pose", skill(first_robot), "no-progress", "from goals 2.5 m away"),
    ("never brakes", skill(never_brakes), "drives-on", "is away from its goals again"),
    ("shared", cached, "shared-object", "the same object at its second call"),
    ("two parameters", lambda spec, weights: Straight(spec), "signature", "does not take (robot: RobotSpec)"),
    ("no return", lambda spec: None, "kind", "returned None (is a 'return' missing?), which is no Skill"),
    ("a function", lambda spec: lambda seen, goal: goal, "kind", "which is no Skill"),
    ("abstract", lambda spec: Abstract(), "build", "abstract"),
    ("refuses", picky, "build", "ConfigError: only for robots with wings"),
    ("no weights", no_weights, "weights", "there are no weights for robot 'disc'"),
]  # fmt: skip


@pytest.mark.parametrize(("wrong", "plugin", "rule", "words"), ROBOTS, ids=[case[0] for case in ROBOTS])
def test_broken_robots_are_caught(wrong, plugin, rule, words, caught):
    caught(check_robot, plugin, rule, words)


@pytest.mark.parametrize(("wrong", "plugin", "rule", "words"), SKILLS, ids=[case[0] for case in SKILLS])
def test_broken_skills_are_caught(wrong, plugin, rule, words, caught):
    caught(check_skill, plugin, rule, words, robot=ROBOT)


@pytest.mark.parametrize("plugin", [ROBOT, lambda: ROBOT, robot], ids=["spec", "factory", "function"])
def test_the_unbroken_robot_is_fine(plugin):
    check_robot(plugin)


@pytest.mark.parametrize("plugin", [Straight(), Straight], ids=["object", "factory"])
def test_the_unbroken_skill_is_fine(plugin):
    check_skill(plugin, robot=ROBOT)


def test_every_rule_has_a_fault(rules_of):
    cases = {rule for _, _, rule, _ in ROBOTS + SKILLS}
    assert rules_of(testing.robot, testing.skill, testing.purity) <= cases


def test_what_is_neither_object_nor_factory_is_refused():
    with pytest.raises(CheckError, match="is {'name': 'disc'}, neither a RobotSpec nor a factory of one"):
        find_source("robot", {"name": "disc"}, RobotSpec)


def test_one_call_reports_everything():
    wrong = dataclasses.replace(drive(turn_rate=120.0), mass=30_000.0, name="a/b")
    with pytest.raises(CheckError, match="robot RobotSpec: 3 things to mend") as error:
        check_robot(wrong)
    assert [finding.rule.name for finding in error.value.findings] == ["robot-name", "units", "units"]
    assert all(word in str(error.value) for word in ("Why it matters: ", "What to write: ", "math.radians"))
