"""RRT baselines: paths on hand-made maps, what happens without one, waypoints, imagined motion."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest
import torch

from hpp_framework.config.planner_choice import make_planner
from hpp_framework.core.planner import PlannerContext
from hpp_framework.core.robot import Lidar
from hpp_framework.core.world import Box, World
from hpp_framework.episodes.core import EpisodeBatch
from hpp_framework.planning.baselines.rrt import ALGORITHMS, TreeConfig, find_path, grow_tree
from hpp_framework.planning.baselines.rrt_cem import RrtCemConfig
from hpp_framework.planning.baselines.rrt_map import Room, room_for, seen_points, seen_spaces
from hpp_framework.planning.baselines.rrt_path import SPACING, padded, resampled
from hpp_framework.planning.baselines.rrt_planner import RrtConfig
from hpp_framework.planning.baselines.rrt_predictor import MotionConfig, RrtPredictor
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import hub
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.errors import ConfigError, HppError
from hpp_framework.utils.seeding import EpisodeRng
from hpp_framework.worlds.occupancy import FreeSpace, free_space

WEST, EAST = np.array([-3.0, 0.0]), np.array([3.0, 0.0])
SHORTEST = 2 * np.hypot(2.5, 4.0) + 1.0
BOUNDS = (-10.0, -10.0, 10.0, 10.0)


def halls(closed: bool = False) -> Room:
    """20 x 20 m at 0.1 m with a wall of 1 x 8 m in the middle, or from end to end."""
    slack = np.ones((200, 200), np.float32)
    slack[slice(None) if closed else slice(60, 140), 95:105] = -0.5
    return Room(slack, (-10.0, -10.0), 0.1)


def length(path):
    return float(np.linalg.norm(np.diff(path, axis=0), axis=-1).sum())


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_paths_lead_around_the_wall(algorithm):
    room = halls()
    path = find_path(room, WEST, EAST, TreeConfig(algorithm=algorithm, iterations=600), 1)
    assert path is not None
    np.testing.assert_allclose(path[[0, -1]], [WEST, EAST], atol=1e-9)
    points = resampled(path)
    assert room.fits(points).mean() > 0.97
    assert SHORTEST - 0.2 < length(path) < 1.15 * SHORTEST


def test_a_plain_tree_is_longer_than_a_simplified_one():
    plain = find_path(halls(), WEST, EAST, TreeConfig(tries=1, simplify=False), 1)
    best = find_path(halls(), WEST, EAST, TreeConfig(tries=3), 1)
    assert plain is not None
    assert best is not None
    assert length(best) < length(plain)


def test_no_way_is_no_path_and_half_a_way_neither():
    """OMPL calls a tree that came near a solution; we do not."""
    few = TreeConfig(tries=2, iterations=200)
    assert find_path(halls(closed=True), WEST, EAST, few, 1) is None
    assert find_path(halls(), WEST, np.array([0.0, 0.0]), few, 1) is None
    assert find_path(halls(), WEST, EAST, TreeConfig(tries=1, iterations=3), 1) is None


def test_the_seed_alone_decides_whatever_was_drawn_before():
    first = find_path(halls(), WEST, EAST, TreeConfig(), 7)
    grow_tree(halls(), WEST, TreeConfig(iterations=50), 3)
    again = find_path(halls(), WEST, EAST, TreeConfig(), 7)
    other = find_path(halls(), WEST, EAST, TreeConfig(), 8)
    assert first is not None
    assert other is not None
    np.testing.assert_array_equal(first, again)
    assert first.shape != other.shape or not np.array_equal(first, other)


def test_a_tree_hangs_together_and_covers_the_room():
    tree = grow_tree(halls(), WEST, TreeConfig(iterations=800), 2)
    roots = tree.parents == np.arange(len(tree.parents))
    assert roots.sum() == 1
    np.testing.assert_allclose(tree.points[roots], [WEST])
    assert (np.linalg.norm(tree.points - tree.points[tree.parents], axis=-1) <= 1.0 + 1e-9).all()
    assert (np.linalg.norm(tree.points - EAST, axis=-1) < 1.5).any()
    assert halls().passes(tree.points[tree.parents], tree.points).mean() > 0.98


def test_straight_lines_are_looked_at_from_end_to_end():
    room = halls()
    ends = np.array([EAST, [-3.0, 5.0], [0.0, 0.0], [-30.0, 0.0]])
    np.testing.assert_array_equal(room.passes(WEST, ends), [False, True, False, False])


def test_the_nearest_place_that_can_be_reached():
    room = halls(closed=True)
    around = room.around(WEST)
    inside = around.nearest(np.array([-0.2, 1.0]))
    beyond = around.nearest(EAST)
    np.testing.assert_allclose(inside, [-0.55, 1.0], atol=0.06)
    np.testing.assert_allclose(beyond, [-0.55, 0.0], atol=0.06)
    np.testing.assert_array_equal(around.nearest(WEST), WEST)
    assert Room(-np.ones((4, 4), np.float32), (0.0, 0.0), 0.1).nearest(WEST) is None


def test_resampled_paths_keep_their_ends_and_their_spacing():
    path = resampled(np.array([[0.0, 0.0], [0.0, 0.35], [1.0, 0.35]]))
    np.testing.assert_allclose(path[[0, -1]], [[0, 0], [1, 0.35]])
    assert np.linalg.norm(np.diff(path, axis=0), axis=-1).max() <= SPACING + 1e-9
    assert padded([path, path[:1]]).shape == (2, len(path), 2)
    assert len(resampled(np.zeros((3, 2)))) == 1


WORLD = World(name="one-wall", bounds=BOUNDS, boxes=(Box(center=(0.0, 0.0), size=(0.6, 4.0)),))


def sensed(team, world=WORLD, starts=((-2.5, 0.0, 0.0), (2.5, 0.0, 3.14)), steps=2):
    batch = EpisodeBatch(BatchSimulator(team.robots, threads=1))
    batch.begin([world] * 2, torch.tensor([starts] * 2), range(2))
    for _ in range(steps):
        batch.step(torch.zeros(2, len(team), 2))
    return batch


@pytest.fixture(scope="module")
def team():
    return parse_team("fetch,freight", skill="pure-pursuit")


def make(team, text, agent=0, preset="best"):
    task = hub().tasks.create("rendezvous", team.robots)
    return make_planner(text, PlannerContext(team=team, agent=agent, task=task, preset=preset))


def rng(seed=0):
    return EpisodeRng([seed, seed + 1])


def test_the_map_of_the_lidar_agrees_with_the_world_where_it_looked(team):
    seen = seen_spaces(sensed(team).observe(0), team.robots[0].lidar, BOUNDS)[0]
    known = free_space(WORLD, body_height=1.0)
    in_front = np.array([[-0.6, 0.0], [-1.0, 1.0], [-1.5, 0.0]])
    np.testing.assert_allclose(seen.at(in_front), known.at(in_front), atol=0.12)
    behind = np.array([[1.2, 0.0]])
    assert known.at(behind) < 1.0
    assert seen.at(behind) > 1.2, "the unseen back of the wall counts as free"


def test_other_robots_are_no_obstacles(team):
    open_world = World(name="open", bounds=BOUNDS, walled=False)
    observation = sensed(team, open_world).observe(0)
    assert bool((observation.scan < team.robots[0].lidar.max_range - 0.1).any()), "it sees its mate"
    assert not bool(seen_points(observation, team.robots[0].lidar)[1].any())


@pytest.mark.parametrize("text", ["rrt-mp", "rrt-oa", "rrt-cem"])
def test_paths_avoid_what_was_seen(team, text):
    observation = sensed(team).observe(0)
    planner = make(team, text)
    decision = planner.plan(observation, None, rng())
    room = room_for(planner.spaces(observation)[0], team.robots[0].footprint_radius)
    assert room.fits(decision.belief.path[0].double().numpy()).all()
    away = (decision.goal - observation.pose[:, :2]).norm(dim=-1)
    assert (away < planner.config.look_ahead + 0.2).all()


def test_a_goal_in_the_wall_moves_or_stays_without_a_path(team):
    """The midpoint is inside the wall: ``snap`` goes beside it, the paper's preset straight for it."""
    observation = sensed(team).observe(0)
    moved = make(team, "rrt-mp").plan(observation, None, rng())
    assert moved.belief.path.shape[1] > 1
    plain = make(team, "rrt-mp:margin=0.3", preset="paper")
    first = plain.plan(observation, None, rng())
    assert torch.equal(first.goal, observation.team_poses[..., :2].mean(1))
    following = plain.plan(observation, first.belief, rng())
    assert torch.equal(following.goal, first.goal)


def test_without_a_path_the_rest_of_the_old_one_is_kept(team, monkeypatch):
    planner = make(team, "rrt-oa")
    observation = sensed(team).observe(0)
    belief = planner.plan(observation, None, rng()).belief
    belief = replace(belief, progress=torch.tensor([4, 0]))
    monkeypatch.setattr(planner, "route", lambda *_: None)
    kept = planner.plan(observation, belief, rng()).belief
    torch.testing.assert_close(kept.path[0, 0], belief.path[0, 4])
    torch.testing.assert_close(kept.path[:, -1], belief.path[:, -1])


def test_way_points_move_along_the_path_and_never_back(team):
    planner = make(team, "rrt-oa")
    observation = sensed(team).observe(0)
    decision = planner.plan(observation, None, rng())
    for index in (5, 12, 8):
        poses = observation.poses.clone()
        poses[:, -1, 0, :2] = decision.belief.path[:, index]
        before = decision.belief.progress
        decision = planner.follow(replace(observation, poses=poses), decision)
        assert (decision.belief.progress >= before).all()
    belief = decision.belief
    assert (belief.progress - 12).abs().max() <= 1
    expected = belief.path[0, min(int(belief.progress[0]) + 20, belief.path.shape[1] - 1)]
    torch.testing.assert_close(decision.goal[0], expected)


def test_a_robot_that_starts_too_near_to_a_wall_leaves_it(team):
    space = free_space(WORLD, body_height=1.0)
    start = np.array([-0.3 - team.robots[0].footprint_radius - 0.02, 0.0])
    path = make(team, "rrt-oa").route(space, start, EAST, 1)
    assert path is not None
    np.testing.assert_array_equal(path[0], start)
    assert space.at(path[1][None])[0] > team.robots[0].footprint_radius + 0.05


def test_nowhere_to_stand_is_no_path(team):
    space = FreeSpace(np.zeros((20, 20), np.float32), (-10.0, -10.0), 1.0)
    assert make(team, "rrt-oa").route(space, WEST, EAST, 1) is None


def test_the_true_map_is_for_those_who_are_shown_it(team):
    with pytest.raises(ConfigError, match="known_map"):
        make(team, "rrt-mp:known_map=true").plan(sensed(team).observe(0), None, rng())


@pytest.mark.parametrize(
    "text", ["rrt-mp", "rrt-oa:known_map=true", "rrt-cem:motion.samples=100:cem.iterations=3"]
)
@pytest.mark.parametrize("names", ["fetch,freight", "freight,fetch,freight"])
def test_same_seed_same_episodes(play, text, names):
    """Whole episodes, any number of robots, whatever OMPL did in between."""
    team = parse_team(names, skill="pure-pursuit")
    task = hub().tasks.create("rendezvous", team.robots)
    starts = torch.tensor([[[-2.5, 0.0, 0.0], [2.5, 0.0, 3.0], [0.0, 4.5, -1.5]][: len(team)]] * 2)

    def run():
        return play(team, task, [WORLD] * 2, starts, text, seeds=(4, 5), steps=12)

    first, second = run(), run()
    assert torch.equal(first.poses, second.poses)
    assert torch.equal(first.goals, second.goals)


def predictor(team, room_space, samples=400):
    made = RrtPredictor(team.robots, 0.1, MotionConfig(samples=samples))
    made.prepare([room_space] * 2, [1, 2])
    return made


def test_imagined_robots_drive_around_the_wall(team):
    space = free_space(WORLD, body_height=1.0)
    observation = sensed(team).observe(0)
    goals = torch.tensor([[[2.5, 0.0], [-2.5, 3.0]]] * 2)
    imagined = predictor(team, space).rollout(observation, goals, 20)
    places = imagined.poses[..., 0, :2]
    fits = room_for(space, team.robots[0].footprint_radius).fits(places.double().numpy())
    assert fits.all()
    torch.testing.assert_close(places[:, :, -1], goals, atol=0.05, rtol=0)
    steps = places.diff(dim=2).norm(dim=-1)
    assert (steps <= 0.7 + 1e-4).all()
    straight = places[:, 1, :4, 1]
    torch.testing.assert_close(straight[0], torch.tensor([0.2, 0.7875, 1.4875, 2.1875]), atol=0.05, rtol=0)


def test_a_goal_that_cannot_be_reached_is_approached(team):
    closed = World(name="closed", bounds=BOUNDS, boxes=(Box(center=(0.0, 0.0), size=(0.6, 20.0)),))
    space = free_space(closed, body_height=1.0)
    observation = sensed(team, closed).observe(0)
    goals = torch.tensor([[[2.5, 0.0]]] * 2)
    last = predictor(team, space).rollout(observation, goals, 20).poses[:, 0, -1, 0]
    assert (last[:, 0] < -0.3).all()
    assert (last[:, 0] > -2.5).all()


def test_the_predictor_must_be_prepared(team):
    with pytest.raises(ConfigError, match="prepare"):
        RrtPredictor(team.robots, 0.1, MotionConfig()).rollout(
            sensed(team).observe(0), torch.zeros(2, 1, 2), 3
        )


def test_without_ompl_the_error_says_how_to_get_it(team, monkeypatch):
    monkeypatch.setitem(sys.modules, "ompl", None)
    with pytest.raises(ConfigError, match=r"pip install hpp-framework\[planning\]"):
        make(team, "rrt-mp")


@pytest.mark.parametrize(
    ("kind", "wrong"),
    [
        (TreeConfig, {"algorithm": "rrt-conect"}), (TreeConfig, {"iterations": 0}),
        (TreeConfig, {"tries": 0}),
        (TreeConfig, {"step": 0.0}), (TreeConfig, {"goal_bias": 1.5}), (RrtConfig, {"margin": -0.1}),
        (RrtConfig, {"look_ahead": 0.0}), (RrtConfig, {"plan_every": 0}), (MotionConfig, {"speed": 0.0}),
        (MotionConfig, {"period": 0.0}), (RrtCemConfig, {"terminal": 1.5}),
        (RrtCemConfig, {"least_std": 0.0}), (RrtCemConfig, {"horizon": 0}),
    ],
)  # fmt: skip
def test_unusable_parameters_are_refused(kind, wrong):
    with pytest.raises(HppError):
        kind(**wrong)


def test_every_lidar_will_do(team):
    """A lidar of few beams with another mount: nothing here knows the bundled ones."""
    lidar = Lidar(
        beams=9, field_of_view=3.0, mount=(0.4, 0.0, 0.0), height=0.3, min_range=0.05, max_range=5.0,
        noise_std=0.0,
    )  # fmt: skip
    observation = sensed(team).observe(0)
    few = replace(observation, scans=observation.scans[..., :9].clamp(max=5.0), keyframes=None)
    assert seen_points(few, lidar)[0].shape == (2, 9, 2)
