"""The safety filter: no touch where a skill would brush what left its view, and no robot stuck for ever."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from hpp_framework.control.safety_filter import SafetyFilter, SafetyFilterConfig
from hpp_framework.core.types import Keyframes, Observation
from hpp_framework.core.world import Cylinder, World
from hpp_framework.episodes.core import EpisodeBatch
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.errors import ConfigError

FAR = 25.0


def legs(*centers):
    cylinders = tuple(Cylinder(center=center, radius=0.035) for center in centers)
    return World(name="legs", bounds=(-10, -10, 10, 10), walled=False, cylinders=cylinders)


def drive(robots, world, starts, command, steps, safety):
    """Return the states of one episode in which the first robot's skill wants the same all the time."""
    batch = EpisodeBatch(BatchSimulator(robots))
    batch.begin([world], torch.tensor([starts]), [0])
    states = [batch.state]
    wanted = torch.zeros(1, len(robots), 2)
    for _ in range(steps):
        wanted[:, 0] = torch.tensor(command)
        if safety is not None:
            wanted[:, 0] = safety.corrected(batch.observe(0), wanted[:, 0])
        states.append(batch.step(wanted))
    return states


def touches(states):
    return any(bool(state.touched_obstacle[0, 0]) for state in states)


def seen(scans, *, speed=0.5, others=(), keyframes=None):
    """Return what a robot at the origin knows, the same scan (222,) in its whole history or one (5, 222)."""
    size = torch.zeros(1, 5, 1 + len(others), 3)
    for index, place in enumerate(others):
        size[..., 1 + index, :2] = torch.tensor(place)
    return Observation(0, size, scans.expand(1, 5, 222).clone(), torch.tensor([[speed, 0.0]]), keyframes)


def test_open_space_changes_nothing(fetch):
    wanted = torch.tensor([[1.0, -2.0]])
    assert torch.equal(SafetyFilter(fetch).corrected(seen(torch.full((222,), FAR)), wanted), wanted)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_leg_beside_the_robot_is_not_brushed(fetch, side):
    """It turns towards a leg that it passes, which the lidar saw before and does not see now."""
    world, command = legs((1.0, 0.42 * side)), (0.6, 0.45 * side)
    assert touches(drive([fetch], world, [[0.0, 0.0, 0.0]], command, 20, None))
    states = drive([fetch], world, [[0.0, 0.0, 0.0]], command, 20, SafetyFilter(fetch))
    assert not touches(states)
    assert states[-1].poses[0, 0, :2].norm() > 1.0
    assert states[-1].velocities[0, 0, 0].item() == pytest.approx(0.6)


def test_a_robot_that_drives_at_a_leg_gets_past_it(fetch):
    world = legs((1.0, 0.0))
    assert touches(drive([fetch], world, [[0.0, 0.0, 0.0]], (0.8, 0.0), 60, None))
    states = drive([fetch], world, [[0.0, 0.0, 0.0]], (0.8, 0.0), 60, SafetyFilter(fetch))
    assert not touches(states)
    assert states[-1].poses[0, 0, :2].norm() > 2.0


def test_it_stops_before_a_wall_of_legs(fetch):
    """Nowhere to go: rest is always safe, as a disc turns in place freely."""
    ring = [(0.6 * torch.tensor(a).cos().item(), 0.6 * torch.tensor(a).sin().item()) for a in range(0, 63)]
    states = drive([fetch], legs(*ring), [[0.0, 0.0, 0.0]], (1.0, 0.3), 40, SafetyFilter(fetch))
    assert not touches(states)


def test_what_left_the_view_is_remembered_and_forgotten(fetch):
    """A leg beside the present view: in a keyframe it counts, further back than the memory it does not."""
    poses, scans = torch.zeros(1, 12, 1, 3), torch.full((1, 12, 222), FAR)
    # looked there then: the beam straight ahead met something at (0.10, 0.30) m
    poses[:, 10, 0, 2], scans[:, 10, 109:113] = 1.249, 0.081
    wanted = torch.tensor([[1.0, 3.0]])
    known = seen(torch.full((222,), FAR), speed=0.5, keyframes=Keyframes(poses, scans))
    assert not torch.equal(SafetyFilter(fetch).corrected(known, wanted), wanted)
    assert torch.equal(SafetyFilter(fetch, SafetyFilterConfig(memory=1)).corrected(known, wanted), wanted)
    assert torch.equal(SafetyFilter(fetch, SafetyFilterConfig(memory=0)).corrected(known, wanted), wanted)


def test_it_keeps_off_as_far_as_late_commands_may_carry_it(fetch):
    """Nothing is nearer than the margin on the way to rest, but it may be where commands act late."""
    wanted = torch.tensor([[0.8, 0.0]])
    scan = torch.full((222,), FAR)
    scan[74:76] = 0.616
    known = seen(scan, speed=0.8)
    safety = SafetyFilter(fetch)
    free = [
        torch.equal(safety.corrected(replace(known, jitter=torch.tensor([jitter])), wanted), wanted)
        for jitter in (0.0, 0.05, 0.1, 0.2)
    ]
    assert free[0]
    assert not free[-1]
    assert torch.equal(safety.corrected(known, wanted), wanted)


def test_other_robots_are_left_to_the_agent(fetch):
    scan = torch.full((222,), FAR)
    scan[100:122] = 0.3
    wanted = torch.tensor([[0.8, 0.0]])
    assert not torch.equal(SafetyFilter(fetch).corrected(seen(scan), wanted), wanted)
    assert torch.equal(SafetyFilter(fetch).corrected(seen(scan, others=[(0.74, 0.0)]), wanted), wanted)


def test_rows_do_not_depend_on_each_other(fetch, torch_rng):
    rows = 20
    observation = Observation(
        0, torch.zeros(rows, 5, 1, 3), 0.2 + torch.rand(rows, 5, 222, generator=torch_rng),
        torch.rand(rows, 2, generator=torch_rng),
    )  # fmt: skip
    wanted = torch.rand(rows, 2, generator=torch_rng)
    safety = SafetyFilter(fetch)
    together = safety.corrected(observation, wanted)
    alone = [safety.corrected(observation.episodes(slice(i, i + 1)), wanted[i : i + 1]) for i in range(rows)]
    assert torch.equal(together, torch.cat(alone))
    assert not torch.equal(together, wanted)


@pytest.mark.parametrize("wrong", [{"margin": -0.1}, {"memory": 13}, {"way_out": float("nan")}])
def test_wrong_settings_are_refused(wrong):
    with pytest.raises(ConfigError, match=f"safety filter: '{next(iter(wrong))}' must be"):
        SafetyFilterConfig(**wrong)
