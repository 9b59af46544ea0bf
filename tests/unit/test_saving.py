"""Keeping chosen episodes of an evaluation."""

from __future__ import annotations

import csv
import math
from dataclasses import replace

import pytest

from hpp_framework.cli.main import main
from hpp_framework.evaluation.rows import EpisodeRow
from hpp_framework.evaluation.saving import check_choice, choose
from hpp_framework.utils.errors import ConfigError
from hpp_framework.viz.record_file import load_record

COMMAND = ["evaluate", "--worlds", "simple", "--planners", "centralized-mp,centralized-rp", "--episodes", "4"]


def row(episode, *, rpl, collided=0, far=1.0):
    won = not math.isnan(rpl) and rpl > 0
    return EpisodeRow(
        world="w", planner="p", episode=episode, success=int(won), time_s=5.0 if won else math.nan,
        first_contact=int(won), first_contact_s=5.0, collided=collided, touched_obstacle=collided,
        touched_robot=0, final_distance_m=far, steps=100, plan_ms=1.0, bound_s=4.0, rpl=rpl, goal_gap_m=0.0,
        agreement_s=0.0, side_flips=0, chase=0.0,
    )  # fmt: skip


ROWS = [
    row(0, rpl=0.5), row(1, rpl=0.0, far=6.0), row(2, rpl=0.9, collided=1), row(3, rpl=0.0, far=2.0),
    row(4, rpl=0.7), row(5, rpl=0.8),
]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        ("failures", [1, 3]),
        ("touched", [2]),
        ("best", [2, 4, 5]),
        ("median", [0]),
        ("worst", [0, 1, 3]),
        ("all", [0, 1, 2, 3, 4, 5]),
        ("touched, 4,4", [2, 4]),
    ],
)
def test_words_and_numbers_choose_episodes(text, numbers):
    check_choice(text, len(ROWS))
    assert choose(text, ROWS) == numbers


def test_the_worst_failure_is_the_one_farthest_apart():
    many = [row(i, rpl=0.0, far=float(i)) for i in range(5)]
    assert choose("worst", many) == [2, 3, 4]


def test_failures_read_from_a_file_are_ordered_too():
    """Every NaN of a file is an object of its own, and equal to none."""
    far = [3.0, 1.0, 5.0, 2.0, 4.0]
    many = [replace(row(i, rpl=0.0, far=metres), time_s=float("nan")) for i, metres in enumerate(far)]
    assert choose("worst", many) == [0, 2, 4]


@pytest.mark.parametrize(("text", "said"), [("failure", "failures, touched"), ("6", "of 6"), ("", "numbers")])
def test_what_names_no_episode_is_refused(text, said):
    with pytest.raises(ConfigError, match=said):
        check_choice(text, len(ROWS))


def test_saved_episodes_are_those_of_the_evaluation(tmp_path, capsys):
    command = [*COMMAND, "--out", str(tmp_path), "--save", "2,worst"]
    main(command)
    assert "saved:" in capsys.readouterr().out
    with (tmp_path / "episodes.csv").open() as stream:
        rows = {(r["planner"], int(r["episode"])): r for r in csv.DictReader(stream)}
    files = sorted((tmp_path / "saved" / "simple").rglob("*.npz"))
    assert {file.parent.name for file in files} == {"centralized-mp", "centralized-rp"}
    assert {file.stem for file in files} >= {"00002"}
    for file in files:
        about = load_record(file).about
        found = rows[about["planner"], about["episode"]]
        assert about["success"] is bool(int(found["success"]))
        assert about["time_s"] is None or about["time_s"] == float(found["time_s"])
        assert about["final_distance_m"] == pytest.approx(float(found["final_distance_m"]), abs=1e-3)
    before = {file: file.stat().st_mtime_ns for file in files}
    main(command)
    assert {file: file.stat().st_mtime_ns for file in files} == before, "what is there is kept"


def test_a_wrong_choice_is_refused_before_anything_runs(tmp_path, capsys):
    with pytest.raises(SystemExit):
        main([*COMMAND, "--out", str(tmp_path / "new"), "--save", "wurst"])
    assert "wurst" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()
