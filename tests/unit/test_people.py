"""People and moving obstacles in the batch simulator."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from hpp_framework.core.types import State
from hpp_framework.core.world import Box, MovingObstacle, Person, World
from hpp_framework.envs.episode import EpisodeConfig, TeamEpisode
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.seeding import numpy_rng
from hpp_framework.worlds.loader import resolve_world
from hpp_framework.worlds.occupancy import free_space
from hpp_framework.worlds.people import populate

SKIN = 2e-3
AHEAD = slice(110, 112)
"""The beams along the heading of a robot."""
AWAY = (-8.0, -8.0, 0.0)


def room(*people: Person, **more) -> World:
    return World(name="room", people=people, **more)


def walks(x: float, y: float, *waypoints: tuple[float, float], **more) -> Person:
    return Person(start=(x, y), waypoints=waypoints, speed=1.2, **more)


def stands(x: float, y: float) -> Person:
    return Person(start=(x, y), speed=0.0)


def states(robots, world: World, poses, command=(0.0, 0.0), steps: int = 50) -> list[State]:
    with BatchSimulator(robots) as simulator:
        found = [simulator.reset([world], torch.tensor([poses], dtype=torch.float32))]
        commands = torch.tensor([[command] * len(robots)])
        return [*found, *(simulator.step(commands) for _ in range(steps))]


def places(found: list[State]) -> np.ndarray:
    """Return x and y (t, p, 2) of all people over time."""
    return np.stack([state.people.poses[0, :, :2].numpy() for state in found])


def test_a_person_walks_its_route_at_its_speed_and_stops(fetch):
    found = states([fetch], room(walks(0, 0, (3, 0), (3, 3), loop=False)), [AWAY], steps=60)
    path = places(found)[:, 0]
    speeds = np.hypot(*np.diff(path, axis=0).T) / 0.2
    assert np.median(speeds[5:20]) == pytest.approx(1.2, rel=0.05)
    assert path[-1] == pytest.approx((3, 3), abs=0.06)
    assert found[-1].people.velocities[0, 0].norm() < 0.02
    assert np.hypot(*(path - (3, 0)).T).min() < 0.45


def test_a_round_goes_on(fetch):
    path = places(states([fetch], room(walks(0, 0, (2, 0))), [AWAY], steps=100))[:, 0]
    turns = np.diff(np.sign(np.diff(path[:, 0])))
    assert (turns != 0).sum() >= 4


def test_two_people_pass_each_other(fetch):
    world = room(walks(-3, 0, (3, 0), loop=False), walks(3, 0, (-3, 0), loop=False))
    path = places(states([fetch], world, [AWAY], steps=50))
    gaps = np.hypot(*(path[:, 0] - path[:, 1]).T)
    assert gaps.min() > 0.5 - SKIN
    assert path[-1, 0] == pytest.approx((3, 0), abs=0.1)
    assert path[-1, 1] == pytest.approx((-3, 0), abs=0.1)


def test_a_person_walks_around_a_robot_that_stands(fetch):
    found = states([fetch], room(walks(-3, 0, (3, 0), loop=False)), [(0.0, 0.0, 0.0)])
    path = places(found)[:, 0]
    assert np.hypot(*path.T).min() > 0.25 + fetch.footprint_radius - SKIN
    assert path[-1] == pytest.approx((3, 0), abs=0.1)
    assert not any(bool(state.touched_person.any()) for state in found)
    assert found[-1].poses[0, 0].tolist() == [0.0, 0.0, 0.0]


def test_a_robot_that_drives_into_a_person_is_blocked_and_told(fetch):
    found = states([fetch], room(stands(2, 0)), [(0.0, 0.0, 0.0)], command=(0.8, 0.0), steps=40)
    reach = 2.0 - 0.25 - fetch.footprint_radius
    assert found[-1].poses[0, 0, 0].item() == pytest.approx(reach, abs=SKIN)
    touched = [bool(state.touched_person[0, 0]) for state in found]
    near = [state.poses[0, 0, 0].item() > reach - 0.2 for state in found]
    assert any(touched)
    assert not any(t and not n for t, n in zip(touched, near, strict=True))
    assert not any(bool(state.touched_obstacle.any()) for state in found)
    assert any(bool(state.collided[0, 0]) for state in found)
    assert found[-1].people.poses[0, 0, :2].tolist() == [2.0, 0.0]


def test_a_lidar_sees_a_person_at_its_radius_and_not_above_its_head(fetch):
    seen = states([fetch], room(stands(3, 0)), [(0.0, 0.0, 0.0)], steps=0)[0]
    expected = 3.0 - 0.25 - fetch.lidar.mount[0]
    np.testing.assert_allclose(seen.scans[0, 0, AHEAD], expected, atol=2e-3)
    low = room(Person(start=(3, 0), speed=0.0, height=fetch.lidar.height / 2))
    over = states([fetch], low, [(0.0, 0.0, 0.0)], steps=0)[0]
    assert over.scans[0, 0, AHEAD].min() > 5


def test_what_is_nearer_hides_a_person(fetch):
    wall = Box(center=(1.5, 0.0), size=(0.2, 4.0))
    seen = states([fetch], room(stands(3, 0), boxes=(wall,)), [(0.0, 0.0, 0.0)], steps=0)[0]
    np.testing.assert_allclose(seen.scans[0, 0, AHEAD], 1.4 - fetch.lidar.mount[0], atol=2e-3)


def test_a_door_opens_and_closes_on_time(fetch):
    door = MovingObstacle(size=(0.1, 1.0), path=((0, 2, 0), (2, 2, 0), (3, 2, 2), (5, 2, 2), (6, 2, 0)))
    found = states([fetch], room(moving=(door,)), [(0.0, 0.0, 0.0)], steps=35)
    ahead = [state.scans[0, 0, AHEAD].min().item() for state in found]
    closed = 2 - 0.05 - fetch.lidar.mount[0]
    for step, distance in enumerate(ahead):
        time = step * 0.2
        if time <= 2 or time >= 6:
            assert distance == pytest.approx(closed, abs=2e-3), time
        if 3 <= time <= 5:
            assert distance > 5, time


def test_a_closed_door_blocks_and_an_open_one_lets_through(fetch):
    walls = tuple(Box(center=(2.0, y), size=(0.1, 9.2)) for y in (-5.2, 5.2))
    for path, passes in ((((0, 2, 0),), False), (((0, 2, 0), (1, 2, 2)), True)):
        door = MovingObstacle(size=(0.1, 1.3), path=path)
        found = states([fetch], room(boxes=walls, moving=(door,)), [(0.0, 0.0, 0.0)], (0.6, 0.0), 40)
        assert (found[-1].poses[0, 0, 0].item() > 3) == passes
        assert any(bool(state.touched_obstacle.any()) for state in found) != passes


def test_a_person_before_a_closed_door_waits_and_turns_back(fetch):
    walls = tuple(Box(center=(2.0, y), size=(0.1, 9.2), height=2.0) for y in (-5.2, 5.2))
    door = MovingObstacle(size=(0.1, 1.3), path=((0, 2, 0),))
    world = room(walks(0, 0, (4, 0), loop=False), boxes=walls, moving=(door,))
    path = places(states([fetch], world, [AWAY], steps=75))[:, 0]
    assert path[:, 0].max() < 2.0 - 0.05 - 0.25 + SKIN
    assert path[50:, 0].min() < 1.0


def test_a_cylinder_moves_on_its_timetable_for_ever(fetch):
    drum = MovingObstacle(radius=0.3, path=((0, 2, 0), (1, 3, 0), (2, 2, 0)), loop=True)
    found = states([fetch], room(moving=(drum,)), [(0.0, 0.0, 0.0)], steps=20)
    for step, state in enumerate(found):
        x = 2 + abs((step * 0.2 + 1) % 2 - 1)
        assert drum.at(step * 0.2)[0] == pytest.approx(x)
        ahead = state.scans[0, 0, AHEAD]
        np.testing.assert_allclose(ahead, x - 0.3 - fetch.lidar.mount[0], atol=3e-3)


def test_an_episode_runs_the_same_alone_and_in_any_batch(fetch, freight):
    robots = [fetch, freight]
    rng = numpy_rng(3, "batch")
    worlds, starts = [], []
    for index, name in enumerate(["crowd:people=8", "navigation", "corridor-crowd", "simple"] * 20):
        world = resolve_world(name)(rng)
        spots = free_space(world, body_height=1.1)
        points = spots.sample(spots.largest_region(0.5), 2, rng)
        pose = np.column_stack([points, rng.uniform(-math.pi, math.pi, 2)])
        more = 3 if name == "navigation" else 0
        worlds.append(populate(world, robots, pose, numpy_rng(index, "people"), more=more))
        starts.append(torch.tensor(pose, dtype=torch.float32))
    commands = torch.rand(len(worlds), 2, 2, generator=torch.Generator().manual_seed(0))

    def run(chosen: list[int], threads: int) -> State:
        with BatchSimulator(robots, threads=threads) as simulator:
            simulator.reset([worlds[i] for i in chosen], torch.stack([starts[i] for i in chosen]))
            for _ in range(25):
                state = simulator.step(commands[chosen])
        return state

    together = run(list(range(len(worlds))), threads=2)
    for i in (0, 1, 2, 3, 41):
        alone = run([i], threads=1)
        for name in ("poses", "velocities", "scans", "touched_obstacle", "touched_robot"):
            assert torch.equal(getattr(together, name)[i], getattr(alone, name)[0]), name
        if worlds[i].people:
            count = len(worlds[i].people)
            assert torch.equal(together.touched_person[i], alone.touched_person[0])
            assert torch.equal(together.people.poses[i, :count], alone.people.poses[0])
            assert together.people.poses[i, count:].isnan().all()
        else:
            assert alone.people is None


def test_episodes_that_begin_anew_begin_with_their_people(fetch):
    world = room(walks(0, 0, (3, 0)))
    simulator = BatchSimulator([fetch])
    simulator.load([world], episodes=2)
    index, both = torch.zeros(2, dtype=torch.int32), torch.ones(2, 1, dtype=torch.bool)
    poses = torch.tensor([[AWAY], [AWAY]])
    simulator.place(index, both, poses)
    for _ in range(5):
        state = simulator.step(torch.zeros(2, 1, 2))
    again = simulator.place(index, torch.tensor([[True], [False]]), poses)
    assert again.people.poses[0, 0, 0] == 0
    assert torch.equal(again.people.poses[1], state.people.poses[1])
    assert again.people.time.tolist() == [0, 20]
    resumed = simulator.place(index, both, poses, people=state.people)
    assert torch.equal(resumed.people.poses, state.people.poses)


def test_populate_draws_the_same_people_for_a_seed_and_keeps_off_robots(fetch):
    world = resolve_world("navigation")(np.random.default_rng(0))
    start = np.array([[0.0, 0.0, 0.0]])
    first, again, other = (populate(world, [fetch], start, numpy_rng(s), more=10) for s in (1, 1, 2))
    assert first == again != other
    assert first.at_rest() == world
    begin = np.array([person.start for person in first.people])
    assert np.hypot(*begin.T).min() >= 1.0 + fetch.footprint_radius + 0.25
    for person in first.people:
        assert person.settled
        assert 0.7 <= person.speed <= 1.9
        assert len(person.waypoints) > 1
    assert populate(first, [fetch], start, numpy_rng(5)) is first


def test_a_goal_is_walked_to_around_obstacles(fetch):
    wall = Box(center=(0.0, 0.0), size=(0.2, 8.0), height=2.0)
    world = World(name="walled", boxes=(wall,), people=(Person(start=(-2, 0), goal=(2, 0), speed=1.3),))
    found = states([fetch], world, [AWAY], steps=90)
    path = places(found)[:, 0]
    assert np.abs(path[:, 1]).max() > 4
    assert path[-1] == pytest.approx((2, 0), abs=0.1)


def test_no_room_for_a_person_is_an_error():
    full = World(name="full", bounds=(0, 0, 2, 2), boxes=(Box(center=(1, 1), size=(1.9, 1.9), height=2.0),))
    with pytest.raises(ConfigError, match="no place where a person"):
        populate(full, (), np.zeros((0, 2)), numpy_rng(0), more=1)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"size": (1, 1), "radius": 1, "path": ((0, 0, 0),)}, "either 'size'"),
        ({"radius": 1, "path": ((1, 0, 0), (1, 2, 0))}, "increasing times"),
        ({"radius": 1, "path": ()}, "increasing times"),
    ],
)
def test_a_moving_obstacle_says_what_is_wrong(wrong, message):
    with pytest.raises(ConfigError, match=message):
        MovingObstacle(**wrong)


def test_a_world_without_people_says_nothing_of_them(fetch):
    state = states([fetch], World(name="empty"), [AWAY], steps=1)[-1]
    assert state.people is None
    assert state.touched_person is None


@pytest.mark.parametrize("name", ["crowd", "corridor-crowd"])
def test_crowds_take_a_number_of_people_and_refuse_others(name):
    assert len(resolve_world(name)(numpy_rng(0)).people) == 5
    drawn = resolve_world(f"{name}:people=12")(numpy_rng(0))
    assert len(drawn.people) == 12
    assert drawn == resolve_world(f"{name}:people=12")(numpy_rng(0)) != resolve_world(name)(numpy_rng(1))
    for text, message in (
        (":peple=1", "'peple' is no setting"),
        (":people=999", "from 0 to 100"),
        (":people=x", "whole"),
    ):
        with pytest.raises(ConfigError, match=message):
            resolve_world(name + text)(numpy_rng(0))


def test_an_environment_has_other_people_each_seed_and_the_same_again():
    episode = TeamEpisode("fetch,freight", "crowd", EpisodeConfig())
    starts = []
    for seed in (1, 2, 1):
        episode.reset(seed)
        starts.append(episode.state.people.poses.clone())
        episode.step(np.zeros((2, 2), np.float32))
        assert episode.draw(np.full((2, 2), np.nan)).shape == (480, 480, 3)
    assert torch.equal(starts[0], starts[2])
    assert not torch.equal(starts[0], starts[1])
    episode.close()
