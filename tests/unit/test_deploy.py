"""Robots over the loopback backend: the same episodes as evaluations, and what is done about faults."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch

from hpp_framework.config.deployment import GateLimits, Topics
from hpp_framework.core.disturbances import FIELD
from hpp_framework.core.timing import CONTROL_PERIOD
from hpp_framework.deploy.assembly import Resampler
from hpp_framework.deploy.backends import open_port
from hpp_framework.deploy.faults import Fault, parse_fault
from hpp_framework.deploy.port import Fix, Inbox, Motion, Scan
from hpp_framework.deploy.rehearsal import Figures, run_in_loopback
from hpp_framework.deploy.safety import WATCHDOG, Gate, Watchdog
from hpp_framework.deploy.topics import topic_names
from hpp_framework.evaluation.experiment import Experiment, draw_episode, run_drawn
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import ConfigError, UnknownNameError
from hpp_framework.worlds.loader import resolve_world

TEAM = "fetch,freight"
PLANNER, CONTROL = "centralized-mp", "separation,safety-filter,watchdog"
"""Quick ones."""
BEGIN = 2.0


def _experiment(**changes) -> Experiment:
    options = {
        "worlds": ("simple",),
        "planners": (PLANNER,),
        "control": CONTROL,
        "episodes": 1,
        "seed": 6001,
        **changes,
    }
    return Experiment(**options)


def _drawn(experiment: Experiment, episode: int = 0):
    name = experiment.worlds[0]
    return {episode: draw_episode(experiment, name, resolve_world(name), episode)}


def _rehearse(
    experiment: Experiment, *faults: Fault, episode: int = 0, watch: Callable | None = None, steps=100
):
    figures = Figures()
    extra = {} if watch is None else {"watch": watch}
    found = run_in_loopback(
        experiment, experiment.planners[0], experiment.worlds[0], _drawn(experiment, episode), faults=faults,
        figures=figures, steps=steps, **extra,
    )  # fmt: skip
    return found, figures


def _team_file(folder, **gate):
    file = folder / "team.yaml"
    file.write_text(
        f"gate: {gate}\nmembers:\n- {{id: fetch, robot: fetch}}\n- {{id: freight, robot: freight}}\n".replace(
            "'", ""
        ).replace("False", "false")
    )
    return str(file)


def test_a_rehearsal_repeats_an_evaluation_bit_for_bit(tmp_path):
    experiment = _experiment(team=_team_file(tmp_path, shape=False, protect=False))
    evaluated = run_drawn(experiment, PLANNER, experiment.worlds[0], _drawn(experiment))
    rehearsed, figures = _rehearse(experiment)
    assert torch.equal(evaluated.poses, rehearsed.poses)
    assert torch.equal(evaluated.goals, rehearsed.goals)
    assert torch.equal(evaluated.done_step, rehearsed.done_step)
    assert not figures.counts


def test_limits_of_acceleration_change_little_for_wheels_that_have_them_anyway():
    experiment = _experiment(disturbances="ideal")
    evaluated = run_drawn(experiment, PLANNER, experiment.worlds[0], _drawn(experiment))
    rehearsed, _ = _rehearse(experiment)
    assert torch.allclose(evaluated.poses[:, :20], rehearsed.poses[:, :20], atol=1e-3)
    assert abs(int(evaluated.done_step) - int(rehearsed.done_step)) <= 2


def _speeds(fault: Fault, steps: int = 100):
    """Return both robots' speed at each time under a fault, and what touched."""
    speeds: list[torch.Tensor] = []

    def watch(team, loops):
        del loops
        return lambda _: speeds.append(team.batch.state.velocities[0].abs().amax(-1))

    found, figures = _rehearse(_experiment(), fault, watch=watch, steps=steps)
    return torch.stack(speeds), found, figures


MINE = ("kill", "pause", "stop", "nan-scan", "frozen-scan", "pose-jump", "clock-step", "network")


@pytest.mark.parametrize("robot", [0, 1])
@pytest.mark.parametrize("kind", MINE)
def test_a_robot_with_a_fault_comes_to_rest_in_time_and_touches_nothing(kind, robot):
    team = parse_team(TEAM, skill="p2p")
    speeds, found, _ = _speeds(Fault(kind, team.ids[robot], BEGIN, 5.0), steps=40)
    limits = team.robots[robot].drive
    braking = max(limits.speed[1] / limits.acceleration, limits.turn_rate / limits.turn_acceleration)
    # commands under way act for as long as the profile says; one control period to notice
    rest = BEGIN + WATCHDOG + FIELD.latency + FIELD.command_jitter + braking + CONTROL_PERIOD
    at = round(rest / CONTROL_PERIOD)
    assert speeds[round(BEGIN / CONTROL_PERIOD), robot] > 0.2, "it must drive when the fault comes"
    if kind == "pose-jump":  # over once the robot has stood for a while; the next jump comes with its end
        assert speeds[: at + 1, robot].min() < 0.05
    else:
        assert speeds[at : round((BEGIN + 4.8) / CONTROL_PERIOD), robot].max() < 0.05
    assert not bool(found.collided)


def test_a_robot_drives_on_after_a_fault():
    _, found, figures = _speeds(Fault("network", "fetch", BEGIN, 3.0))
    assert int(found.done_step) > 0
    assert figures.counts["scan"] >= 10


def test_nothing_is_touched_where_a_teammates_pose_is_frozen():
    found, _ = _rehearse(_experiment(), Fault("frozen-pose", "freight", BEGIN))
    assert not bool(found.touched_robot)
    assert not bool(found.touched_obstacle)


def test_faults_are_read_and_mistakes_named():
    assert parse_fault("network:fetch@2+5", ("fetch",)) == Fault("network", "fetch", 2.0, 5.0)
    assert parse_fault("kill:fetch@2", ("fetch",)).seconds == math.inf
    with pytest.raises(UnknownNameError, match="Did you mean 'pause'"):
        parse_fault("paus:fetch@2", ("fetch",))
    with pytest.raises(ConfigError, match="no robot of the team"):
        parse_fault("kill:anna@2", ("fetch",))
    with pytest.raises(ConfigError, match="@BEGIN"):
        parse_fault("kill:fetch", ("fetch",))


FETCH = hub().robots.create("fetch")


def _scan(now: float = 0.0, **changes) -> Scan:
    lidar = FETCH.lidar
    values = {
        "stamp": now, "arrived": now, "ranges": np.linspace(1, 5, lidar.beams, dtype=np.float32),
        "angle_min": -lidar.field_of_view / 2, "angle_increment": lidar.field_of_view / (lidar.beams - 1),
        "range_min": lidar.min_range, "range_max": lidar.max_range, **changes,
    }  # fmt: skip
    return Scan(**values)


def test_scans_are_read_as_rep_117_has_them():
    ranges = _scan().ranges.copy()
    ranges[:5] = [np.inf, -np.inf, np.nan, FETCH.lidar.max_range + 1, FETCH.lidar.min_range / 2]
    found = Resampler(FETCH.lidar)(_scan(ranges=ranges))
    assert found[0] == np.float32(FETCH.lidar.max_range)
    assert found[1] == np.float32(FETCH.lidar.min_range)
    assert np.isnan(found[2:5]).all()
    assert np.array_equal(found[5:], ranges[5:])


@pytest.mark.parametrize("how", ["clockwise", "flipped", "turned"])
def test_scans_of_lidars_that_are_mounted_otherwise_are_the_same(how):
    plain = _scan()
    if how == "clockwise":
        found = Resampler(FETCH.lidar)(
            _scan(
                ranges=plain.ranges[::-1].copy(),
                angle_min=-plain.angle_min,
                angle_increment=-plain.angle_increment,
            )
        )
    elif how == "flipped":
        found = Resampler(FETCH.lidar, flipped=True)(_scan(ranges=plain.ranges[::-1].copy()))
    else:
        found = Resampler(FETCH.lidar, yaw=0.5)(_scan(angle_min=plain.angle_min - 0.5))
    assert np.array_equal(found, plain.ranges)


def test_of_a_denser_scan_the_nearest_range_counts_and_a_coarser_one_is_filled():
    lidar = FETCH.lidar
    dense = np.full(4 * lidar.beams, 9.0, np.float32)
    dense[400] = 0.8
    step = lidar.field_of_view / (len(dense) - 1)
    found = Resampler(lidar)(_scan(ranges=dense, angle_increment=step))
    assert (found == np.float32(0.8)).sum() == 1
    assert (found == 9).sum() == lidar.beams - 1
    coarse = np.full(lidar.beams // 2, 3.0, np.float32)
    step = lidar.field_of_view / (len(coarse) - 1)
    assert (Resampler(lidar)(_scan(ranges=coarse, angle_increment=step)) == 3).all()


def test_a_lidar_that_sees_less_than_the_description_is_refused():
    narrow = np.full(100, 3.0, np.float32)
    with pytest.raises(ConfigError, match="of 'fetch' covers"):
        Resampler(FETCH.lidar, robot="fetch")(_scan(ranges=narrow, angle_min=-0.5, angle_increment=0.01))


def _gate(**config) -> Gate:
    return Gate(FETCH, "fetch", ("fetch", "freight"), GateLimits(**config))


def _inbox(now: float, x: float = 0.0, **changes) -> Inbox:
    fixes = {name: Fix(stamp=now, arrived=now, pose=(x, 0.0, 0.0)) for name in ("fetch", "freight")}
    scan = _scan(now, ranges=np.full(FETCH.lidar.beams, 2 + now, np.float32))
    motion = Motion(stamp=now, arrived=now, velocity=(0.5, 0.0))
    return Inbox(**{"now": now, "clock": now, "scan": scan, "motion": motion, "fixes": fixes, **changes})


def test_the_gate_lets_a_healthy_robot_drive():
    gate = _gate()
    assert [gate.judge(_inbox(0.2 * k, 0.1 * k)) for k in range(10)] == [()] * 10


@pytest.mark.parametrize(
    ("reason", "fault"),
    [
        ("scan", lambda i: replace(i, scan=replace(i.scan, arrived=i.now - 0.5))),
        ("odometry", lambda i: replace(i, motion=replace(i.motion, arrived=i.now - 0.5))),
        ("silence", lambda i: replace(i, fixes={"fetch": i.fixes["fetch"]})),
        ("stamps", lambda i: replace(i, clock=i.clock + 5)),
        ("clock", lambda i: replace(i, clock=i.clock + 0.3)),
        ("late", lambda i: replace(i, now=i.now + 0.3, clock=i.clock + 0.3)),
        ("stopped", lambda i: replace(i, stopped=True)),
        ("jump", lambda i: _inbox(i.now, 1.2)),
        ("blind", lambda i: replace(i, scan=replace(i.scan, ranges=np.full_like(i.scan.ranges, np.nan)))),
        ("frozen", lambda i: replace(i, scan=replace(i.scan, ranges=np.full_like(i.scan.ranges, 2.0)))),
    ],
)  # fmt: skip
def test_the_gate_names_why_it_brakes(reason, fault):
    gate = _gate()
    assert gate.judge(_inbox(0.0)) == ()
    reasons = gate.judge(fault(_inbox(0.2, 0.1)))
    assert reason in reasons
    assert gate.passed((1.0, 0.5), reasons) == (0.0, 0.0)
    assert gate.counts[reason] == 1


def test_the_gate_brakes_before_its_fence():
    gate = _gate(geofence=(-2.0, -2.0, 2.0, 2.0))
    assert gate.judge(_inbox(0.0, 1.5)) == ()
    assert gate.judge(_inbox(0.2, 1.6)) == ("fence",)


def test_the_gate_limits_commands_and_never_softens_a_halt():
    drive, gate = FETCH.drive, _gate()
    assert gate.passed((math.nan, 0.0), ()) == (0.0, 0.0)
    assert gate.counts["command"] == 1
    speed, turn = gate.passed((9.0, -99.0), ())
    assert gate.counts["limited"] == 1
    assert speed == pytest.approx(drive.acceleration * CONTROL_PERIOD)
    assert turn == pytest.approx(-drive.turn_acceleration * CONTROL_PERIOD, abs=drive.turn_rate)
    for _ in range(20):
        speed, _ = gate.passed((9.0, 0.0), ())
    assert speed == drive.speed[1]
    assert gate.passed((0.0, 0.0), ()) == (0.0, 0.0)


@pytest.mark.parametrize("ahead", [0.6, 1.0, 3.0])
def test_the_gate_slows_down_to_stop_before_what_the_lidar_sees(ahead):
    gate, lidar = _gate(shape=False, margin=0.0), FETCH.lidar
    ranges = np.full(lidar.beams, lidar.max_range, np.float32)
    ranges[lidar.beams // 2] = ahead - lidar.mount[0]
    speed, turn = gate.passed((1.0, 0.0), (), ranges)
    stops = speed * CONTROL_PERIOD + speed**2 / (2 * FETCH.drive.acceleration)
    free = ahead - FETCH.footprint_radius
    assert turn == 0.0
    assert stops <= free
    assert speed == 1.0 if ahead == 3.0 else stops > free - 0.15
    assert gate.passed((0.0, 2.0), (), ranges) == (0.0, 2.0), "it may turn where it stands"
    ranges[:] = lidar.max_range
    ranges[lidar.beams // 4] = ahead
    assert gate.passed((1.0, 0.0), (), ranges) == (1.0, 0.0), "what is beside its path does not matter"


def test_the_watchdog_halts_wheels_that_hear_nothing():
    dog = Watchdog(FETCH.drive)
    assert dog.command(0.0) == (0.0, 0.0)
    dog.take((0.4, 0.1), 1.0)
    dog.take((math.inf, 0.1), 1.2)
    assert dog.command(1.0 + WATCHDOG - 0.1) == (0.4, 0.1)
    assert dog.command(1.0 + WATCHDOG) == (0.0, 0.0)


def test_an_agent_reads_of_its_teammates_their_poses_alone():
    members = {"members": [{"id": "fetch", "topics": {"scan": "base_scan"}}, {"id": "freight", "topics": {}}]}
    names = topic_names(parse_team(TEAM, skill="p2p"), 0, members)
    assert [topic for topic in names.read() if topic.startswith("/freight")] == ["/freight/amcl_pose"]
    assert names.scan == "/fetch/base_scan"
    assert names.stops == ("/fetch/hpp/stop", "/hpp/stop")
    assert Topics(namespace="/robots/a").full("odom", "x") == "/robots/a/odom"
    assert Topics(scan="/laser").full("/laser", "x") == "/laser"


def test_team_files_with_wrong_topics_and_gates_are_refused(tmp_path):
    from hpp_framework.config.team_file import read_team_file

    file = tmp_path / "team.yaml"
    member = "members:\n- {id: a, robot: fetch, "
    for text, message in (
        ("topics: {skan: x}}", "'members\\[0\\].topics.skan' is not a known key. Did you mean 'scan'"),
        ("gate: {stale: 0}}", "must be greater than 0"),
        ("gate: {geofence: [1, 0, 0, 1]}}", "encloses nothing"),
    ):
        file.write_text(member + text)
        with pytest.raises(ConfigError, match=message):
            read_team_file(file)


def test_a_backend_that_connects_to_nothing_is_refused():
    with pytest.raises(ConfigError, match="connects to no robots"):
        open_port("loopback", parse_team(TEAM, skill="p2p"), 0, {})
