"""Judging skills: outcomes, path lengths, the time bound, the competence map, and ``hpp evaluate skill``."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import asdict, replace

import numpy as np
import pytest
import torch

from hpp_framework.cli.evaluate import Evaluate
from hpp_framework.cli.main import main
from hpp_framework.core import geometry
from hpp_framework.core.robot import DriveLimits
from hpp_framework.core.skill import Skill
from hpp_framework.core.world import Box, Cylinder, World
from hpp_framework.evaluation import skill_study
from hpp_framework.evaluation.bootstrap import mean
from hpp_framework.evaluation.competence import competence_card, competence_map
from hpp_framework.evaluation.navigation_tasks import (
    CLEARANCES,
    DISTANCES,
    NavigationTasks,
    clearances,
    draw_navigation_tasks,
    navigation_task,
)
from hpp_framework.evaluation.path_bounds import path_lengths
from hpp_framework.evaluation.skill import drive_tasks, evaluate_skill, skill_episodes
from hpp_framework.evaluation.skill_score import SkillRow, score
from hpp_framework.evaluation.skill_study import SkillStudy, run_study
from hpp_framework.evaluation.statistics import Estimate
from hpp_framework.evaluation.table import read_rows, write_rows
from hpp_framework.evaluation.trial import Trial
from hpp_framework.sim import make_simulator
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.seeding import numpy_rng
from hpp_framework.worlds.occupancy import free_space

ROOM = World(name="room", bounds=(-10, -10, 10, 10))
STUDIO = World(name="studio", bounds=(-4, -4, 4, 4))
BOXED = World(name="boxed", bounds=(-10, -10, 10, 10), boxes=(Box(center=(0, 0), size=(2.0, 2.0)),))


class Still(Skill):
    """Stands."""

    def act(self, observation, goal):
        return torch.zeros(len(goal), 2)


class Circling(Skill):
    """Drives in circles."""

    def act(self, observation, goal):
        return torch.tensor([[1.0, 0.5]]).repeat(len(goal), 1)


class Straight(Skill):
    """Turns towards the goal and drives there as fast as it can, whatever stands in between."""

    def act(self, observation, goal):
        distance, bearing = geometry.polar(observation.pose, goal).unbind(-1)
        # 0.4 m/s^2 stop it at the goal, 1.48 rad/s^2 when it faces it
        speed = (2 * 0.4 * (distance - 0.25).clamp(min=0)).sqrt().clamp(max=1.0)
        turn = bearing.sign() * (1.48 * bearing.abs()).sqrt()
        return torch.stack([speed * (bearing.abs() < 0.5), turn], -1)


def tasks(world, robot, poses, goals) -> NavigationTasks:
    """Return navigation tasks between given places of a world."""
    ends = zip(np.array(poses, float), np.array(goals, float), strict=True)
    return NavigationTasks.of([navigation_task(world, robot, pose, goal) for pose, goal in ends])


def drive(skill, robot, known, **trial) -> list[SkillRow]:
    return skill_episodes(skill, robot, Trial(episodes=len(known), **trial), tasks=known)


def row(**values) -> SkillRow:
    """Return a row of a clean success, but for what is given."""
    usual = {
        "skill": "p2p", "world": "room", "episode": 0, "distance_m": 5.0, "clearance_m": 0.3,
        "shortest_m": 5.0, "bound_s": 8.0, "success": 1, "clean": 1, "collision": 0, "freeze": 0,
        "timeout": 0, "time_s": 10.0, "driven_m": 5.0, "left_m": 0.1, "spl": 0.9, "time_ratio": 1.25,
    }  # fmt: skip
    return SkillRow(**{**usual, **values})


@pytest.fixture
def small(register, small_world) -> str:
    """Register a small furnished room and return its name."""
    register("worlds", "small", lambda rng: small_world)
    return "small"


# outcomes


def test_who_stands_freezes_and_who_circles_times_out(fetch):
    known = tasks(ROOM, fetch, [[0, 0, 0]], [[5, 0]])
    still, circling = drive(Still(), fetch, known)[0], drive(Circling(), fetch, known)[0]
    assert (still.success, still.freeze, still.timeout, still.collision) == (0, 1, 0, 0)
    assert (circling.success, circling.freeze, circling.timeout, circling.collision) == (0, 0, 1, 0)
    assert still.driven_m == 0
    assert circling.driven_m > 30
    assert still.spl == circling.spl == 0
    assert math.isnan(still.time_s)
    assert math.isnan(still.time_ratio)


def test_a_box_in_between_is_hit_and_a_free_path_is_not(fetch):
    known = tasks(BOXED, fetch, [[-4, 0, 0], [-4, 4, 0]], [[4, 0], [4, 4]])
    blocked, free = drive(Straight(), fetch, known)
    assert (blocked.success, blocked.collision, blocked.clean, blocked.freeze) == (0, 1, 0, 1)
    assert (free.success, free.collision, free.clean) == (1, 0, 1)


def test_success_after_a_touch_is_not_clean(fetch):
    # the disc grazes a corner of the box, slides past it and goes on
    known = tasks(BOXED, fetch, [[-4, 1.2, 0]], [[4, 1.2]])
    (result,) = drive(Straight(), fetch, known)
    assert (result.success, result.collision, result.clean) == (1, 1, 0)


def test_a_touch_after_the_success_does_not_count(fetch):
    class Onwards(Straight):
        def act(self, observation, goal):
            self.steps = getattr(self, "steps", 0) + 1
            there = super().act(observation, goal)
            return there if self.steps < 100 else torch.tensor([[1.0, 0.0]]).repeat(len(goal), 1)

    far = [[-9, -9, 0]], [[9, 9]]
    known = tasks(ROOM, fetch, [[5, 0, 0], *far[0]], [[7, 0], *far[1]])
    simulator = make_simulator("batch", [fetch])
    drives = drive_tasks(Onwards(), simulator, known, slice(0, 2), Trial(episodes=2))
    assert int(drives.done[0]) > 0
    assert drives.collided.tolist() == [False, True]


# path lengths


def test_a_straight_drive_has_all_of_its_path_length(fetch):
    starts = [[0, 0, 0], [-5, -5, math.pi / 4]]
    rows = drive(Straight(), fetch, tasks(ROOM, fetch, starts, [[6, 0], [0, 0]]))
    assert [r.success for r in rows] == [1, 1]
    assert min(r.spl for r in rows) > 0.995
    assert max(r.spl for r in rows) <= 1


def test_a_detour_costs_path_length(fetch):
    class Detour(Straight):
        def act(self, observation, goal):
            over = observation.pose[:, 0] < 0
            return super().act(observation, torch.where(over[:, None], torch.tensor([[0.3, 4.0]]), goal))

    (result,) = drive(Detour(), fetch, tasks(ROOM, fetch, [[-4, 0, 0]], [[4, 0]]))
    assert result.success
    # two sides of a triangle, 4 m wide and 4 m high, and a wide turn
    assert 0.5 < result.spl < 8 / (2 * math.hypot(4, 4)) + 0.01


def exact_path_around_box(half: float, radius: float, start, goal) -> float:
    """Return the shortest path of a disc from left of a square to right of it, by tangents and arcs."""
    lengths = []
    for sign in (1, -1):
        (x0, y0), (x1, y1) = (start[0], start[1] * sign), (goal[0], goal[1] * sign)
        # around both upper corners: tangent, arc, side, arc, tangent
        total = 2 * half
        for x, y in ((-x0, y0), (x1, y1)):
            dx, dy = x - half, y - half
            away = math.hypot(dx, dy)
            total += math.sqrt(away**2 - radius**2)
            # angle at which the path leaves the corner, from straight up
            angle = math.atan2(dx, dy) - math.acos(radius / away)
            total += radius * max(angle, 0)
        lengths.append(total)
    return min(lengths)


def test_the_shortest_path_is_right_and_the_bound_is_less(rng):
    radius, count = 0.2877, 8
    space = free_space(BOXED, body_height=1.0)
    starts = np.stack([-rng.uniform(1.6, 8, count), rng.uniform(-0.9, 0.9, count)], -1)
    goals = np.stack([rng.uniform(1.6, 8, count), rng.uniform(-0.9, 0.9, count)], -1)
    ends = zip(starts, goals, strict=True)
    shortest, least = np.array([path_lengths(space, radius, *each, 0.3) for each in ends]).T
    exact = np.array([exact_path_around_box(1.0, radius, *ends) for ends in zip(starts, goals, strict=True)])
    np.testing.assert_allclose(shortest, exact, rtol=0.03)
    slack = exact - 0.3 - least
    assert (slack >= 0).all()
    assert (slack < 0.35 + 0.05 * exact).all()


def test_the_bounded_path_ends_at_the_disc_around_the_goal_even_through_a_wall(fetch):
    # one can be within 0.3 m of the goal on the other side of a gap that is too narrow to pass
    gate = World(
        name="gate",
        bounds=(-10, -10, 10, 10),
        cylinders=(Cylinder(center=(0, -0.27), radius=0.01), Cylinder(center=(0, 0.27), radius=0.01)),
        boxes=(Box(center=(0, -5.2), size=(0.01, 9.6)), Box(center=(0, 5.2), size=(0.01, 9.6))),
    )
    space = free_space(gate, body_height=1.0)
    _, least = path_lengths(space, 0.2877, np.array([-3.0, 0.0]), np.array([0.14, 0.0]), 0.3)
    assert least <= 2.87


# the time bound


def test_the_bound_of_a_straight_drive_is_its_trapezoid(fetch):
    known = tasks(ROOM, fetch, [[-4, 0, 0]], [[4, 0]])
    # 7.7 m at 0.4 m/s^2 up to 1 m/s and down to 0.15 m/s; then the second at rest, whole periods
    braking = (1 - 0.15**2) / 0.8
    exact = 1 / 0.4 + (7.7 - 1.25 - braking) / 1 + (1 - 0.15) / 0.4
    assert known.bound[0] == pytest.approx(math.ceil(exact / 0.2) * 0.2 + 0.8)


def test_backing_up_counts_if_it_is_faster(fetch):
    reversing = replace(fetch, drive=replace(fetch.drive, speed=(-2.0, 1.0)))
    forward = tasks(ROOM, fetch, [[0, 0, 0]], [[8, 0]])
    assert tasks(ROOM, reversing, [[0, 0, 0]], [[8, 0]]).bound[0] < forward.bound[0] - 1


class Greedy(Skill):
    """Uses all of its limits; half of the robots drive before they face the goal."""

    def __init__(self, limits: DriveLimits) -> None:
        self.limits = limits

    def act(self, observation, goal):
        limits = self.limits
        away, bearing = geometry.polar(observation.pose, goal).unbind(-1)
        # a control period passes before it brakes
        left = (away - 0.29 - observation.velocity[:, 0] * 0.2).clamp(min=0)
        speed = (2 * limits.acceleration * left + 0.14**2).sqrt().clamp(max=limits.speed[1])
        turn = bearing.sign() * 0.8 * (2 * limits.turn_acceleration * bearing.abs()).sqrt()
        eager = torch.linspace(0.3, 2.0, len(goal))
        return torch.stack([speed * (bearing.abs() < eager), turn], -1)


@pytest.mark.parametrize(
    "limits",
    [
        DriveLimits(speed=(0.0, 1.0), turn_rate=3.0, acceleration=0.4, turn_acceleration=1.48),
        DriveLimits(speed=(0.0, 0.4), turn_rate=0.6, acceleration=1.5, turn_acceleration=0.7),
        DriveLimits(speed=(0.0, 2.0), turn_rate=4.0, acceleration=2.0, turn_acceleration=5.0),
    ],
)
def test_no_drive_beats_the_bound_and_some_come_close(fetch, limits, rng):
    robot, count = replace(fetch, drive=limits), 96
    starts = np.stack([np.full(count, -7), np.zeros(count), rng.uniform(-np.pi, np.pi, count)], -1)
    goals = np.stack([rng.uniform(-6.6, 7, count), np.zeros(count)], -1)
    rows = drive(Greedy(limits), robot, tasks(ROOM, robot, starts, goals), steps=250)
    ratios = np.array([r.time_s / r.bound_s for r in rows if r.success])
    assert len(ratios) > count / 2
    assert ratios.min() > 1 - 1e-9
    assert ratios.min() < 1.05


def test_no_drive_around_obstacles_beats_the_bound(fetch, small):
    trial = Trial(episodes=40, goal_distance=(1.0, 8.0), seed=6001, world=small)
    ratios = [r.time_ratio for r in skill_episodes(Straight(), fetch, trial) if r.success]
    assert len(ratios) > 20
    assert 1 <= min(ratios) < 1.2


# tasks


def test_clearance_is_that_of_the_best_path(fetch):
    # a wall with a gap of 1.0 m: footprint 0.2877 and 0.21 m on either side
    wall = World(
        name="gap",
        bounds=(-6, -6, 6, 6),
        boxes=(Box(center=(0, -3.25), size=(0.2, 5.5)), Box(center=(0, 3.25), size=(0.2, 5.5))),
    )
    found = clearances(wall, fetch, np.array([[-3.0, 0]]), np.array([[3.0, 0], [-3.0, 3.0], [-3.0, -5.6]]))
    through, beside, at_wall = found[0].tolist()
    assert 0.125 <= through <= 0.21
    assert beside == 1.0
    assert 0.05 <= at_wall <= 0.12
    single = clearances(wall, fetch, np.array([[-3.0, 0]]), np.array([[3.0, 0]]))
    assert single[0, 0] == through


def test_tasks_are_as_asked_for(fetch):
    trial = Trial(episodes=4, seed=6001)
    known = draw_navigation_tasks(fetch, trial)
    assert ((known.distance >= 5) & (known.distance <= 10)).all()
    assert (known.clearance >= 0.15).all()
    assert (known.shortest >= known.distance - 1e-6).all()
    assert len(set(known.worlds)) == 4
    first = draw_navigation_tasks(fetch, replace(trial, episodes=2))
    torch.testing.assert_close(first.poses, known.poses[:2], rtol=0, atol=0)
    torch.testing.assert_close(first.goals, known.goals[:2], rtol=0, atol=0)


def test_even_tasks_fill_the_map(fetch, small):
    trial = Trial(episodes=60, goal_distance=(1.0, 8.0), clearance=0.05, draw="even", world=small)
    known = draw_navigation_tasks(fetch, trial)
    counts, _, _ = np.histogram2d(known.distance, known.clearance, (DISTANCES, (0, 0.05, 0.15, 0.3, 0.6, 9)))
    filled = counts[counts > 0]
    assert len(filled) >= 12
    # at times no point drawn is of the emptiest bin
    assert filled.max() - filled.min() <= 2


def test_a_goal_that_no_world_has_is_refused(fetch):
    with pytest.raises(ConfigError, match="'simple' has no goal 40 to 50 m away"):
        draw_navigation_tasks(fetch, Trial(world="simple", episodes=1, goal_distance=(40.0, 50.0)))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"episodes": 0}, "at least 1"),
        ({"goal_distance": (5.0, 4.0)}, "goal distance"),
        ({"goal_distance": (0.1, 4.0)}, "above 0.3"),
        ({"clearance": 0.01}, "clearance must be at least 0.05"),
    ],
)
def test_a_wrong_trial_is_refused(wrong, message):
    with pytest.raises(ConfigError, match=message):
        Trial(**wrong)


# numbers


def test_scores_are_shares_with_intervals():
    rows = [row()] * 17 + [row(success=0, clean=0, freeze=1, spl=0.0, time_s=math.nan)] * 3
    total = score(rows)
    assert (total.episodes, total.success, total.freeze, total.timeout) == (20, 0.85, 0.15, 0.0)
    for name in ("success", "clean", "collision", "freeze", "timeout", "spl"):
        values = asdict(total)
        assert 0 <= values[f"{name}_low"] <= values[name] <= values[f"{name}_high"] <= 1
    assert total.success_low == pytest.approx(0.6396, abs=1e-3)
    assert total.time_median_s == 10
    failed = score([row(success=0, time_s=math.nan)])
    assert failed.time_median_s is None
    assert "NaN" not in json.dumps(asdict(failed))


def test_the_bootstrap_interval_holds_the_mean_and_narrows(rng):
    values = rng.random(400)
    found = mean([values], numpy_rng(0, "bootstrap"))
    # 1.96 standard errors of a uniform variable are 0.0283
    assert found.low < found.value == values.mean() < found.high
    assert found.high - found.low == pytest.approx(2 * 0.0283, rel=0.15)
    assert mean([values], numpy_rng(0, "bootstrap")) == found
    assert mean([np.ones(5)], rng) == Estimate(1, 1, 1)


def test_the_interval_of_a_score_is_drawn_anew_the_same_every_time(rng):
    rows = [row(spl=value) for value in rng.random(30)]
    assert score(rows) == score(rows)
    drawn = mean([np.array([each.spl for each in rows])], numpy_rng(0, "bootstrap"), resamples=1000)
    assert (score(rows).spl_low, score(rows).spl_high) == (drawn.low, drawn.high)


@pytest.mark.parametrize(
    ("successes", "episodes", "trusted"), [(17, 20, True), (16, 20, False), (19, 19, False), (84, 100, False)]
)
def test_the_accept_rule(successes, episodes, trusted):
    rows = [row(success=int(i < successes)) for i in range(episodes)]
    (found,) = [each for each in competence_map(rows) if each.episodes]
    assert (found.distance_low, found.clearance_low, found.episodes) == (4.0, 0.3, episodes)
    assert found.trusted == trusted


def test_the_map_has_every_bin_and_sorts_edges_upwards():
    rows = [row(distance_m=2.0, clearance_m=0.15), row(distance_m=16.0), row(clearance_m=1.0)]
    bins = competence_map(rows)
    assert len(bins) == (len(DISTANCES) - 1) * (len(CLEARANCES) - 1)
    filled = [(b.distance_low, b.clearance_low, b.clearance_high) for b in bins if b.episodes]
    assert filled == [(2.0, 0.15, 0.3), (4.0, 0.6, None)]
    assert sum(b.episodes for b in bins) == 2


def test_the_card_is_json_without_empty_bins():
    card = competence_card([row() for _ in range(20)] + [row(world="barn", distance_m=1.5)])
    again = json.loads(json.dumps(card, allow_nan=False))
    assert again["summary"]["episodes"] == 21
    assert again["worlds"] == ["barn", "room"]
    assert [each["episodes"] for each in again["bins"]] == [1, 20]
    assert [each["trusted"] for each in again["bins"]] == [False, True]


def test_evaluate_skill_is_what_its_episodes_come_to(fetch, small):
    settings = {"world": small, "episodes": 6, "goal_distance": (2.0, 6.0), "seed": 6001}
    total = evaluate_skill(Straight(), fetch, steps=100, **settings)
    rows = skill_episodes(Straight(), fetch, Trial(steps=100, **settings))
    assert total == score(rows)
    assert json.loads(json.dumps(asdict(total)))["episodes"] == 6


@pytest.mark.sapien
def test_both_simulators_agree(fetch):
    known = tasks(
        BOXED, fetch, [[-4, 4, 1.0], [-4, 0, 0], [0, -5, 2.0], [5, 5, -2.0]],
        [[4, 4], [4, 0], [5, -5], [5, 1]],
    )  # fmt: skip
    batch = drive(Straight(), fetch, known, steps=100)
    sapien = drive(Straight(), fetch, known, steps=100, backend="sapien")
    for one, other in zip(batch, sapien, strict=True):
        assert (one.success, one.collision, one.freeze) == (other.success, other.collision, other.freeze)
        assert one.driven_m == pytest.approx(other.driven_m, abs=0.1)
        assert not one.success or abs(one.time_s - other.time_s) < 0.41
    assert [one.success for one in batch] == [1, 0, 1, 1]


# the command

COMMAND = "evaluate skill straight --worlds room --episodes 3 --goal-distance 2 6 --seed 6001 --steps 100"


@pytest.fixture
def straight(register):
    """Register the skill ``straight``, ``still`` and the world ``room``."""
    register("skills", "straight", lambda robot: Straight())
    register("skills", "still", lambda robot: Still())
    register("worlds", "room", lambda rng: STUDIO)


@pytest.mark.usefixtures("straight")
def test_the_command_writes_tables_and_a_picture(tmp_path, capsys):
    main([*COMMAND.split(), "--compare", "still", "--out", str(tmp_path)])
    rows = read_rows(tmp_path / "episodes.csv", SkillRow)
    assert [(r.skill, r.episode) for r in rows] == [(s, e) for s in ("straight", "still") for e in range(3)]
    assert [r.success for r in rows] == [1, 1, 1, 0, 0, 0]
    # both drove the same tasks
    assert [r.shortest_m for r in rows[:3]] == [r.shortest_m for r in rows[3:]]
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert [(cell["skill"], cell["summary"]["success"]) for cell in summary] == [
        ("straight", 1),
        ("still", 0),
    ]
    with (tmp_path / "competence.csv").open() as stream:
        table = list(csv.DictReader(stream))
    assert len(table) == 60
    assert sum(int(line["episodes"]) for line in table) == 6
    assert (tmp_path / "competence.png").read_bytes().startswith(b"\x89PNG")
    shown = capsys.readouterr().out
    assert "straight" in shown
    assert "1.000" in shown


@pytest.mark.usefixtures("straight")
def test_a_table_reads_back_as_it_was_written(tmp_path):
    rows = [row(time_s=math.nan, world="a, b.yaml"), row(episode=1)]
    write_rows(tmp_path / "episodes.csv", rows, SkillRow)
    again = read_rows(tmp_path / "episodes.csv", SkillRow)
    assert again[1] == rows[1]
    assert again[0].world == "a, b.yaml"
    assert math.isnan(again[0].time_s)
    (tmp_path / "episodes.csv").write_text("skill,world\np2p,room\n")
    with pytest.raises(ConfigError, match="damaged"):
        read_rows(tmp_path / "episodes.csv", SkillRow)


@pytest.mark.usefixtures("straight")
def test_an_interrupted_study_resumes_to_the_same_tables(tmp_path, monkeypatch):
    study = SkillStudy(
        skills=("straight", "still"), robot="fetch", worlds=("room",), episodes=3, steps=60, seed=6001
    )
    whole = run_study(study, tmp_path / "whole")
    actual, driven = skill_study.skill_episodes, []

    def interrupted(*arguments, **named):
        if driven:
            raise KeyboardInterrupt
        driven.append(named["name"])
        return actual(*arguments, **named)

    monkeypatch.setattr(skill_study, "skill_episodes", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_study(study, tmp_path / "parts")
    kept = read_rows(tmp_path / "parts" / "episodes.csv", SkillRow)
    assert {r.skill for r in kept} == {"straight"}
    again = []
    monkeypatch.setattr(
        skill_study, "skill_episodes", lambda *a, **k: again.append(k["name"]) or actual(*a, **k)
    )
    assert run_study(study, tmp_path / "parts") == whole
    assert again == ["still"]
    for name in ("episodes.csv", "competence.csv", "summary.json", "config.json"):
        assert (tmp_path / "parts" / name).read_text() == (tmp_path / "whole" / name).read_text()


@pytest.mark.usefixtures("straight")
def test_a_folder_of_something_else_is_refused(tmp_path, capsys):
    main([*COMMAND.split(), "--out", str(tmp_path)])
    for other in (
        "evaluate --worlds simple --planners centralized-mp --episodes 1",
        COMMAND + " --backend sapien",
    ):
        with pytest.raises(SystemExit) as stop:
            main([*other.split(), "--out", str(tmp_path)])
        assert stop.value.code == 2
        assert "holds another experiment" in capsys.readouterr().err


# (arguments, what the message must contain)
MISTAKES = [
    ("evaluate skill p3p", ["no skill", "'p3p'"]),
    ("evaluate skill p2p --robot fletch", ["no robot", "'fetch'"]),
    ("evaluate skill p2p --worlds trainin", ["'training'"]),
    ("evaluate skill p2p --worlds wall,wall", ["'wall' twice"]),
    ("evaluate skill p2p --compare p2p", ["'p2p' twice"]),
    ("evaluate skill p2p --backend gazebo", ["gazebo", "sapien"]),
    ("evaluate skill straight --worlds room --episodes 0", ["at least 1"]),
    ("evaluate skill straight --worlds room --goal-distance 9 2", ["goal distance"]),
    ("evaluate skill straight --worlds room --goal-distance 40 50", ["no goal 40 to 50 m away"]),
    ("evaluate skill straight --worlds room --disturbances ideal:position_std=-1", ["position_std"]),
    ("evaluate skill straight --worlds nowhere.yaml", ["nowhere.yaml"]),
    ("evaluate skill straight --worlds room --out /proc/nothing", ["cannot write to"]),
    ("evaluate --episodes 3 skill straight", ["come after", "--episodes"]),
]


@pytest.mark.usefixtures("straight")
@pytest.mark.parametrize(("command", "expected"), MISTAKES, ids=[m[0] for m in MISTAKES])
def test_a_mistake_gets_a_clear_message(command, expected, refused):
    refused(command, expected)


@pytest.mark.usefixtures("straight")
def test_a_robot_without_weights_is_one_line(register, fetch, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    register("robots", "cart", lambda: replace(fetch, name="cart"))
    with pytest.raises(SystemExit) as stop:
        main(["evaluate", "skill", "p2p", "--robot", "cart"])
    assert stop.value.code == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert "no weights 'cart.safetensors' of skill 'p2p'" in message
    assert "hpp onboard cart" in message


def test_planners_are_compared_unless_skills_are_asked_for(monkeypatch):
    called = []
    monkeypatch.setattr(Evaluate, "run", lambda command: called.append(command))
    main(["evaluate", "--worlds", "wall", "--disturbances", "ideal:position_std=0.1"])
    main(
        [
            "evaluate",
            "skill",
            "dwa",
            "--worlds",
            "barn",
            "--disturbances",
            "harsh",
            "--goal-distance",
            "5",
            "10",
        ]
    )
    teams, skills = called
    assert teams.judge is None
    assert (teams.worlds, teams.disturbances) == ("wall", "ideal:position_std=0.1")
    assert (skills.judge.name, skills.judge.worlds, skills.judge.disturbances) == ("dwa", "barn", "harsh")
    assert skills.judge.goal_distance == (5.0, 10.0)
