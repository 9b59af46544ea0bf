"""The least time of a task: no team beats it, and it is not far from achievable times."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from hpp_framework.core.requirement import AllOf, AnyOf, Apart, Gathering
from hpp_framework.core.task import Task
from hpp_framework.core.world import Box, World
from hpp_framework.evaluation.path_bounds import least_lengths, least_time
from hpp_framework.evaluation.task_bounds import task_bounds
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import hub
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.seeding import numpy_rng
from hpp_framework.worlds.generators.training import training
from hpp_framework.worlds.loader import resolve_world
from hpp_framework.worlds.occupancy import free_space
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


def test_a_long_thick_wall_takes_longer_than_none(team, task):
    poses = [[-2.5, 0, 0], [2.5, 0, math.pi]]
    free = bound(team, task, room(), poses)
    thin = bound(team, task, room(Box(center=(0, 0), size=(0.1, 5))), poses)
    thick = bound(team, task, room(Box(center=(0, 0), size=(2.0, 5))), poses)
    # across a thin wall robots are near enough
    assert free <= thin < thick


def test_robots_that_are_near_across_a_wall_need_not_drive_around_it(team, task):
    """The place they are near to may lie inside the wall."""
    poses = [[-2.5, 0, 0], [2.5, 0, math.pi]]
    most = 2 * task.radius - sum(robot.footprint_radius for robot in team.robots)
    across = bound(team, task, room(Box(center=(0, 0), size=(most - 0.01, 5))), poses)
    around = bound(team, task, room(Box(center=(0, 0), size=(most + 0.5, 5))), poses)
    least = least_time(2.5 - most / 2 - team.robots[0].footprint_radius, team.robots[0].drive)
    assert across <= math.ceil(least / PERIOD) * PERIOD + 4 * PERIOD + 1e-6
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


class Wanted(Task):
    """Requires something and is nothing else."""

    def __init__(self, wanted):
        self.wanted = wanted

    def requirement(self):
        return self.wanted

    def reward(self, poses):
        raise AssertionError

    success = reward


def test_distances_grow_no_faster_than_both_robots_drive(team):
    poses = [[0, 0, 0], [5, 0, 0]]
    # both together cover 2 m while each covers 1 m: sqrt(2 / 0.4) s
    expected = math.ceil(math.sqrt(2 / 0.4) / PERIOD) * PERIOD + 4 * PERIOD
    for wanted in (
        Apart(0, 1, least=7.0), AnyOf((Apart(0, 1, least=30.0), Apart(0, 1, least=7.0))),
        AllOf((Apart(0, 1, 7.0), Apart(0, 1, 6.0))),
    ):  # fmt: skip
        assert bound(team, Wanted(wanted), room(), poses) == pytest.approx(expected)
    assert bound(team, Wanted(Apart(0, 1, least=4.0)), room(), poses) == pytest.approx(5 * PERIOD)
    assert math.isinf(bound(team, Wanted(AnyOf(())), room(), poses))


def test_a_given_place_is_reached_around_obstacles(team):
    there = Wanted(Gathering(0.5, (0,), (3.0, 0.0)))
    ahead = bound(team, there, room(), [[0, 0, 0], [-3, 0, 0]])
    least = math.ceil(least_time(2.5, team.robots[0].drive) / PERIOD) * PERIOD + 4 * PERIOD
    assert least - PERIOD <= ahead + 1e-6 <= least + 2e-6
    wall = room(Box(center=(1.5, 0), size=(0.4, 5)))
    assert ahead + 1 < bound(team, there, wall, [[0, 0, 0], [-3, 0, 0]])


def test_only_those_who_meet_count(team):
    pair = Wanted(Gathering(0.5, (0, 1)))
    trio = parse_team("fetch,freight,fetch")
    poses = [[-2, 0, 0], [2, 0, math.pi]]
    assert bound(trio, pair, room(), [*poses, [3, 3, 0]]) == bound(team, pair, room(), poses)


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


def test_teams_farther_apart_than_what_is_looked_at_first_have_the_same_kind_of_bound(team):
    """Across 36 m each drives 18 m, and the slower robot's share does not hide the faster one's."""
    hall = World(name="hall", bounds=(-20, -4, 20, 4))
    found = bound(team, Wanted(Gathering(0.5)), hall, [[-18, 0, 0], [18, 0, 0]])
    least = math.ceil(least_time(17.5, team.robots[0].drive) / PERIOD) * PERIOD + 4 * PERIOD
    assert least - 2 * PERIOD <= found + 1e-6 <= least + 2e-6


@pytest.mark.parametrize("degrees", [0, 7, 22.5, 31, 45])
@pytest.mark.parametrize("spare", [0.0005, 0.02, 0.08])
def test_no_length_on_the_grid_is_longer_than_that_of_a_corridor(degrees, spare):
    """The grid is coarsest where a corridor just fits and runs across it."""
    radius, angle, middle = 0.2877, math.radians(degrees), np.array([0.013, 0.021])
    along, across = (np.array([math.cos(a), math.sin(a)]) for a in (angle, angle + math.pi / 2))
    sides = [tuple((middle + sign * (radius + spare + 1) * across).tolist()) for sign in (1, -1)]
    boxes = tuple(Box(center=side, size=(9.0, 2.0), yaw=angle) for side in sides)
    world = World(name="corridor", bounds=(-6, -6, 6, 6), boxes=boxes)
    space = free_space(world, body_height=1.0)
    lengths = least_lengths(space, radius, middle - 4 * along)
    for true in np.linspace(0.5, 8, 16):
        column, row = ((middle + (true - 4) * along - np.array(space.origin)) / space.resolution).astype(int)
        assert true - 0.15 - 0.03 * true < lengths[row, column] <= true
