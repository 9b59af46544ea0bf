"""The least time to a rendezvous: nobody beats it, and it is not far from what can be done."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from hpp_framework.core.requirement import AllOf, AnyOf, Apart, Displaced, Gathering, Visit
from hpp_framework.core.robot import DriveLimits
from hpp_framework.core.task import Task
from hpp_framework.core.world import Box, World
from hpp_framework.evaluation.gathering import first_met
from hpp_framework.evaluation.reach import Reach
from hpp_framework.evaluation.task_bounds import task_bounds
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import hub
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.seeding import numpy_rng
from hpp_framework.worlds.generators.training import training
from hpp_framework.worlds.loader import resolve_world
from hpp_framework.worlds.spawn import spawn_poses

PERIOD = 0.2


@pytest.fixture(scope="module")
def team():
    return parse_team("fetch,freight")


@pytest.fixture(scope="module")
def task(team):
    return hub().tasks.create("rendezvous", team.robots)


def room(*boxes: Box) -> World:
    return World(name="room", bounds=(-4, -4, 4, 4), boxes=boxes)


def bound(team, task, world, poses):
    return float(task_bounds([world], np.array([poses], np.float64), team.robots, task)[0])


def test_facing_each_other_in_the_open_it_is_the_least_time_of_a_straight_drive(team, task):
    """Both accelerate at 0.4 m/s^2 to 1 m/s on half of what separates them from a rendezvous."""
    found = bound(team, task, room(), [[-2.5, 0, 0], [2.5, 0, math.pi]])
    gap = (5 - 2 * task.radius) / 2
    rising = 1 / 0.4
    least = math.ceil((rising + (gap - rising / 2)) / PERIOD) * PERIOD + 4 * PERIOD
    assert least - PERIOD <= found + 1e-6 <= least + 2e-6


@pytest.mark.parametrize("first", [3, 4, 7, 10, 11])
def test_halving_finds_the_first_step(first):
    """From 3 to 10; 11 stands for never."""
    assert first_met(lambda step: step >= first, 3, 10) == first


def test_least_times_to_come_nearer_are_those_of_the_whole_table():
    """Looked up by halving, and with pushes from the first touch on, as when every substep is compared."""
    drive = DriveLimits(speed=(0.0, 1.0), turn_rate=1.0, acceleration=0.4, turn_acceleration=1.0)
    reach = Reach(drive)
    deviations = np.linspace(0, math.pi, 40).repeat(3)
    distances = np.tile([-0.1, 0.7, 5.0], 40)
    found = reach.approaching(distances, deviations, math.inf, 30)
    assert (found[distances < 0] == 0).all()
    assert (np.diff(found.reshape(40, 3), axis=0) >= 0).all()
    pushed = reach.approaching(distances, deviations, 0.0, 30)
    assert (pushed == reach.driving(distances, 30)).all()


def test_turning_first_takes_longer(team, task):
    ahead = bound(team, task, room(), [[-2.5, 0, 0], [2.5, 0, math.pi]])
    beside = bound(team, task, room(), [[-2.5, 0, math.pi / 2], [2.5, 0, math.pi / 2]])
    behind = bound(team, task, room(), [[-2.5, 0, math.pi], [2.5, 0, 0]])
    assert ahead <= beside < behind


def test_a_long_thick_wall_takes_longer_than_none(team, task):
    poses = [[-2.5, 0, 0], [2.5, 0, math.pi]]
    free = bound(team, task, room(), poses)
    thin = bound(team, task, room(Box(center=(0, 0), size=(0.1, 5))), poses)
    thick = bound(team, task, room(Box(center=(0, 0), size=(2.0, 5))), poses)
    # across a thin wall robots are near enough
    assert free <= thin < thick


def test_a_wall_may_be_just_too_thick_to_meet_across(team, task):
    """The grid of ways is too coarse to tell, so where robots can stand is looked at more closely."""
    poses = [[-2.5, 0, 0], [2.5, 0, math.pi]]
    most = 2 * task.radius - sum(robot.footprint_radius for robot in team.robots)
    across = bound(team, task, room(Box(center=(0, 0), size=(most - 0.01, 5))), poses)
    around = bound(team, task, room(Box(center=(0, 0), size=(most + 0.09, 5))), poses)
    assert across < around - 1


def test_robots_that_cannot_meet_never_do(team, task):
    assert math.isinf(
        bound(team, task, room(Box(center=(0, 0), size=(2.0, 8.0))), [[-3, 0, 0], [3, 0, math.pi]])
    )


def test_a_task_without_a_radius_has_no_bound(team):
    class Elsewhere(Task):
        def reward(self, poses):
            raise AssertionError

        success = reward

    found = task_bounds([room()], np.zeros((1, 2, 3)), team.robots, Elsewhere())
    assert np.isnan(found).all()


def test_distances_change_no_faster_than_robots_drive(team):
    class Row(Task):
        def __init__(self, wanted):
            self.wanted = wanted

        def requirement(self):
            return self.wanted

        def reward(self, poses):
            raise AssertionError

        success = reward

    poses = [[0, 0, 0], [5, 0, 0]]
    # both together cover 2 m in as many steps as each covers 1 m
    expected = next(step for step in range(99) if Reach(team.robots[0].drive).distance(step) >= 1.0 - 1e-9)
    for wanted in (
        Apart(0, 1, least=7.0), Apart(0, 1, most=3.0), Displaced(0, 1, (-7.5, 0.0), 0.5),
        AnyOf((Apart(0, 1, least=30.0), Apart(0, 1, least=7.0))), AllOf((Apart(0, 1, 7.0), Apart(0, 1, 6.0))),
    ):  # fmt: skip
        assert bound(team, Row(wanted), room(), poses) == pytest.approx((expected + 4) * PERIOD)
    assert math.isinf(bound(team, Row(AnyOf(())), room(), poses))


def test_a_visit_takes_turning_and_the_way_around(team):
    class Door(Task):
        def requirement(self):
            return Visit(0, (3.0, 0.0), 0.5)

        def reward(self, poses):
            raise AssertionError

        success = reward

    ahead = bound(team, Door(), room(), [[0, 0, 0], [-3, 0, 0]])
    assert ahead < bound(team, Door(), room(), [[0, 0, math.pi], [-3, 0, 0]])
    wall = room(Box(center=(1.5, 0), size=(0.4, 5)))
    assert ahead + 1 < bound(team, Door(), wall, [[0, 0, 0], [-3, 0, 0]])


def test_only_those_who_meet_count(team):
    class Pair(Task):
        def requirement(self):
            return Gathering(0.5, (0, 1))

        def reward(self, poses):
            raise AssertionError

        success = reward

    trio = parse_team("fetch,freight,fetch")
    poses = [[-2, 0, 0], [2, 0, math.pi]]
    assert bound(trio, Pair(), room(), [*poses, [3, 3, 0]]) == bound(team, Pair(), room(), poses)


def test_who_has_met_already_needs_to_stay(team, task):
    found = bound(team, task, room(), [[-0.4, 0, 0], [0.4, 0, 0]])
    assert found == pytest.approx(5 * PERIOD)


@pytest.mark.parametrize("robots", ["fetch,freight", "fetch-real,freight-real", "fetch,freight,fetch"])
def test_no_random_drive_towards_each_other_beats_the_bound(robots):
    """Brute force: many teams that turn and race, each after its own fashion, in rooms full of furniture."""
    team = parse_team(robots, skill="pure-pursuit")
    task = hub().tasks.create("rendezvous", team.robots)
    rng = numpy_rng(999, "bound")
    worlds = [training(rng) for _ in range(4)]
    starts = np.stack([spawn_poses(world, team.robots, rng) for world in worlds])
    bounds = task_bounds(worlds, starts, team.robots, task)
    tries = 200
    simulator = BatchSimulator(team.robots, threads=1)
    many = [world for world in worlds for _ in range(tries)]
    state = simulator.reset(many, torch.from_numpy(np.repeat(starts, tries, 0)).float())
    draw = torch.Generator().manual_seed(0)
    middle = state.poses[..., :2].mean(1, keepdim=True)
    goals = middle + torch.randn(len(many), 1, 2, generator=draw)
    gain = 1 + 20 * torch.rand(len(many), 1, generator=draw)
    since = torch.zeros(len(many), dtype=torch.int64)
    done = torch.full((len(many),), math.inf)
    for step in range(1, 60):
        offset = goals - state.poses[..., :2]
        error = torch.atan2(offset[..., 1], offset[..., 0]) - state.poses[..., 2]
        error = torch.remainder(error + math.pi, 2 * math.pi) - math.pi
        fast = torch.where(error.abs() < 1.2, 2.0, 0.0) * (~task.success(state.poses))[:, None]
        state = simulator.step(torch.stack([fast, gain * error], -1))
        since = torch.where(task.success(state.poses, state.velocities), since + 1, 0)
        done = torch.where((since >= task.sustain_steps) & done.isinf(), step * PERIOD, done)
    best = done.reshape(len(worlds), tries).amin(1).double().numpy()
    assert np.isfinite(best).any()
    assert (bounds <= best + 1e-6).all()


def test_the_bound_is_of_use(play, team, task):
    """In the open, the perfect goal is reached in less than twice the bound."""
    rng = numpy_rng(999, "useful")
    world = resolve_world("simple")(rng)
    starts = np.stack([spawn_poses(world, team.robots, rng) for _ in range(8)])
    bounds = task_bounds([world] * 8, starts, team.robots, task)
    episodes = play(team, task, [world] * 8, torch.from_numpy(starts).float())
    times = episodes.done_step.numpy() * PERIOD
    assert (times >= bounds - 1e-6).all()
    assert np.median(times / bounds) < 2


def test_a_robot_that_backs_up_need_not_turn():
    limits = {"turn_rate": 3.0, "acceleration": 0.4, "turn_acceleration": 1.5}
    forward = Reach(DriveLimits(speed=(0.0, 1.0), **limits))
    both = Reach(DriveLimits(speed=(-1.0, 1.0), **limits))
    distance, behind = np.array([1.0]), np.array([math.pi])
    straight = forward.driving(distance, 50)
    assert both.approaching(distance, behind, 9.0, 50) == straight
    assert forward.approaching(distance, behind, 9.0, 50) > straight
    # pushed at once, it may slide
    assert forward.approaching(distance, behind, 0.0, 50) == straight
