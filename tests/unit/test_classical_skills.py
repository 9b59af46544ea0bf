"""Skills that need no training: the dynamic window approach and pure pursuit."""

from __future__ import annotations

import dataclasses
import math

import pytest
import torch
from hpp_skills.dwa.config import DwaConfig
from hpp_skills.dwa.skill import DynamicWindow
from torch import Tensor

from hpp_framework.core.disturbances import IDEAL, Disturbances
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.skill import Skill
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.core.types import Observation, State
from hpp_framework.core.world import Box, Cylinder, World
from hpp_framework.episodes.core import EpisodeBatch
from hpp_framework.plugins.registry import hub
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.errors import ConfigError

CLASSICAL = ("dwa", "pure-pursuit")
ROBOTS = ("fetch", "fetch-real", "freight", "freight-real")
OPEN = World(name="open", bounds=(-20, -20, 20, 20), walled=False)
PILLAR = dataclasses.replace(OPEN, boxes=(Box(center=(3.0, 0.1), size=(0.6, 0.6)),))
WALL = dataclasses.replace(OPEN, boxes=(Box(center=(4.5, 0.0), size=(1.0, 30.0)),))


def drive(
    skill: Skill,
    robot: RobotSpec,
    world: World,
    poses: Tensor,
    *legs: tuple[Tensor, int],
    noise: Disturbances = IDEAL,
) -> list[State]:
    """Return the states after every step; ``legs`` are goals (b, 2) and how many steps they hold."""
    states: list[State] = []
    with BatchSimulator([robot], threads=1) as simulator:
        batch = EpisodeBatch(simulator, disturbances=noise)
        batch.begin([world] * len(poses), poses[:, None], range(len(poses)))
        for goal, steps in legs:
            for _ in range(steps):
                states.append(batch.step(skill.act(batch.observe(0), goal)[:, None]))
    return states


def touched(states: list[State]) -> Tensor:
    return torch.stack([state.collided[:, 0] for state in states]).any(0)


def distances(state: State, goal: Tensor) -> Tensor:
    return (state.poses[:, 0, :2] - goal).norm(dim=1)


def at(*xy: float, count: int = 1) -> Tensor:
    return torch.tensor([xy]).expand(count, -1).contiguous()


def random_poses(count: int, low: float, high: float, seed: int) -> Tensor:
    """Return poses with x from low to high, y within 3 m of 0, any heading."""
    share = torch.rand(count, 3, generator=torch.Generator().manual_seed(seed))
    return share * torch.tensor([high - low, 6.0, 2 * math.pi]) + torch.tensor([low, -3.0, -math.pi])


def observe(scans: Tensor, velocity: Tensor, poses: Tensor | None = None, *, history: int = 1) -> Observation:
    """Return what robots see that stand at the origin, or came along the given poses (b, h, 3)."""
    if scans.dim() == 2:
        scans = scans[:, None].repeat(1, history, 1)
    if poses is None:
        poses = torch.zeros(len(scans), scans.shape[1], 3)
    return Observation(agent=0, poses=poses[:, :, None], scans=scans, velocity=velocity)


def random_observation(robot: RobotSpec, count: int, seed: int) -> tuple[Observation, Tensor]:
    """Return observations among random ranges at random speeds, and goals."""
    rng = torch.Generator().manual_seed(seed)
    low, high = robot.drive.speed
    nearest = torch.rand(count, 1, generator=rng) * 3
    scans = (nearest + 4 * torch.rand(count, robot.lidar.beams, generator=rng)).clamp(0.05, 25)
    share = torch.rand(count, 2, generator=rng)
    velocity = torch.stack(
        [low + share[:, 0] * (high - low), (2 * share[:, 1] - 1) * robot.drive.turn_rate], 1
    )
    goal = 5 * torch.randn(count, 2, generator=rng)
    goal[0] = 0.0
    return observe(scans, velocity), goal


@pytest.mark.parametrize("robot_name", ROBOTS)
@pytest.mark.parametrize("name", CLASSICAL)
def test_reaches_goals_stops_and_stays(name, robot_name):
    robot = hub().robots.create(robot_name)
    poses = random_poses(8, -2, 2, seed=2)
    goal = random_poses(8, -3, 3, seed=3)[:, :2].contiguous()
    states = drive(hub().skills.create(name, robot), robot, OPEN, poses, (goal, 120))
    assert distances(states[-1], goal).max() < 0.25
    # at rest, to stay there
    assert states[-1].velocities.abs().max() < 1e-3
    assert torch.allclose(states[-1].poses, states[-10].poses, atol=1e-3)


def test_dwa_drives_around_a_pillar_that_pure_pursuit_meets(fetch):
    start, goal = at(0.0, 0.0, 0.0), at(6.0, 0.0)
    around, into = (
        drive(hub().skills.create(name, fetch), fetch, PILLAR, start, (goal, 100)) for name in CLASSICAL
    )
    assert not bool(touched(around).any())
    assert distances(around[-1], goal).max() < 0.25
    assert bool(touched(into).all())


@pytest.mark.parametrize("robot_name", ROBOTS)
def test_what_dwa_admits_never_touches_a_wall(robot_name):
    """Goals behind a wall, after a while on the way to others: any position, heading and speed."""
    robot = hub().robots.create(robot_name)
    count = 40
    poses = random_poses(count, -1.0, 3.0, seed=4)
    anywhere = random_poses(count, -2.0, 5.0, seed=5)[:, :2].contiguous()
    behind = random_poses(count, 6.0, 9.0, seed=6)[:, :2].contiguous()
    skill = hub().skills.create("dwa", robot)
    states = drive(skill, robot, WALL, poses, (anywhere, 10), (behind, 45))
    assert not bool(touched(states).any())
    # they were in a position to
    assert states[14].velocities[:, 0, 0].max() > 0.7 * robot.drive.speed[1]
    assert torch.stack([state.poses[:, 0, 0] for state in states]).max() > 3.5


@pytest.mark.parametrize("robot_name", [entry.name for entry in hub().robots])
@pytest.mark.parametrize("name", CLASSICAL)
def test_commands_lie_in_the_drive_limits(name, robot_name):
    robot = hub().robots.create(robot_name)
    observation, goal = random_observation(robot, 500, seed=7)
    command = hub().skills.create(name, robot).act(observation, goal)
    assert command.shape == (500, 2)
    assert command[:, 0].min() >= robot.drive.speed[0]
    assert command[:, 0].max() <= robot.drive.speed[1]
    assert command[:, 1].abs().max() <= robot.drive.turn_rate
    assert command[:, 1].abs().max() > 0.5


def test_dwa_commands_what_one_period_can_reach(fetch):
    observation, goal = random_observation(fetch, 500, seed=8)
    away = goal.norm(dim=1) > 0.2
    change = (hub().skills.create("dwa", fetch).act(observation, goal) - observation.velocity)[away].abs()
    assert change[:, 0].max() <= fetch.drive.acceleration * CONTROL_PERIOD + 1e-5
    assert change[:, 1].max() <= fetch.drive.turn_acceleration * CONTROL_PERIOD + 1e-5


@pytest.mark.parametrize("name", CLASSICAL)
def test_equal_inputs_give_equal_commands(name, fetch):
    observation, goal = random_observation(fetch, 50, seed=9)
    first, second = (hub().skills.create(name, fetch).act(observation, goal) for _ in range(2))
    assert torch.equal(first, second)


@pytest.mark.parametrize("name", CLASSICAL)
def test_a_batch_equals_its_members_one_by_one(name, fetch):
    observation, goal = random_observation(fetch, 40, seed=10)
    skill = hub().skills.create(name, fetch)
    together = skill.act(observation, goal)
    for row in range(40):
        one = slice(row, row + 1)
        alone = Observation(
            agent=0,
            poses=observation.poses[one],
            scans=observation.scans[one],
            velocity=observation.velocity[one],
        )
        assert torch.equal(skill.act(alone, goal[one]), together[one])


def test_any_number_of_threads_gives_the_same_commands(fetch):
    observation, goal = random_observation(fetch, 300, seed=11)
    one, two, three = (DynamicWindow(fetch, threads=threads).act(observation, goal) for threads in (1, 2, 3))
    assert torch.equal(one, two)
    assert torch.equal(one, three)


@pytest.mark.parametrize("distance", [0.0, 0.05, 0.3, 25.0])
@pytest.mark.parametrize("name", CLASSICAL)
def test_commands_are_finite_whatever_the_lidar_reads(name, distance, fetch):
    velocity = torch.cartesian_prod(torch.tensor([0.0, 0.5, 1.0]), torch.tensor([-3.0, 0.0, 1e-4, 3.0]))
    scans = torch.full((len(velocity), fetch.lidar.beams), distance)
    for goal in ((0.0, 0.0), (3.0, 0.0), (-3.0, 0.0), (1e-3, 1e-3)):
        command = (
            hub().skills.create(name, fetch).act(observe(scans, velocity), at(*goal, count=len(velocity)))
        )
        assert bool(command.isfinite().all())


def test_dwa_brakes_and_turns_when_everything_is_close(fetch):
    """In a ring of obstacles it comes to rest and looks around for a way out, always to the same side."""
    skill = hub().skills.create("dwa", fetch)
    scans, velocity = torch.full((1, fetch.lidar.beams), 0.3), torch.tensor([[0.3, 0.0]])
    turns: list[float] = []
    for _ in range(30):
        velocity = skill.act(observe(scans, velocity), at(5.0, 1.0))
        turns.append(float(velocity[0, 1]))
    assert float(velocity[0, 0]) == 0
    assert abs(turns[-1]) > 0.3
    assert len({math.copysign(1, turn) for turn in turns[10:]}) == 1


def test_dwa_drives_around_a_wall_that_hides_the_goal(fetch):
    """Two metres of wall across the path: straight at the goal leads nowhere."""
    wall = dataclasses.replace(OPEN, boxes=(Box(center=(1.6, 0.2), size=(0.2, 2.0)),))
    goal = at(3.5, 0.2)
    states = drive(hub().skills.create("dwa", fetch), fetch, wall, at(0.0, 0.0, 0.0), (goal, 110))
    assert distances(states[-1], goal).max() < 0.25
    assert not bool(touched(states).any())


def test_dwa_remembers_what_has_left_its_view(fetch):
    """A leg that the lidar saw half a metre ago now stands beside the robot, unseen: no turning into it."""
    angles = torch.from_numpy(fetch.lidar.angles()).float()
    leg, mount = torch.tensor([0.05, 0.37]), torch.tensor(fetch.lidar.mount[:2])
    poses = torch.zeros(1, 5, 3)
    poses[0, :, 0] = torch.linspace(-0.4, 0.0, 5)
    scans = torch.full((1, 5, fetch.lidar.beams), 25.0)
    for entry in range(5):
        x, y = (leg - poses[0, entry, :2] - mount).tolist()
        near = (angles - math.atan2(y, x)).abs() < 0.04
        scans[0, entry, near] = math.hypot(x, y)
    assert bool((scans[0, 0] < 1).any())
    assert not bool((scans[0, -1] < 1).any())
    velocity, goal = torch.tensor([[0.5, 0.3]]), at(1.0, 2.0)
    skill = hub().skills.create("dwa", fetch)
    knows = skill.act(observe(scans, velocity, poses), goal)
    forgot = skill.act(observe(scans[:, -1:], velocity, poses[:, -1:]), goal)
    assert float(forgot[0, 1]) > 0.3
    assert float(knows[0, 1]) < float(forgot[0, 1]) - 0.1


@pytest.mark.parametrize("lidar_robot", ["fetch", "round"])
def test_dwa_stands_noise_and_lost_beams(lidar_robot, fetch, small_world):
    robot = fetch if lidar_robot == "fetch" else round_robot(fetch)
    noise = Disturbances(position_std=0.02, heading_std=0.02, scan_std=0.02, lost_beams=0.05)
    poses = torch.tensor([[-1.0, 1.0, -2.0], [1.0, 0.5, 1.0], [1.5, -1.5, 2.5], [-2.0, -2.0, 0.0]])
    goal = torch.tensor([[2.0, -2.0], [-1.5, -1.5], [-3.0, 0.0], [3.3, 3.3]])
    states = drive(hub().skills.create("dwa", robot), robot, small_world, poses, (goal, 150), noise=noise)
    assert not bool(touched(states).any())
    assert distances(states[-1], goal).max() < 0.3


def round_robot(fetch: RobotSpec) -> RobotSpec:
    """Return a robot that sees 64 beams all around from its centre and may drive backwards."""
    lidar = dataclasses.replace(
        fetch.lidar, beams=64, field_of_view=2 * math.pi, mount=(0.05, 0.0, 0.0), max_range=8.0
    )
    slow = dataclasses.replace(fetch.drive, speed=(-0.3, 0.6))
    return dataclasses.replace(
        fetch, name="round", drive=slow, lidar=lidar, profile_radius=0.04, footprint_radius=0.2
    )


def test_dwa_drives_any_robot(fetch):
    robot = round_robot(fetch)
    goal = torch.tensor([[6.0, 0.0], [6.0, 1.0], [-4.0, 0.0]])
    poses = torch.tensor([[0.0, 0.0, 0.0], [0.0, 0.0, 3.0], [6.0, 0.0, 2.0]])
    states = drive(DynamicWindow(robot), robot, PILLAR, poses, (goal, 180))
    assert not bool(touched(states).any())
    assert distances(states[-1], goal).max() < 0.25


def test_a_free_path_of_zero_heads_for_the_goal_whatever_is_in_the_way(fetch):
    """With a wide pillar close ahead, only the version that looks for free directions turns at once."""
    scans = torch.full((1, fetch.lidar.beams), 25.0)
    scans[0, 91:131] = 0.9
    observation = observe(scans, torch.zeros(1, 2))
    plain = DynamicWindow(fetch, DwaConfig(free_path=0.0)).act(observation, at(5.0, 0.0))
    searching = DynamicWindow(fetch, DwaConfig(free_path=1.5)).act(observation, at(5.0, 0.0))
    assert abs(float(searching[0, 1])) > abs(float(plain[0, 1]))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"speeds": 1}, "'speeds' must be at least 2, got 1"),
        ({"turns": 0}, "'turns' must be at least 2, got 0"),
        ({"look_ahead": 0.0}, "'look_ahead' must be greater than 0, got 0.0"),
        ({"goal_radius": math.inf}, "'goal_radius' must be finite, got inf"),
        ({"heading": -1.0}, "'heading' must be at least 0, got -1.0"),
        ({"margin": math.nan}, "'margin' must be finite, got nan"),
    ],
)
def test_bad_configurations(change, message):
    with pytest.raises(ConfigError, match=message):
        DwaConfig(**change)


def test_legs_stand_in_the_way_of_pure_pursuit_only(fetch):
    """Thin legs, 1 m apart: what a lidar sees with a beam or two."""
    legs = tuple(Cylinder(center=(x, y), radius=0.03) for x in (1.5, 2.6) for y in (-1.0, 0.0, 1.0))
    world = dataclasses.replace(OPEN, cylinders=legs)
    start, goal = at(0.0, 0.0, 0.0), at(5.0, 0.0)
    around, into = (
        drive(hub().skills.create(name, fetch), fetch, world, start, (goal, 120)) for name in CLASSICAL
    )
    assert not bool(touched(around).any())
    assert distances(around[-1], goal).max() < 0.25
    assert bool(touched(into).all())
