"""What sensing and acting lose: its sizes, its times, and that it belongs to the episode."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from hpp_framework.config.sensing_choice import parse_disturbances
from hpp_framework.core.disturbances import FIELD, IDEAL, PROFILES, Disturbances
from hpp_framework.core.types import State
from hpp_framework.core.world import Box, Cylinder, World
from hpp_framework.episodes.core import EpisodeBatch
from hpp_framework.episodes.links import CommandLinks
from hpp_framework.perception.estimators.raw import cleaned
from hpp_framework.perception.sensors import Sensors
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.errors import ConfigError, UnknownNameError
from hpp_framework.utils.seeding import EpisodeRng

EPISODES = 400


def still(count: int, robots: int = 2, beams: int = 222, scan: float = 5.0) -> State:
    """Return robots that stand 3 m apart."""
    poses = torch.zeros(count, robots, 3)
    poses[..., 0] = 3.0 * torch.arange(robots)
    return State(
        poses=poses,
        velocities=torch.tensor([0.5, 0.2]).repeat(count, robots, 1),
        scans=torch.full((count, robots, beams), scan),
        touched_obstacle=torch.zeros(count, robots, dtype=torch.bool),
        touched_robot=torch.zeros(count, robots, dtype=torch.bool),
    )


@pytest.fixture
def sense(pair):
    """Return a function that yields the readings of robot 0 while all stand."""

    def run(disturbances: Disturbances, steps: int, count: int = EPISODES, state: State | None = None):
        sensors = Sensors([robot.lidar for robot in pair], [disturbances] * 2)
        state = state or still(count)
        readings = [sensors.reset(state, EpisodeRng(range(count)))[0]]
        for step in range(steps):
            moved = replace(state, poses=state.poses + 0.1 * (step + 1))
            readings.append(sensors.read(moved)[0])
        return readings

    return run


def test_profiles_are_named_and_take_settings():
    assert parse_disturbances("field") == FIELD
    assert parse_disturbances("ideal:nan_beams=0.1") == Disturbances(nan_beams=0.1)
    assert parse_disturbances("field:command_delay=0:command_jitter=0").latency == FIELD.sensing_delay
    assert list(PROFILES) == ["ideal", "paper", "field", "harsh"]
    with pytest.raises(UnknownNameError, match="Did you mean 'field'"):
        parse_disturbances("filed")
    with pytest.raises(ConfigError, match="'wind' is no setting of disturbances 'field:wind=1'"):
        parse_disturbances("field:wind=1")
    with pytest.raises(ConfigError, match="command_jitter of 0.05 s is more than command_delay of 0 s"):
        parse_disturbances("field:command_delay=0")


def test_drift_has_its_size_and_its_time_constant(sense):
    readings = sense(Disturbances(position_drift=0.1, drift_time=2.0), steps=50)
    errors = torch.stack([reading.poses[:, 0, 0] - 0.1 * step for step, reading in enumerate(readings)])
    assert float(errors.std()) == pytest.approx(0.1, rel=0.1)
    # exp(-2 s / 2 s) after 10 steps
    related = [torch.corrcoef(errors[[step, step + 10]])[0, 1] for step in range(0, 40, 5)]
    assert float(torch.stack(related).mean()) == pytest.approx(math.exp(-1), abs=0.08)


def test_a_constant_error_stays_and_jumps_are_carried_off(sense):
    bias = sense(Disturbances(position_bias=0.3), steps=3)
    errors = torch.stack([reading.poses[:, 0, :2] - 0.1 * step for step, reading in enumerate(bias)])
    assert torch.allclose(errors[0], errors[-1], atol=1e-5)
    assert float(errors[0].std()) == pytest.approx(0.3, rel=0.1)
    jumping = sense(Disturbances(jump_rate=5.0, jump_size=0.3, drift_time=0.01), steps=2)
    moved = (jumping[2].poses[:, 0, :2] - 0.2).norm(dim=-1)
    assert torch.allclose(moved, torch.full_like(moved, 0.3), atol=1e-4), "each step a jump, none remembered"


def test_odometry_errs_by_a_share(sense):
    reading = sense(Disturbances(odometry_scale=0.05), steps=1)[1]
    share = reading.velocity / torch.tensor([0.5, 0.2])
    assert torch.allclose(share[:, 0], share[:, 1])
    assert float(share.std()) == pytest.approx(0.05, rel=0.1)


@pytest.mark.parametrize(("delay", "steps"), [(0.0, 0), (0.2, 1), (0.3, 2), (0.4, 2), (1.0, 5)])
def test_messages_are_as_old_as_they_say(sense, delay, steps):
    reading = sense(Disturbances(message_delay=delay), steps=8, count=3)[-1]
    assert torch.allclose(reading.ages[:, 1], torch.full((3,), 0.2 * steps))
    assert torch.allclose(reading.poses[:, 1, 0], torch.full((3,), 3.0 + 0.1 * (8 - steps)))
    assert torch.allclose(reading.ages[:, 0], torch.zeros(3))


def test_late_sensing_brings_fresher_messages(sense):
    """What is sensed 0.2 s late is read together with messages that came meanwhile."""
    reading = sense(Disturbances(sensing_delay=0.2, message_delay=0.4), steps=8, count=3)[-1]
    assert torch.allclose(reading.poses[:, 1, 0], torch.full((3,), 3.0 + 0.1 * 7))
    assert torch.allclose(reading.ages, torch.tensor([0.2, 0.4]).expand(3, 2))


def test_of_messages_that_overtake_each_other_the_newest_counts(sense):
    readings = sense(Disturbances(message_delay=0.5, message_jitter=0.5), steps=30)
    stamps = torch.stack([0.2 * step - reading.ages[:, 1] for step, reading in enumerate(readings)])
    assert bool((stamps.diff(dim=0) >= -1e-5).all())
    fresh = torch.stack([reading.fresh[:, 1] for reading in readings[1:]])
    assert torch.equal(fresh, stamps.diff(dim=0) > 1e-5)


def test_messages_are_lost_out_of_range_and_out_of_sight(sense):
    far = sense(Disturbances(message_range=2.0), steps=3, count=2)[-1]
    assert torch.allclose(far.poses[:, 1, 0], torch.full((2,), 3.0)), "the first, which all know"
    for scan, heard in ((5.0, 3.3), (1.0, 3.0)):
        reading = sense(Disturbances(message_sight=True), 3, 2, still(2, scan=scan))[-1]
        assert torch.allclose(reading.poses[:, 1, 0], torch.full((2,), heard), atol=1e-5)


def test_clocks_may_differ(sense):
    reading = sense(Disturbances(clock_offset=0.5), steps=1)[1]
    assert float(reading.ages[:, 1].std()) == 0.0, "nothing is stamped that comes at once"
    reading = sense(Disturbances(clock_offset=0.5, message_delay=0.2), steps=3)[-1]
    assert float(reading.ages[:, 1].std()) == pytest.approx(0.5, rel=0.1)


@pytest.mark.parametrize(
    ("fault", "holds"),
    [
        ("blind", lambda scan: (scan > 20).all(1)),
        ("nan", lambda scan: scan.isnan().all(1)),
        ("half", lambda scan: (scan > 20).sum(1) == 111),
        ("frozen", lambda scan: (scan == scan).all(1)),
    ],
)
def test_lidars_fail_for_a_while(sense, fault, holds):
    broken = Disturbances(scan_std=0.02, fault=fault, fault_rate=5.0, fault_time=10.0)
    readings = sense(broken, steps=4, count=8)
    assert bool(holds(readings[2].scan).all())
    if fault == "frozen":
        assert torch.equal(readings[2].scan, readings[4].scan)
        assert not torch.equal(sense(Disturbances(scan_std=0.02), 2, 8)[2].scan, readings[0].scan)


def test_beams_are_lost_read_nothing_and_look_through_glass(sense, pair):
    lidar = pair[0].lidar
    nothing = sense(Disturbances(nan_beams=0.1), steps=1)[1].scan
    assert float(nothing.isnan().float().mean()) == pytest.approx(0.1, rel=0.1)
    dead = sense(Disturbances(dead_sector=0.25), steps=1, count=5)[1].scan
    assert (dead == lidar.max_range).sum(1).tolist() == [round(0.25 * lidar.beams)] * 5
    first, second = (reading.scan for reading in sense(Disturbances(glass=0.3), 1, 1)[:2])
    through = (first == lidar.max_range).float().mean()
    assert 0.1 < float(through) < 0.5
    assert not torch.equal(first == lidar.max_range, second == lidar.max_range), "it has driven on"


def test_a_scan_is_cleaned_where_it_is_read(fetch):
    scan = torch.tensor([[1.0, math.nan, 3.0, math.inf, -1.0, 40.0, math.nan]])
    clean = cleaned(scan, fetch.lidar)[0]
    far = fetch.lidar.max_range
    assert clean.tolist() == [1.0, 1.0, 3.0, far, 3.0, far, far]


def test_commands_act_late_and_in_part_of_a_period():
    links = CommandLinks([Disturbances(command_delay=0.3)])
    links.reset(EpisodeRng([0]))
    sent = [torch.full((1, 1, 2), float(step + 1)) for step in range(4)]
    heeded = [links.delivered(command)[0, 0, :, 0].tolist() for command in sent]
    assert heeded == [[0.0] * 4, [0.0, 0.0, 1.0, 1.0], [1.0, 1.0, 2.0, 2.0], [2.0, 2.0, 3.0, 3.0]]
    assert CommandLinks([IDEAL]).delivered(sent[0]) is sent[0]


@pytest.mark.parametrize("profile", ["field", "harsh"])
def test_disturbances_belong_to_the_episode_not_to_what_robots_do(pair, profile):
    """Else planners would be compared under different luck."""
    world = World(name="open", bounds=(-10, -10, 10, 10), boxes=(Box(center=(3.0, 3.0), size=(1.0, 1.0)),))
    starts = torch.tensor([[[0.0, 0.0, 0.0], [4.0, 0.0, 3.0]]]).repeat(2, 1, 1)
    errors = []
    for speed in (0.0, 1.0):
        batch = EpisodeBatch(BatchSimulator(pair), disturbances=[PROFILES[profile]] * 2)
        batch.begin([world] * 2, starts, [7, 8])
        for _ in range(10):
            batch.step(torch.tensor([speed, 0.0]).expand(2, 2, 2))
        errors.append(batch.observe(0).pose[:, :2] - batch.state.poses[:, 0, :2])
    assert torch.allclose(errors[0], errors[1], atol=1e-5)
    assert not torch.allclose(errors[0][0], errors[0][1])


def test_a_pillar_of_glass_is_driven_into_unseen(fetch):
    world = World(name="glass", cylinders=(Cylinder(center=(3.0, 0.0), radius=0.3),))
    batch = EpisodeBatch(BatchSimulator([fetch]), disturbances=Disturbances(glass=1.0))
    batch.begin([world], torch.zeros(1, 1, 3), [0])
    assert float(batch.observe(0).scan.min()) == fetch.lidar.max_range
