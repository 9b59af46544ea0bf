"""What is in the way, and whether two robots see each other."""

from __future__ import annotations

import math

import pytest
import torch

from hpp_framework.core.world import Box, World
from hpp_framework.perception.visibility import GAP, all_in_view, in_the_way

EMPTY = World(name="room")
WALL = World(name="wall", boxes=(Box(center=(0.0, 0.0), size=(0.2, 3.0)),))
FAR_FROM_EACH_OTHER = [[-4.0, -0.5, 0.3], [4.0, 0.5, -2.8]]


@pytest.mark.parametrize(
    ("point", "blocks"),
    [
        ((1.0, 0.0), True),
        ((1.0, 0.3 + GAP - 0.01), True),
        ((1.0, 0.3 + GAP + 0.01), False),
        ((-0.1, 0.0), False),
        ((2.0 + 0.3, 0.0), True),
        ((2.0 + 0.3 + GAP + 0.01, 0.0), False),
    ],
)
def test_what_lies_within_the_width_of_the_way_is_in_the_way(point, blocks):
    pose, end = torch.tensor([[0.0, 0.0, 1.0]]), torch.tensor([[2.0, 0.0]])
    points = torch.tensor([[point]])
    assert bool(in_the_way(pose, end, points, torch.tensor([[True]]), 0.3)) is blocks
    assert not bool(in_the_way(pose, end, points, torch.tensor([[False]]), 0.3))


@pytest.mark.parametrize("agent", [0, 1])
def test_both_know_whether_they_see_each_other(pair, begun, agent):
    for world, expected in ((EMPTY, True), (WALL, False)):
        seen = begun(pair, [world], [FAR_FROM_EACH_OTHER]).observe(agent)
        assert bool(all_in_view(seen, pair)) is expected


@pytest.mark.parametrize("agent", [0, 1])
@pytest.mark.parametrize("away", [0, 1])
def test_one_that_looks_away_sees_no_other(pair, begun, agent, away):
    starts = [list(each) for each in FAR_FROM_EACH_OTHER]
    starts[away][2] += math.pi
    assert not bool(all_in_view(begun(pair, [EMPTY], [starts]).observe(agent), pair))


@pytest.mark.parametrize("agent", [0, 1, 2])
@pytest.mark.parametrize(("third", "expected"), [([0.0, 3.5, -1.6], True), ([0.0, 3.5, 1.6], False)])
def test_of_three_all_must_see_each_other(pair, begun, agent, third, expected):
    team = (*pair, pair[0])
    starts = [[-4.0, -0.5, 0.3], [4.0, 0.5, -2.8], third]
    seen = begun(team, [EMPTY], [starts]).observe(agent)
    assert bool(all_in_view(seen, team)) is expected
