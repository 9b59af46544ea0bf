"""Tasks and worlds, one thing wrong with each: (what is wrong, plugin, rule, words of the message)."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
import torch

from hpp_framework import testing
from hpp_framework.core.task import Task, relative_speed
from hpp_framework.core.world import Box, Cylinder, SpawnRule, World
from hpp_framework.testing import check_task, check_world
from hpp_framework.utils.errors import ConfigError


def off_centre(poses):
    xy = poses[..., :2]
    return (xy - xy.mean(-2, keepdim=True)).norm(dim=-1).amax(-1)


class Meet(Task):
    """All within a metre of the centre, at rest."""

    radius = 1.0

    def reward(self, poses):
        return -off_centre(poses)

    def success(self, poses, velocities=None):
        near = off_centre(poses) < 1.0
        return near if velocities is None else near & (relative_speed(poses, velocities) < 0.1)


def task(**members):
    return type("Changed", (Meet,), members)()


def success(answer):
    """Return a task whose success is a function of (poses, velocities)."""
    return task(success=lambda self, poses, velocities=None: answer(poses, velocities))


def at_rest(poses, velocities):
    """Return whether no robot moves, wherever the team is."""
    if velocities is None:
        return off_centre(poses) < 1.0
    return velocities.abs().amax((-1, -2)) < 0.1


def contact_only(poses, velocities):
    near = off_centre(poses) < 1.0
    return near if velocities is None else torch.zeros_like(near)


def reward(change):
    """Return a task whose reward is changed by a function of (poses, reward)."""
    return task(reward=lambda self, poses: change(poses, -off_centre(poses)))


class Record(Meet):
    """Compares with the best so far."""

    best = -100.0

    def reward(self, poses):
        value = super().reward(poses)
        self.best = max(self.best, float(value.max()))
        return value - self.best


def shifts(poses, value):
    poses[..., :2] -= poses[..., :2].mean(-2, keepdim=True)
    return value


def facing(poses, value):
    return value - (poses[..., 0, 2] - poses[..., 1, 2]).abs()


def cosine(poses, value):
    return value + 0.01 * (poses[..., 0, 2] - poses[..., 1, 2]).cos()


ONLY = Meet()


def one_for_all(robots):
    return ONLY


def refuses(robots):
    raise ConfigError("for six robots and more")


TASKS = [
    ("no steps", task(sustain_steps=0), "sustain-steps", "is 0; it must be 1 or more"),
    ("steps in seconds", task(sustain_steps=1.0), "sustain-steps", "is 1.0"),
    ("negative radius", task(radius=-1.0), "radius", "radius is -1.0"),
    ("reward a column", reward(lambda poses, value: value[..., None]), "shape", "reward() has shape (4, 1)"),
    ("reward a robot", reward(lambda poses, value: -poses[..., 0].abs()), "shape", "not (4,), (episodes,)"),
    ("one number", reward(lambda poses, value: value.sum()), "shape", "reward() has shape (), not (4,)"),
    ("a float", reward(lambda poses, value: float(value.sum())), "shape", "returned float, not a tensor"),
    ("two dimensions alone", reward(lambda poses, value: -poses[:, 0, :2].norm(dim=-1)), "shape",
     "reward() of poses (2, 2, 3, 2, 3)"),
    ("double", reward(lambda poses, value: value.double()), "dtype", "reward() has type torch.float64"),
    ("contact in numbers", success(lambda poses, velocities: off_centre(poses)), "dtype",
     "success(poses) has type torch.float32"),
    ("logarithm", reward(lambda poses, value: -(-value).log()), "not-finite", "with all robots in one place"),
    ("moves the poses", reward(shifts), "mutates-input", "reward() changed what it was given"),
    ("best so far", Record(), "not-repeatable", "reward() answers the same question otherwise"),
    ("breaks ties at random", reward(lambda poses, value: value + 0.1 * torch.rand_like(value)), "global-rng",
     "reward() drew from the global generator of torch"),
    ("normalised over the batch", reward(lambda poses, value: value - value.mean()), "batch",
     "reward() answers"),
    ("the same for all", reward(lambda poses, value: torch.zeros_like(value)), "reward-constant",
     "is 0 for each of 1024"),
    ("the wrong sign", reward(lambda poses, value: -value), "reward-misleads", "where success() is false"),
    ("another objective", reward(lambda poses, value: -(off_centre(poses) - 4).abs()), "reward-misleads",
     "leads to"),
    ("success anywhere", success(at_rest), "success-without-contact", "holds at rest for"),
    ("no success", success(contact_only), "never-succeeds", "is false at rest for all of"),
    ("success at speed", success(lambda poses, velocities: off_centre(poses) < 1.0), "success-driving",
     "fulfilled team poses at 1 to 2 m/s"),
    ("angles not wrapped", reward(facing), "heading-wrap", "when robot 0's heading is turned by 2 pi"),
    ("headings needed", reward(cosine), "nan-heading", "is NaN for 64 of 64 poses without headings"),
    ("a reward a time", task(trajectory_reward=lambda self, poses: self.reward(poses)), "shape",
     "trajectory_reward() has shape (4, 5), not (4,)"),
    ("targets of all alike", task(targets=lambda self, goals, poses: goals), "shape",
     "targets() has shape (4, 2)"),
    ("targets without headings", task(targets=lambda self, goals, poses: poses[..., :2]), "shape",
     "not (4, 2, 3), (episodes, robots, [x, y, heading])"),
    ("targets nowhere", task(targets=lambda self, goals, poses: poses + torch.nan), "not-finite",
     "targets()"),
    ("success raises", success(lambda poses, velocities: poses[:, 7, 0] > 0), "raises",
     "success(poses) raised IndexError"),
    ("wants every team", refuses, "build", "refuses every team that was tried: for six robots and more"),
    ("no robots asked for", lambda: Meet(), "signature",
     "does not take (robots: Sequence[RobotSpec]) -> Task"),
    ("a class of its own", lambda robots: object(), "kind", "which is no Task"),
    ("one for all", one_for_all, "shared-object", "the same object"),
]  # fmt: skip

WORLD = World(name="room", bounds=(-5, -5, 5, 5), boxes=(Box(center=(2.5, 2.5), size=(1.0, 0.6)),))


def world(**changes):
    return dataclasses.replace(WORLD, **changes)


def boxes(rng):
    """Make a room of its seed."""
    x, y = rng.uniform(-3, 3, 2).tolist()
    return world(boxes=(Box(center=(x, y), size=(0.5, 0.5)),))


counter = itertools.count()


def at(x):
    return world(cylinders=(Cylinder(center=(float(x), 0.0), radius=0.2),))


def by_numpy(rng):
    return at(np.random.uniform(-2, 2))  # noqa: NPY002  # the fault


def unlucky(rng):
    if rng.uniform() < 0.95:
        raise ValueError("cannot place the sofa")
    return WORLD


WORLDS = [
    ("numpy's generator", by_numpy, "global-rng", "generator of numpy"),
    ("torch's generator", lambda rng: at(torch.rand(1)), "global-rng", "generator of torch"),
    ("a counter", lambda rng: at(next(counter) / 100), "world-seed", "made two worlds of one seed"),
    ("a slash in its name", world(name="my/room"), "world-name", "is 'my/room'"),
    ("a box outside", world(boxes=(Box(center=(9.0, 0.0), size=(1, 1)),)), "bounds", "all of it outside of"),
    ("in millimetres", world(bounds=(-5000, -5000, 5000, 5000)), "bounds", "span 10000 m; the most is 200 m"),
    ("a doorstep", world(boxes=(Box(center=(2.5, 0.0), size=(1, 1), height=0.1),)), "unseen-obstacle",
     "is 0.10 m high; the lidar looks at"),
    ("full of furniture", world(boxes=(Box(center=(0.0, 0.0), size=(9.5, 9.5)),)), "no-room",
     "finds no room"),
    ("starts too far apart", world(spawn=SpawnRule(distance=30.0)), "no-room", "30.0 m apart"),
    ("one start", world(spawn=SpawnRule(poses=((0.0, 0.0, 0.0),))), "no-room", "has 1 starts for 2 robots"),
    ("no generator asked for", lambda: WORLD, "signature", "does not take (rng: numpy.random.Generator)"),
    ("boxes alone", lambda rng: WORLD.boxes, "kind", "which is no World"),
    ("mostly raises", unlucky, "build", "ValueError: cannot place the sofa"),
    ("infinite", lambda rng: world(bounds=(0.0, 0.0, math.inf, 1.0)), "build", "must be finite"),
]  # fmt: skip


@pytest.mark.parametrize(("wrong", "plugin", "rule", "words"), TASKS, ids=[case[0] for case in TASKS])
def test_broken_tasks_are_caught(wrong, plugin, rule, words, caught):
    caught(check_task, plugin, rule, words)


@pytest.mark.parametrize(("wrong", "plugin", "rule", "words"), WORLDS, ids=[case[0] for case in WORLDS])
def test_broken_worlds_are_caught(wrong, plugin, rule, words, caught):
    caught(check_world, plugin, rule, words)


@pytest.mark.parametrize("plugin", [Meet(), lambda robots: Meet()], ids=["object", "factory"])
def test_the_unbroken_task_is_fine(plugin):
    check_task(plugin)


def test_a_task_in_motion_may_succeed_at_speed():
    check_task(task(success=lambda self, poses, velocities=None: off_centre(poses) < 1.0, halts=False))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("met", r"success\(poses\)"), ("done", r"success\(poses, velocities\)"), ("places", "targets"),
        ("parking", "targets"), ("stances", "targets"), ("settling", r"terminal\(poses\)"),
    ],
)  # fmt: skip
def test_members_of_earlier_versions_are_named(old, new):
    with pytest.raises(ConfigError, match=f"task Changed: '{old}' is now {new}"):
        task(**{old: lambda self, poses: poses})


def test_a_task_may_ask_for_more_robots():
    def trio(robots):
        if len(robots) < 3:
            raise ConfigError("needs three robots")
        return Meet()

    check_task(trio)


@pytest.mark.parametrize("plugin", [WORLD, lambda rng: WORLD, boxes], ids=["object", "constant", "generator"])
def test_the_unbroken_world_is_fine(plugin):
    check_world(plugin)


def test_world_files_are_checked(tmp_path):
    file = tmp_path / "room.yaml"
    file.write_text("bounds: [-5, -5, 5, 5]\n")
    check_world(file)
    check_world(str(file))


def test_a_start_that_touches_is_caught(caught, fetch):
    # the grid of free space forgives 5 cm
    start = world(spawn=SpawnRule(poses=((-4.75, 0.0, 0.0), (0.0, 0.0, 0.0)), clearance=0.0))
    wide = dataclasses.replace(fetch, footprint_radius=0.27)
    caught(check_world, start, "start-touches", "where it touches something at once", robots=[wide, wide])


def test_every_rule_has_a_fault(rules_of):
    cases = {rule for _, _, rule, _ in TASKS + WORLDS} | {"start-touches"}
    assert rules_of(testing.task, testing.world) <= cases
