"""Shortest paths: exact in the open, around corners, none where there is none."""

import math

import numpy as np
import pytest
import torch

from hpp_framework.core.world import Box, World
from hpp_framework.utils.errors import ConfigError
from hpp_framework.worlds.occupancy import free_space
from hpp_framework.worlds.paths import comfortable_paths, shortest_paths

RADIUS = 0.2877
WALL = World(name="wall", bounds=(-5, -5, 5, 5), boxes=(Box(center=(0, -1.0), size=(0.2, 8.0)),))
CELL = World(name="cell", bounds=(-5, -5, 5, 5), boxes=(Box(center=(0, 0), size=(0.2, 12.0)),))
OPEN = World(name="open", bounds=(-5, -4, 5, 4))


def field(world, goal, *, comfort=None, resolution=0.05):
    spaces = [free_space(world, body_height=1.1, resolution=resolution)]
    goals, of = torch.tensor([goal]), torch.zeros(1, dtype=torch.int64)
    if comfort:
        return comfortable_paths(spaces, RADIUS, comfort, goals, of)
    return shortest_paths(spaces, RADIUS, goals, of)


def lengths(fields, points):
    return fields.at(torch.zeros(len(points), dtype=torch.int64), torch.tensor(points))


def test_in_the_open_paths_are_straight_lines():
    rng = np.random.default_rng(0)
    points = rng.uniform((-4.5, -3.5), (4.5, 3.5), (50, 2)).astype(np.float32)
    straight = np.hypot(*(points - [1.03, -2.4]).T)
    assert np.allclose(lengths(field(OPEN, [1.03, -2.4]), points.tolist()), straight, atol=0.01)
    swept = lengths(field(OPEN, [1.03, -2.4], comfort=0.01), points.tolist()).numpy()
    assert (swept > straight - 0.01).all()
    assert (swept < straight * 1.04 + 0.05).all()


def test_around_a_corner_the_path_bends_at_the_inflated_corner():
    measured = float(lengths(field(WALL, [-2.0, 0.0]), [[2.0, 0.0]])[0])
    # two tangents to the circle around each of the two corners of the wall's end, and the path across it
    to_corner = math.hypot(1.9, 3.0)
    tangent = math.sqrt(to_corner**2 - RADIUS**2)
    bend = math.atan2(3.0, 1.9) + math.asin(RADIUS / to_corner)
    expected = 2 * (tangent + RADIUS * bend) + 0.2
    assert expected - 0.15 < measured < expected + 0.05


def test_where_no_path_leads_the_length_is_infinite():
    fields = field(CELL, [-2.0, 0.0])
    assert lengths(fields, [[2.0, 0.0]]).isinf().all()
    assert lengths(fields, [[-2.0, 3.0]]).isfinite().all()


def test_comfort_makes_every_place_finite_and_narrow_paths_longer():
    goal = [-2.0, 0.0]
    fields = field(CELL, goal, comfort=0.4)
    assert lengths(fields, [[2.0, 0.0], [0.0, 0.0], [-2.0, 3.0]]).isfinite().all()
    along_wall = [[-4.65, 4.0]]
    assert float(lengths(fields, along_wall)[0]) > float(lengths(field(CELL, goal), along_wall)[0])


def test_fields_of_different_worlds_do_not_mix():
    spaces = [free_space(world, body_height=1.1, resolution=0.1) for world in (WALL, OPEN)]
    goals, of = torch.tensor([[-2.0, 0.0], [2.0, 1.0]]), torch.tensor([0, 1])
    both = shortest_paths(spaces, RADIUS, goals, of)
    assert both.at(torch.arange(2), goals).max() < 0.1
    alone = shortest_paths(spaces[1:], RADIUS, goals[1:], of[:1])
    # the second world is the smaller one; points outside read the nearest cell
    everywhere = torch.rand(30, 2) * 12 - 6
    second = torch.ones(30, dtype=torch.int64)
    assert torch.equal(both.at(second, everywhere), alone.at(second - 1, everywhere))


def test_paths_longer_than_asked_for_are_left_out_and_the_others_are_the_same():
    space, of = free_space(WALL, body_height=1.1), torch.zeros(1, dtype=torch.int64)
    goal = torch.tensor([[-2.0, 0.0]])
    every, near = (shortest_paths([space], RADIUS, goal, of, farthest=far).values for far in (0.0, 4.0))
    reached = near.isfinite()
    assert torch.equal(near[reached], every[reached])
    assert every[~reached].min() > 3.9
    assert near[reached].max() > 3.9


def test_a_goal_outside_its_world_is_refused():
    with pytest.raises(ConfigError, match="outside"):
        field(OPEN, [0.0, 4.5])
