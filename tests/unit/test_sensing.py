"""Noise, drop-outs and histories: the one place where measurements get worse than the truth."""

from __future__ import annotations

import dataclasses
import math

import pytest
import torch

from hpp_framework.core.disturbances import Disturbances
from hpp_framework.core.types import State
from hpp_framework.perception.estimators.dead_reckoning import DeadReckoning
from hpp_framework.perception.sensing import HISTORY, Sensing
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.seeding import EpisodeRng

BATCH, BEAMS = 400, 222


def state(batch: int = BATCH, value: float = 1.0, scan: float = 5.0, robots: int = 2) -> State:
    return State(
        poses=torch.full((batch, robots, 3), value),
        velocities=torch.full((batch, robots, 2), value / 10),
        scans=torch.full((batch, robots, BEAMS), scan),
        touched_obstacle=torch.zeros(batch, robots, dtype=torch.bool),
        touched_robot=torch.zeros(batch, robots, dtype=torch.bool),
    )


class Seeded(Sensing):
    """Whose episodes have the numbers from 0 on as seeds, whose robots reckon and were sent no commands."""

    def __init__(self, robots, disturbances):
        reckoning = [DeadReckoning(agent, robot.lidar) for agent, robot in enumerate(robots)]
        super().__init__(robots, disturbances, reckoning)

    def reset(self, state, rng=None):
        super().reset(state, rng or EpisodeRng(range(len(state.poses))))

    def update(self, state, commands=None):
        super().update(state, torch.zeros_like(state.velocities) if commands is None else commands)


@pytest.fixture
def make(pair):
    return lambda **noise: Seeded(pair, Disturbances(**noise))


def test_without_noise_observations_are_the_truth(make):
    sensing = make()
    sensing.reset(state(3))
    for agent in (0, 1):
        seen = sensing.observe(agent)
        assert seen.agent == agent
        assert seen.poses.shape == (3, HISTORY, 2, 3)
        assert seen.scans.shape == (3, HISTORY, BEAMS)
        assert torch.equal(seen.poses, torch.ones_like(seen.poses))
        assert torch.equal(seen.scans, torch.full_like(seen.scans, 5.0))
        assert torch.equal(seen.velocity, torch.full((3, 2), 0.1))


def test_histories_run_from_oldest_to_newest(make):
    sensing = make()
    sensing.reset(state(1, value=0.0, scan=1.0))
    for step in range(1, HISTORY + 2):
        sensing.update(state(1, value=float(step), scan=1.0 + step))
    seen = sensing.observe(0)
    assert seen.poses[0, :, 0, 0].tolist() == [2.0, 3.0, 4.0, 5.0, 6.0]
    assert seen.scans[0, :, 0].tolist() == [3.0, 4.0, 5.0, 6.0, 7.0]
    assert seen.pose[0, 0] == 6.0


def test_a_history_begins_with_the_first_measurement_repeated(make):
    sensing = make(position_std=0.1, scan_std=0.1)
    sensing.reset(state(4))
    seen = sensing.observe(1)
    assert torch.equal(seen.poses, seen.poses[:, :1].expand_as(seen.poses))
    assert torch.equal(seen.scans, seen.scans[:, :1].expand_as(seen.scans))


def test_noise_has_the_statistics_asked_for(make):
    sensing = make(position_std=0.2, heading_std=0.05, scan_std=0.03)
    sensing.reset(state())
    errors = sensing.observe(0).team_poses - 1.0
    ranges = sensing.observe(0).scan - 5.0
    # standard errors: 0.2 / sqrt(1600) = 0.005 for positions, a quarter of that for headings
    assert abs(float(errors[..., :2].mean())) < 0.02
    assert float(errors[..., :2].std()) == pytest.approx(0.2, rel=0.1)
    assert float(errors[..., 2].std()) == pytest.approx(0.05, rel=0.15)
    assert float(ranges.std()) == pytest.approx(0.03, rel=0.02)
    assert abs(float(ranges.mean())) < 0.001


def test_robots_err_on_their_own_and_all_hear_the_same(make):
    sensing = make(position_std=0.2)
    sensing.reset(state())
    first, second = (sensing.observe(agent).team_poses[..., 0] - 1.0 for agent in (0, 1))
    assert torch.equal(first, second)
    correlation = torch.corrcoef(first.T)[0, 1]
    assert abs(float(correlation)) < 4 / math.sqrt(BATCH)


def test_noise_of_one_seed_repeats(pair):
    def once(*seeds) -> torch.Tensor:
        sensing = Sensing(pair, Disturbances(position_std=0.1))
        sensing.reset(state(len(seeds)), EpisodeRng(seeds))
        sensing.update(state(len(seeds)), torch.zeros(len(seeds), 2, 2))
        return sensing.observe(0).poses

    together = once(4, 5, 6)
    assert torch.equal(together, once(4, 5, 6))
    assert torch.equal(together[2:], once(6))
    assert not torch.equal(together[2:], once(7))


def test_none_means_the_lidars_own_noise(make, fetch):
    sensing = make(scan_std=None)
    sensing.reset(state())
    assert float(sensing.observe(0).scan.std()) == pytest.approx(fetch.lidar.noise_std, rel=0.02)


def test_misses_stay_misses_and_ranges_stay_within_the_lidars(make, fetch):
    lidar = fetch.lidar
    sensing = make(scan_std=1.0)
    sensing.reset(state(50, scan=lidar.max_range))
    assert torch.equal(sensing.observe(0).scan, torch.full((50, BEAMS), lidar.max_range))
    sensing.reset(state(50, scan=lidar.max_range - 0.1))
    assert float(sensing.observe(0).scan.max()) <= lidar.max_range
    sensing.reset(state(50, scan=lidar.min_range))
    assert float(sensing.observe(0).scan.min()) >= lidar.min_range


def test_dropped_beams_read_the_maximum(make, fetch):
    sensing = make(lost_beams=0.25)
    sensing.reset(state())
    scan = sensing.observe(0).scan
    lost = scan == fetch.lidar.max_range
    assert float(lost.float().mean()) == pytest.approx(0.25, abs=0.01)
    assert torch.equal(scan[~lost], torch.full_like(scan[~lost], 5.0))


def test_restart_begins_only_the_chosen_histories(make):
    sensing = make()
    sensing.reset(state(2, value=0.0, scan=1.0))
    sensing.update(state(2, value=1.0, scan=2.0))
    chosen = torch.tensor([[True, False], [False, False]])
    sensing.restart(state(2, value=9.0, scan=9.0), chosen)
    restarted, neighbour = sensing.observe(0), sensing.observe(1)
    # episode 0, robot 0: everything it knows begins anew
    assert torch.equal(restarted.poses[0], torch.full((HISTORY, 2, 3), 9.0))
    assert torch.equal(restarted.scans[0], torch.full((HISTORY, BEAMS), 9.0))
    # episode 0, robot 1: it forgets where robot 0 was, keeps its own past, measures once more
    assert torch.equal(neighbour.poses[0, :, 0], torch.full((HISTORY, 3), 9.0))
    assert neighbour.poses[0, :, 1, 0].tolist() == [0.0, 0.0, 0.0, 0.0, 9.0]
    assert neighbour.scans[0, :, 0].tolist() == [1.0, 1.0, 1.0, 1.0, 9.0]
    # episode 1: no robot was chosen, the newest entry is measured again
    assert restarted.poses[1, :, 0, 0].tolist() == [0.0, 0.0, 0.0, 0.0, 9.0]


def test_others_are_known_late_and_oneself_at_once(make):
    sensing = make(message_delay=0.4)
    sensing.reset(state(1, value=0.0))
    for step in range(1, 5):
        sensing.update(state(1, value=float(step)))
    for agent in (0, 1):
        seen = sensing.observe(agent).poses[0, :, :, 0]
        assert seen[:, agent].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
        # moved on by two steps at the speed of the last three poses that came: 0, 0, 1, then 0, 1, 2
        assert seen[:, 1 - agent].tolist() == [0.0, 0.0, 0.0, 2.0, 4.0]


@pytest.mark.parametrize(
    "noise", [{"message_delay": 1.0}, {"message_loss": 0.2}, {"message_delay": 0.4, "message_loss": 0.1}]
)
def test_steady_motion_is_reckoned_exactly_from_late_and_lost_poses(make, noise):
    sensing = make(**noise)
    steady = state(50)
    motion = torch.tensor([0.1, -0.2, 0.3])
    for step in range(40):
        steady = dataclasses.replace(steady, poses=1.0 + (motion * step).expand(50, 2, 3))
        (sensing.update if step else sensing.reset)(steady)
    assert torch.allclose(sensing.observe(0).team_poses, steady.poses, atol=1e-4)


def test_reckoning_goes_on_for_a_while_and_turns_the_short_way(make):
    deaf = make(message_delay=0.2)
    start = state(1)
    for step in range(6):
        heading = math.pi - 0.1 + 0.05 * step
        poses = torch.tensor(
            [[[0.0, 0.0, 0.0], [0.2 * step, 0.0, (heading + math.pi) % (2 * math.pi) - math.pi]]]
        )
        (deaf.update if step else deaf.reset)(dataclasses.replace(start, poses=poses))
    x, _, heading = deaf.observe(0).team_poses[0, 1].tolist()
    assert x == pytest.approx(1.0, abs=1e-4)
    assert math.cos(heading - (math.pi + 0.15)) == pytest.approx(1.0, abs=1e-5)
    deaf.sensors.disturbances = (Disturbances(message_delay=0.2, message_loss=1.0),) * 2
    for _ in range(30):
        deaf.update(start)
    assert deaf.observe(0).team_poses[0, 1, 0] == pytest.approx(1.0 + 0.2 * 5, abs=1e-3)


def test_a_restart_is_known_at_once_whatever_the_delay(make):
    sensing = make(message_delay=0.6)
    sensing.reset(state(1, value=0.0))
    sensing.restart(state(1, value=7.0), torch.tensor([[True, False]]))
    for agent in (0, 1):
        assert sensing.observe(agent).poses[0, -1, :, 0].tolist() == [7.0, 7.0]
    sensing.update(state(1, value=8.0))
    assert sensing.observe(1).poses[0, -1, 0, 0] == 7.0


def test_lost_poses_leave_the_last_one_that_came(make):
    sensing = make(message_loss=0.25)
    sensing.reset(state(value=0.0))
    sensing.update(state(value=1.0))
    other, own = sensing.observe(0).team_poses[:, 1, 0], sensing.observe(0).team_poses[:, 0, 0]
    assert torch.equal(own, torch.ones(BATCH))
    assert set(other.tolist()) == {0.0, 1.0}
    assert float((other == 0).float().mean()) == pytest.approx(0.25, abs=0.09)
    lost = make(message_loss=1.0)
    lost.reset(state(2, value=0.0))
    lost.update(state(2, value=1.0))
    assert lost.observe(1).team_poses[0, :, 0].tolist() == [0.0, 1.0]


def test_agents_with_fewer_beams_get_their_own_width(fetch, freight):
    coarse = dataclasses.replace(freight, lidar=dataclasses.replace(freight.lidar, beams=20))
    sensing = Seeded([fetch, coarse], Disturbances())
    sensing.reset(state(2))
    assert sensing.observe(0).scan.shape == (2, BEAMS)
    assert sensing.observe(1).scan.shape == (2, 20)


def test_observations_do_not_change_afterwards(make):
    sensing = make()
    sensing.reset(state(2, value=0.0))
    early = sensing.observe(0)
    poses, scans = early.poses.clone(), early.scans.clone()
    sensing.update(state(2, value=1.0, scan=2.0))
    sensing.restart(state(2, value=5.0), torch.ones(2, 2, dtype=torch.bool))
    assert torch.equal(early.poses, poses)
    assert torch.equal(early.scans, scans)


@pytest.mark.parametrize(
    ("noise", "message"),
    [
        ({"position_std": -0.1}, "'position_std' must be at least 0"),
        ({"heading_std": math.nan}, "'heading_std' must be finite"),
        ({"scan_std": math.inf}, "'scan_std' must be finite"),
        ({"lost_beams": 1.5}, "'lost_beams' must be at most 1.*a share between 0 and 1"),
        ({"message_loss": 1.5}, "'message_loss' must be at most 1.*a share between 0 and 1"),
        ({"message_delay": -1.0}, "'message_delay' must be at least 0"),
        ({"message_jitter": 0.1}, "message_jitter of 0.1 s is more than message_delay"),
    ],
)
def test_bad_noise(noise, message):
    with pytest.raises(ConfigError, match=message):
        Disturbances(**noise)
