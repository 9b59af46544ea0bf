"""Shortest ways: exact in the open, around corners, none where there is none."""

import math

import numpy as np
import pytest
import torch

from hpp_framework.core.world import Box, World
from hpp_framework.utils.errors import ConfigError
from hpp_framework.worlds.geodesic import comfortable_ways, shortest_ways
from hpp_framework.worlds.occupancy import free_space

RADIUS = 0.2877
WALL = World(name="wall", bounds=(-5, -5, 5, 5), boxes=(Box(center=(0, -1.0), size=(0.2, 8.0)),))
CELL = World(name="cell", bounds=(-5, -5, 5, 5), boxes=(Box(center=(0, 0), size=(0.2, 12.0)),))
OPEN = World(name="open", bounds=(-5, -4, 5, 4))


def field(world, goal, *, comfort=None, resolution=0.05):
    spaces = [free_space(world, body_height=1.1, resolution=resolution)]
    goals, of = torch.tensor([goal]), torch.zeros(1, dtype=torch.int64)
    if comfort:
        return comfortable_ways(spaces, RADIUS, comfort, goals, of)
    return shortest_ways(spaces, RADIUS, goals, of)


def ways(fields, points):
    return fields.at(torch.zeros(len(points), dtype=torch.int64), torch.tensor(points))


def test_in_the_open_ways_are_straight_lines():
    rng = np.random.default_rng(0)
    points = rng.uniform((-4.5, -3.5), (4.5, 3.5), (50, 2)).astype(np.float32)
    straight = np.hypot(*(points - [1.03, -2.4]).T)
    assert np.allclose(ways(field(OPEN, [1.03, -2.4]), points.tolist()), straight, atol=0.01)
    swept = ways(field(OPEN, [1.03, -2.4], comfort=0.01), points.tolist()).numpy()
    assert (swept > straight - 0.01).all()
    assert (swept < straight * 1.04 + 0.05).all()


def test_around_a_corner_the_way_bends_at_the_inflated_corner():
    measured = float(ways(field(WALL, [-2.0, 0.0]), [[2.0, 0.0]])[0])
    # two tangents to the circle around each of the two corners of the wall's end, and the way across it
    to_corner = math.hypot(1.9, 3.0)
    tangent = math.sqrt(to_corner**2 - RADIUS**2)
    bend = math.atan2(3.0, 1.9) + math.asin(RADIUS / to_corner)
    expected = 2 * (tangent + RADIUS * bend) + 0.2
    assert expected - 0.15 < measured < expected + 0.05


def test_where_no_way_leads_the_length_is_infinite():
    fields = field(CELL, [-2.0, 0.0])
    assert ways(fields, [[2.0, 0.0]]).isinf().all()
    assert ways(fields, [[-2.0, 3.0]]).isfinite().all()


def test_comfort_makes_every_place_finite_and_narrow_ways_longer():
    goal = [-2.0, 0.0]
    fields = field(CELL, goal, comfort=0.4)
    assert ways(fields, [[2.0, 0.0], [0.0, 0.0], [-2.0, 3.0]]).isfinite().all()
    along_wall = [[-4.65, 4.0]]
    assert float(ways(fields, along_wall)[0]) > float(ways(field(CELL, goal), along_wall)[0])


def test_fields_of_different_worlds_do_not_mix_and_threads_do_not_matter():
    spaces = [free_space(world, body_height=1.1, resolution=0.1) for world in (WALL, OPEN)]
    goals = torch.tensor([[-2.0, 0.0], [2.0, 1.0]]).repeat(40, 1)
    of = torch.tensor([0, 1]).repeat(40)
    one, two = (shortest_ways(spaces, RADIUS, goals, of, threads=threads) for threads in (1, 2))
    assert torch.equal(one.values, two.values)
    assert one.at(torch.arange(80), goals).max() < 0.1
    alone = shortest_ways(spaces[1:], RADIUS, goals[1:2], of[:1])
    everywhere = torch.rand(30, 2) * 6 - 3
    second = torch.ones(30, dtype=torch.int64)
    assert torch.equal(one.at(second, everywhere), alone.at(second - 1, everywhere))


def test_a_goal_outside_its_world_is_refused():
    with pytest.raises(ConfigError, match="outside"):
        field(OPEN, [0.0, 4.5])
