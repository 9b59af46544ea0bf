"""Random worlds: the same world each time, harder as told, and always with room to drive."""

from __future__ import annotations

import hashlib
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from hpp_framework.core.world import Box, World, box_corners
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import ConfigError
from hpp_framework.worlds.generators.barn import FILL_RATIOS, barn, build, crossable, field, level, may_cross
from hpp_framework.worlds.generators.corridors import corridors
from hpp_framework.worlds.generators.legs import legs
from hpp_framework.worlds.generators.mixed import SHARES, furnished, mixed
from hpp_framework.worlds.generators.passages import passages
from hpp_framework.worlds.generators.recipe import fill_cells, generate, span
from hpp_framework.worlds.generators.rooms import rooms
from hpp_framework.worlds.generators.training import Furniture, training
from hpp_framework.worlds.occupancy import free_space
from hpp_framework.worlds.pool import build_pool
from hpp_framework.worlds.spawn import spawn_poses

KINDS = {
    "furnished": furnished,
    "rooms": rooms,
    "corridors": corridors,
    "passages": passages,
    "legs": legs,
    "barn": barn,
    "mixed": mixed,
}
LEVELS = (0.0, 0.35, 0.7, 1.0)
SEEDS = range(8)
each_kind = pytest.mark.parametrize("kind", KINDS)


def _rng(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


@cache
def _world(kind: str, difficulty: float, seed: int) -> World:
    return KINDS[kind](_rng(seed), difficulty=difficulty)


@pytest.mark.parametrize(
    ("seed", "furniture", "digest", "next_number"),
    [
        (0, None, "65bb2d4fb4913681", 2334604164),
        (1, None, "b03b6e6b06290883", 267789403),
        (5001, None, "4f3f2e7430c65922", 345683198),
        (3, Furniture(side=12.0, pieces=(5, 9), keep_free=1.0), "892655abb73aa659", 367860371),
    ],
)
def test_the_training_room_never_changes(seed, furniture, digest, next_number):
    rng = _rng(seed)
    world = training(rng, furniture)
    # recorded before worlds had people
    told = repr(world).replace("people=(), moving=(), ", "")
    assert hashlib.sha256(told.encode()).hexdigest()[:16] == digest
    assert rng.integers(2**32) == next_number


@each_kind
def test_a_state_of_the_generator_gives_one_world(kind):
    first, second = _rng(1), _rng(1)
    world = KINDS[kind](first)
    assert world == KINDS[kind](second)
    assert first.integers(2**32) == second.integers(2**32)
    assert world != KINDS[kind](_rng(2))


@each_kind
@pytest.mark.parametrize("difficulty", [-0.1, 1.5, float("nan")])
def test_a_difficulty_out_of_range_is_refused(kind, difficulty):
    with pytest.raises(ConfigError, match=r"from 0 \(easy\) to 1 \(hard\)"):
        KINDS[kind](_rng(0), difficulty=difficulty)


@each_kind
def test_harder_worlds_leave_less_free_space(kind):
    shares = []
    for difficulty in LEVELS:
        spaces = [
            free_space(_world(kind, difficulty, seed), body_height=1.1, resolution=0.1) for seed in SEEDS
        ]
        shares.append(np.mean([(space.distance > 0.3377).mean() for space in spaces]))
    assert np.all(np.diff(shares) < -0.005), shares


@each_kind
@pytest.mark.parametrize("difficulty", LEVELS)
def test_goals_five_metres_away_can_be_reached(kind, difficulty):
    for seed in SEEDS:
        world = _world(kind, difficulty, seed)
        clearance = 0.05 if world.name == "barn" else 0.15
        space = free_space(world, body_height=1.1, resolution=0.1)
        points = space.sample(space.largest_region(0.2877 + clearance), 256, _rng(seed))
        apart = np.linalg.norm(points[:128] - points[128:], axis=-1)
        assert (apart > 5.0).mean() > 0.05, (kind, difficulty, seed)


@each_kind
def test_a_robot_can_go_everywhere_it_fits(kind):
    for seed in SEEDS:
        world = _world(kind, 1.0, seed)
        space = free_space(world, body_height=1.1, resolution=0.025)
        areas = np.bincount(space.regions(0.2877 + 0.05).ravel())[1:]
        least = 0.85 if world.name in ("barn", "training") else 0.98
        assert areas.max() / areas.sum() > least, (kind, seed)


@each_kind
@pytest.mark.parametrize("difficulty", [0.0, 1.0])
def test_a_team_finds_room_to_start(kind, difficulty, fetch, freight):
    for seed in SEEDS:
        poses = spawn_poses(_world(kind, difficulty, seed), [fetch, freight], _rng(seed))
        assert np.hypot(*(poses[0] - poses[1])[:2]) > 4.99


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "furnished"])
def test_pools_are_built_from_registered_names(kind, fetch):
    pool = build_pool(kind, 3, [fetch], seed=5001, clearance=0.05)
    assert len(set(pool.worlds)) == 3
    assert hub().worlds.entry(kind).summary


def test_legs_of_different_pieces_keep_their_distance():
    for difficulty in LEVELS:
        for seed in SEEDS:
            world = _world("legs", difficulty, seed)
            centers = np.array([leg.center for leg in world.cylinders])
            radii = np.array([leg.radius for leg in world.cylinders])
            piece = np.arange(len(radii)) // 4
            gaps = np.linalg.norm(centers[:, None] - centers[None], axis=-1) - radii[:, None] - radii
            assert gaps[piece[:, None] != piece].min() >= 0.6
            assert gaps[~np.eye(len(radii), dtype=bool)].min() > 0.25
            assert len(radii) % 4 == 0
            assert 0.02 <= radii.min() <= radii.max() <= 0.05


def test_passages_have_the_width_they_should():
    for difficulty, low, high in ((0.0, 1.4, 1.4), (0.5, 1.075, 1.13), (1.0, 0.75, 0.79)):
        for seed in SEEDS:
            gaps = _wall_gaps(_world("passages", difficulty, seed))
            assert len(gaps) > 0
            assert low - 1e-9 <= min(gaps) <= max(gaps) <= high + 1e-9, (difficulty, gaps)


def _wall_gaps(world: World) -> list[float]:
    """Return the openings between boxes that stand in one line across the world."""
    gaps = []
    for axis in (0, 1):
        lines = {box.center[axis] for box in world.boxes}
        for line in lines:
            parts = sorted(
                (box.center[1 - axis] - box.size[1 - axis] / 2, box.center[1 - axis] + box.size[1 - axis] / 2)
                for box in world.boxes
                if box.center[axis] == line
            )
            gaps += [after[0] - before[1] for before, after in pairwise(parts)]
    return gaps


def test_corridors_are_as_narrow_as_told():
    for difficulty, narrowest, widest in ((0.0, 2.5, 2.5), (0.5, 1.7, 2.38), (1.0, 0.9, 1.26)):
        edges = []
        for seed in SEEDS:
            world = _world("corridors", difficulty, seed)
            # the width of a corridor along the bounds, or more where the block beside it has an alcove
            inner = box_corners(world.boxes).reshape(-1, 2) - np.array(world.bounds[:2])
            edges += [across[across > 1e-6].min() for across in inner.T]
        assert min(edges) >= narrowest - 1e-6
        assert np.mean(np.array(edges) <= widest + 1e-6) > 0.7


def test_barn_fields_follow_the_automaton():
    filled = np.mean([[field(_rng(seed), ratio, 0).mean() for seed in range(40)] for ratio in FILL_RATIOS], 1)
    inside = (filled * 900 - 60) / 840
    assert np.allclose(inside, FILL_RATIOS, atol=0.01)
    before, after = field(_rng(0), 0.25, 2), field(_rng(0), 0.25, 3)
    for row, column in np.ndindex(30, 30):
        around = [
            (i < 0 or i > 29) or (0 <= j <= 29 and before[i, j])
            for i in range(row - 1, row + 2)
            for j in range(column - 1, column + 2)
            if (i, j) != (row, column)
        ]
        count = sum(around)
        assert after[row, column] == (count >= 5 or (before[row, column] and count > 1))


def test_barn_has_four_levels_in_order():
    assert [level(difficulty) for difficulty in (0.0, 0.24, 0.25, 0.5, 0.75, 1.0)] == [0, 0, 1, 2, 3, 3]
    solid = []
    for difficulty in (0.1, 0.3, 0.6, 0.9):
        worlds = [_world("barn", difficulty, seed) for seed in SEEDS]
        solid.append(np.mean([sum(np.prod(box.size) for box in world.boxes) for world in worlds]) / 25)
    assert np.all(np.diff(solid) > 0.02), solid


@pytest.mark.parametrize("difficulty", [0.1, 0.3, 0.6, 0.9])
def test_barn_fields_can_be_crossed(difficulty):
    for seed in SEEDS:
        world = _world("barn", difficulty, seed)
        space = free_space(world, body_height=1.1, resolution=0.05)
        labels = space.regions(0.2877 + 0.05)
        ends = np.intersect1d(labels[:, :40], labels[:, -40:])
        assert (ends > 0).any()


def test_the_quick_look_at_a_barn_field_turns_no_good_one_away():
    crossed = 0
    for seed in range(40):
        cells = field(_rng(seed), 0.22, 3)
        if crossable(build(cells)):
            crossed += 1
            assert may_cross(cells)
    assert 5 < crossed < 40


def test_a_walled_off_barn_field_is_seen():
    cells = np.zeros((30, 30), bool)
    assert may_cross(cells)
    assert crossable(build(cells))
    cells[:, 15] = True
    assert not may_cross(cells)
    assert not crossable(build(cells))
    cells[10:14, 15] = False  # 0.67 m: a few millimetres too narrow
    assert not crossable(build(cells))
    cells[9:15, 15] = False  # 1 m
    assert may_cross(cells)
    assert crossable(build(cells))


def test_boxes_cover_just_the_filled_cells():
    edges = np.linspace(-2.5, 2.5, 31)
    cells = field(_rng(3), 0.3, 2)
    boxes = fill_cells(cells, edges, edges)
    centers = (edges[1:] + edges[:-1]) / 2
    covered = np.zeros((30, 30), int)
    for box in boxes:
        in_x = np.abs(centers - box.center[0]) < box.size[0] / 2
        in_y = np.abs(centers - box.center[1]) < box.size[1] / 2
        covered += np.outer(in_y, in_x)
    assert np.array_equal(covered, cells)
    assert len(boxes) < cells.sum() / 2


def test_the_mixture_holds_all_kinds_in_their_shares():
    assert sum(SHARES.values()) == pytest.approx(1.0)
    names = [mixed(_rng(seed), difficulty=0.2).name for seed in range(80)]
    for kind, share in SHARES.items():
        found = names.count("training" if kind == "furnished" else kind) / 80
        assert abs(found - share) < 0.12, (kind, found)
    sides = [w.bounds[2] * 2 for w in (furnished(_rng(seed), difficulty=0.5) for seed in range(20))]
    assert 10 <= min(sides) < 12.5
    assert 17.5 < max(sides) <= 20


def test_worlds_without_room_are_drawn_again_and_in_the_end_refused():
    full = World(name="full", boxes=(Box(center=(0, 0), size=(19, 19)),))
    empty = World(name="empty")
    assert span(full, 0.15) == 0
    assert 18.5 < span(World(name="hall", bounds=(0, 0, 20, 2)), 0.15) < 19.2
    worlds = iter([full, full, empty])
    assert generate(lambda rng, difficulty: next(worlds), _rng(0), 0.5) is empty
    with pytest.raises(ConfigError, match="'full'.*Use a lower difficulty"):
        generate(lambda rng, difficulty: full, _rng(0), 0.5)
