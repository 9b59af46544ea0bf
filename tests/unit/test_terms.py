"""Terms by hand-computed numbers, and tasks composed of them."""

from __future__ import annotations

import math

import pytest
import torch
from hpp_tasks.rendezvous import Rendezvous
from hpp_tasks.terms.distances import Between, Gather, Spaced, Spread
from hpp_tasks.terms.formation import Form, Formation
from hpp_tasks.terms.headings import Facing
from hpp_tasks.terms.leaders import Caught, Escort, pursuers
from hpp_tasks.terms.places import Coverage, Region
from hpp_tasks.terms.shapes import line, ring
from hypothesis import given, settings
from hypothesis import strategies as st

from hpp_framework.core.composition import ComposedTask, Limit, Rules, Weighed
from hpp_framework.core.requirement import AllOf, AnyOf, Apart, Gathering
from hpp_framework.utils.errors import ConfigError

NUMBERS = st.floats(-5, 5, width=32)
TEAMS = st.integers(2, 4).flatmap(
    lambda n: st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS), min_size=n, max_size=n)
)


def team(*poses: tuple[float, ...]) -> torch.Tensor:
    return torch.tensor([[(*pose, 0.0)[:3] for pose in poses]])


def places_of(term, goals, poses):
    """Return where robots are sent, who may look anywhere there."""
    targets = term.targets(goals, poses)
    assert bool(targets[..., 2].isnan().all())
    return targets[..., :2]


def test_spread_is_what_eq_1_sums():
    poses = team((0, 0), (3, 0), (0, 4))
    assert Spread().errors(poses).tolist() == [[3.0, 4.0, 5.0]]
    composed = ComposedTask([Weighed(Spread(), 2.0)], [Limit(Gather(0.5))])
    assert composed.reward(poses).tolist() == Rendezvous(0.5).reward(poses).tolist() == [-24.0]
    near = team((0, 0), (0.6, 0))
    assert composed.reward(near).tolist() == Rendezvous(0.5).reward(near).tolist() == [0.0]


def test_gather_counts_beyond_its_radius():
    assert Gather(1.0).errors(team((-3, 0), (3, 0))).tolist() == [[2.0, 2.0]]
    assert Gather(1.0).requirement(0.5) == Gathering(1.5)


def test_distances_are_too_near_or_too_far():
    term = Between([(0, 1), (0, 2)], [1.0, 2.0], 3.0)
    assert term.errors(team((0, 0), (0.25, 0), (0, 5))).tolist() == [[0.75, 2.0]]
    apart = Apart(0, 1, 0.5), Apart(0, 2, 1.5)
    assert term.requirement(0.5) == AllOf((*apart, Gathering(1.75, (0, 1)), Gathering(1.75, (0, 2))))


def test_spaced_robots_go_out_to_a_ring_in_the_order_in_which_they_stand():
    term = Spaced([4.0] * 3, math.inf, 3)
    poses = team((0, 1), (-1, -1), (1, -1))
    (places,) = places_of(term, torch.tensor([[5.0, 0.0]]), poses)
    sides = (places - places.roll(1, 0)).norm(dim=-1).tolist()
    assert sides == pytest.approx([4.5] * 3, abs=1e-4)
    assert term.errors(torch.cat([places, torch.zeros(3, 1)], -1)[None]).max() == 0
    assert places[0, 1] > 0
    assert places[1, 0] < 5 < places[2, 0]


def test_an_escort_stands_around_where_its_leader_goes():
    term = Escort(3, 1, 1.0, 3.0)
    poses = team((2, 0), (0, 0), (0, -9))
    assert term.errors(poses).tolist() == [[0.0, 6.0]]
    (places,) = places_of(term, torch.tensor([[10.0, 10.0]]), poses)
    assert places[1].tolist() == [10.0, 10.0]
    # opposite each other, and turned towards where both come from
    assert (places[0] - places[2]).norm().item() == pytest.approx(4.0)
    assert (places[0] - 10)[1] > 0 > (places[2] - 10)[1]
    lone = places_of(Escort(2, 0, 1.0, 3.0), torch.tensor([[5.0, 0.0]]), team((0, 0), (0, 7)))
    assert lone[0, 1].tolist() == pytest.approx([5.0, 2.0], abs=1e-5)


def test_the_nearest_pursuer_counts():
    term = Caught(pursuers(3, 2, 1.0))
    assert term.errors(team((4, 0), (0, 2), (0, 0))).tolist() == [[1.0]]
    assert isinstance(term.requirement(0.0), AnyOf)


def test_two_that_must_face_each_other_come_to_both_sides_of_the_goal():
    term = Facing(0, 2, apart=1.0)
    poses = torch.tensor([[(-4.0, 0.0, 0.0), (9.0, 9.0, 0.0), (4.0, 0.0, 0.0)]])
    (targets,) = term.targets(torch.tensor([[1.0, 5.0]]), poses)
    assert targets[:, :2].flatten().tolist() == pytest.approx([-0.3, 5, 9, 9, 2.3, 5])
    assert targets[:, 2].isnan().tolist() == [True, False, True]
    assert not bool(term.terminal(poses).now)


def test_two_that_are_near_turn_to_each_other_from_about_where_they_are():
    term = Facing(0, 2, apart=1.0, slack=0.2)
    poses = torch.tensor([[(-1.0, 0.0, 2.0), (9.0, 9.0, 0.5), (1.0, 0.0, 1.0)]])
    terminal = term.terminal(poses)
    assert bool(terminal.now)
    assert terminal.middle.tolist() == [[0.0, 0.0]]
    (targets,) = term.targets(terminal.middle, poses)
    assert targets[:, :2].flatten().tolist() == pytest.approx([-0.6, 0, 9, 9, 0.6, 0])
    assert targets[:, 2].abs().tolist() == pytest.approx([0, 0.5, math.pi])
    # within the slack they stay, too near they make room
    for gap, kept in ((1.1, 1.1), (0.5, 0.8)):
        poses[0, 0, 0], poses[0, 2, 0] = -gap / 2, gap / 2
        (targets,) = term.targets(torch.zeros(1, 2), poses)
        assert float(targets[2, 0] - targets[0, 0]) == pytest.approx(kept)


def test_region_is_a_disc():
    term = Region([1], (3.0, 0.0), 1.0)
    assert term.errors(team((9, 9), (3, 4))).tolist() == [[3.0]]
    assert term.requirement(0.5) == Gathering(1.5, (1,), (3.0, 0.0))


def test_coverage_asks_for_the_nearest_robot():
    term = Coverage(torch.tensor([[0.0, 0.0], [4.0, 0.0]]), 1.0)
    assert term.errors(team((0, 0.5), (4, 3))).tolist() == [[0.0, 2.0]]


def test_facing_is_mutual_and_unknown_headings_count_as_right():
    quarter = math.pi / 2
    poses = torch.tensor([[(0.0, 0.0, 0.0), (2.0, 0.0, quarter), (9.0, 9.0, 0.0)]])
    assert Facing(0, 1).errors(poses)[0].tolist() == pytest.approx([0.0, quarter])
    poses[..., 2] = math.nan
    assert Facing(0, 1).errors(poses).tolist() == [[0.0, 0.0]]


def test_a_row_in_its_places_has_no_error_wherever_it_is():
    term = Formation(Form(line(3, 1.2)))
    assert term.errors(team((5.2, 2), (4, 2), (6.4, 2))).abs().max() < 1e-6
    # one robot 0.3 m above its place moves the centre by 0.1 m
    off = term.errors(team((-1.2, 0), (0, 0.3), (1.2, 0)))[0].tolist()
    assert off == pytest.approx([0.1, 0.2, 0.1], abs=1e-6)


def test_fixed_roles_and_turns():
    swapped, upright = team((1, 0), (-1, 0)), team((0, -1), (0, 1))
    fixed = Formation(Form(line(2, 2.0), nearest=False))
    assert fixed.errors(swapped)[0].tolist() == pytest.approx([2.0, 2.0])
    assert Formation(Form(line(2, 2.0))).errors(swapped).max() < 1e-6
    assert fixed.errors(upright)[0].tolist() == pytest.approx([math.sqrt(2)] * 2)
    assert Formation(Form(line(2, 2.0), nearest=False, turn=True)).errors(upright).max() < 1e-6


def test_neighbours_on_a_ring_are_spaced():
    places = ring(5, 1.2)
    assert (places - places.roll(1, 0)).norm(dim=-1).tolist() == pytest.approx([1.2] * 5)
    assert ring(1, 1.2).tolist() == [[0.0, 0.0]]


def test_robots_go_to_the_places_that_cost_least():
    term = Formation(Form(line(3, 2.0)))
    poses = team((3, 1), (-3, 0), (0.5, 0))
    goals = torch.tensor([[[10.0, 0.0], [0.0, -4.0]]])
    expected = [[(12, 0), (8, 0), (10, 0)], [(2, -4), (-2, -4), (0, -4)]]
    assert torch.equal(places_of(term, goals, poses[:, None]), torch.tensor([expected]).float())


def test_more_robots_than_orders_are_tried_for_take_the_nearest_places_too(torch_rng):
    term = Formation(Form(ring(7, 1.2)))
    shuffled = ring(7, 1.2)[torch.randperm(7, generator=torch_rng)]
    poses = torch.cat([shuffled + 3, torch.zeros(7, 1)], -1)[None, None]
    assert term.errors(poses).max() < 1e-5


@settings(max_examples=30, deadline=None)
@given(TEAMS, st.tuples(NUMBERS, NUMBERS), st.randoms(use_true_random=False), st.booleans())
def test_formation_errors_ignore_moves_and_who_is_who(poses, shift, random, turn):
    term = Formation(Form(line(len(poses), 1.2), turn=turn))
    here = torch.tensor([poses])
    moved = here + torch.tensor([*shift, 0.0])
    order = random.sample(range(len(poses)), len(poses))
    total = term.errors(here).square().sum(-1)
    # equally good roles may share an error out otherwise; its squares always sum to the same
    assert term.errors(moved).square().sum(-1).allclose(total, atol=1e-2)
    assert term.errors(here[:, order]).square().sum(-1).allclose(total, atol=1e-2)


@settings(max_examples=30, deadline=None)
@given(TEAMS, st.floats(-3, 3, width=32))
def test_a_formation_that_may_turn_ignores_turns_and_fits_at_least_as_well(poses, angle):
    here, spun = torch.tensor([poses]), torch.tensor([poses])
    cos, sin = math.cos(angle), math.sin(angle)
    spun[..., :2] = here[..., :2] @ torch.tensor([[cos, sin], [-sin, cos]])
    shape = line(len(poses), 1.2)
    term = Formation(Form(shape, turn=True))
    total = term.errors(here).square().sum(-1)
    assert term.errors(spun).square().sum(-1).allclose(total, atol=1e-2)
    assert (total <= Formation(Form(shape)).errors(here).square().sum(-1) + 1e-3).all()


@settings(max_examples=30, deadline=None)
@given(TEAMS, st.booleans(), st.booleans())
def test_robots_of_a_formation_are_near_its_centre(poses, nearest, turn):
    term = Formation(Form(line(len(poses), 1.2), nearest=nearest, turn=turn))
    here = torch.tensor([poses])
    required = term.requirement(float(term.errors(here).max()))
    assert Gather(required.radius).errors(here).max() < 1e-4


def test_rest_counts_only_where_it_is_asked_for():
    rewards, success = [Weighed(Spread())], [Limit(Gather(1.0))]
    poses, velocities = team((0, 0), (1, 0)), torch.tensor([[[0.5, 0.0], [0.0, 0.0]]])
    assert ComposedTask(rewards, success).success(poses, velocities).tolist() == [False]
    moving = ComposedTask(rewards, success, Rules(rest_speed=None, halts=False))
    assert moving.success(poses, velocities).tolist() == [True]
    assert not moving.halts


def test_targets_and_requirements_of_parts_are_those_of_the_task():
    formation, spread = Formation(Form(line(2, 2.0))), Spread()
    task = ComposedTask([Weighed(spread), Weighed(formation)], [Limit(Gather(1.0))])
    poses, goal = team((0, 0), (1, 0)), torch.zeros(1, 2)
    assert torch.equal(places_of(task, goal, poses), places_of(formation, goal, poses))
    assert task.requirement() == AllOf((Gathering(1.0),))
    alone = ComposedTask([Weighed(spread)], [Limit(spread, 1.0)])
    assert alone.targets(goal, poses) is None
    assert alone.requirement() is None


def test_a_task_needs_something_to_pay_for_and_to_judge():
    with pytest.raises(ConfigError, match="at least one term"):
        ComposedTask([Weighed(Spread())], [])
