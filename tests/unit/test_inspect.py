"""Decisions of a saved episode, their pictures, and the commands that make and show them."""

from __future__ import annotations

import csv
import json
import re
from base64 import b64decode
from dataclasses import replace

import numpy as np
import pytest

from hpp_framework.cli.main import main
from hpp_framework.core.world import World
from hpp_framework.utils.errors import ConfigError
from hpp_framework.viz.decisions import HORIZONS, decisions, goal_disagreement
from hpp_framework.viz.film import LAST_FRAMES, frames
from hpp_framework.viz.floor_plan import floor_plan
from hpp_framework.viz.inspection import Inspection, write_page, write_pictures
from hpp_framework.viz.marks import score_colors, score_range
from hpp_framework.viz.record import AgentRecord, EpisodeRecord, Plan
from hpp_framework.viz.record_file import FILE, save_record

PERIOD = 0.2
CANDIDATES = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], np.float32)


def plan(step, goal, scores=(3.0, 2.0, 1.0), candidates=CANDIDATES, count=2, speed=1.0):
    """Imagine that all robots drive along x at a speed, for 2 s."""
    times = np.arange(1, 11, dtype=np.float32) * PERIOD
    paths = np.zeros((len(candidates), 10, count, 2), np.float32)
    paths[..., 0] = speed * (times[:, None] + step * PERIOD)
    paths[..., 1] = np.arange(count)
    goal = np.array(goal, np.float32)
    return Plan(
        step=step, goal=goal, mean=goal, std=np.ones(2, np.float32), candidates=candidates,
        scores=np.array(scores, np.float32), paths=paths, times=times,
    )  # fmt: skip


def record(robots, *plans, steps=16, about=()):
    """Return an episode of robots that drive along x at 1 m/s; all agents make the same plans."""
    count = len(robots)
    poses = np.zeros((steps, count, 3), np.float32)
    poses[..., 0] = np.arange(steps)[:, None] * PERIOD
    poses[..., 1] = np.arange(count)
    goals = np.zeros((steps, 2), np.float32)
    for each in plans:
        goals[each.step :] = each.goal
    agents = tuple(
        AgentRecord(
            id=f"robot-{i}", robot=robot, seen=poses,
            scans=np.full((steps, robot.lidar.beams), 3.0, np.float32),
            goals=goals + np.float32(0.3 * i), resting=np.zeros(steps, bool), plans=plans,
        )
        for i, robot in enumerate(robots)
    )  # fmt: skip
    world = World(name="w", bounds=(-4, -4, 6, 6))
    return EpisodeRecord(
        about={
            "world": "w</script>", "planner": "hpp", "preset": "best", "team": "x", "backend": "batch",
            "seed": 0, "episode": 0, "success": False, "time_s": None, **dict(about),
        },
        period=PERIOD, ground=floor_plan(world, body_height=1.0), poses=poses, agents=agents,
    )  # fmt: skip


def test_decisions_come_by_time_and_say_what_changed(pair):
    told = record(
        pair, plan(0, (0.0, 0.0)), plan(5, (0.0, 0.0), (2.95, 3.0, 1.0)),
        plan(10, (1.0, 0.0), (2.0, 3.0, 1.0)),
        about={"planner_config": {"hysteresis": 0.1}},
    )  # fmt: skip
    found = decisions(told)
    assert [(d.plan.step, d.agent) for d in found] == [(0, 0), (0, 1), (5, 0), (5, 1), (10, 0), (10, 1)]
    assert [d.kind for d in found[::2]] == ["first", "kept", "changed"]
    assert found[0].why == "the best of 3 candidates"
    assert found[2].why == "the best of 3 candidates scores only 0.05 better, 0.1 would be needed"
    assert found[4].why == "the best of 3 candidates; moved by 1.00 m, 1.00 better than the goal before"
    assert found[4].moved == pytest.approx(1.0)
    assert found[4].top == (1, 0, 2)
    assert found[4].time == pytest.approx(2.0)
    assert found[0].disagreement == pytest.approx(np.hypot(0.3, 0.3), abs=1e-5)
    assert goal_disagreement(told, 3) == found[0].disagreement


def test_goals_off_the_candidates_and_rules_are_told_apart(pair):
    nothing = np.zeros((0, 2), np.float32)
    rule = [
        plan(0, (0.0, 0.0), (), nothing), plan(5, (0.0, 0.0), (), nothing), plan(10, (0.5, 0.0), (), nothing),
    ]  # fmt: skip
    whys = [d.why for d in decisions(record(pair, *rule))[::2]]
    assert whys == [
        "a rule sets the goal",
        "the rule's goal has not moved",
        "the rule's goal moved by 0.50 m",
    ]
    between = decisions(record(pair, plan(0, (0.3, 0.0))))[0]
    assert between.why == "the middle of the search; the nearest of 3 samples scores 0.00 below the best"
    far = decisions(record(pair, plan(0, (9.0, 0.0)), plan(5, (0.0, 0.0))))[2]
    assert far.why.endswith("the goal before is no candidate any more")


def test_prediction_errors_are_measured_where_both_are_known(pair):
    exact = decisions(record(pair, plan(0, (0.0, 0.0)), plan(10, (0.0, 0.0))))
    np.testing.assert_allclose(exact[0].errors[:2], 0, atol=1e-5)
    assert np.isnan(exact[0].errors[2]).all()  # 5 s: neither imagined nor happened
    np.testing.assert_allclose(exact[2].errors[0], 0, atol=1e-5)
    assert np.isnan(exact[2].errors[1]).all()  # 2 s after 2 s: the episode has ended
    slow = decisions(record(pair, plan(0, (0.0, 0.0), speed=0.5)))
    np.testing.assert_allclose(slow[0].errors[:2, 0], 0.5 * np.array(HORIZONS[:2]), atol=1e-5)


def test_scores_that_are_not_finite_are_left_out(pair):
    (first, _) = decisions(record(pair, plan(0, (1.0, 0.0), (np.nan, 1.0, -np.inf))))
    assert first.top == (1,)
    assert score_range(np.array([np.nan, 1.0, -np.inf])) == (1.0, 1.0)
    assert np.isnan(score_range(np.array([np.nan]))).all()
    dark, pale = score_colors(np.array([1.0, 0.0])).astype(int).sum(1)
    assert dark < pale - 200


@pytest.mark.parametrize("count", [1, 2, 3, 5, 7])
def test_films_of_any_team_have_one_size(pair, count):
    told = record((pair * 4)[:count], plan(0, (0.0, 0.0), count=count), steps=2)
    every = list(frames(told))
    assert len(every) == 3 + LAST_FRAMES
    assert {frame.shape for frame in every} == {every[0].shape}
    assert all(side % 2 == 0 for side in every[0].shape[:2])
    assert (every[0] != every[1]).any()


def test_films_show_the_camera_s_pictures(pair):
    sizes, seen = [], []

    def make(size):
        sizes.append(size)

        def camera(poses, goals, people, time):
            seen.append((poses, goals))
            return np.full((size[1], size[0], 3), 77, np.uint8)

        return camera

    every = list(frames(record(pair, plan(0, (0.0, 0.0)), steps=2), make))
    assert (every[0][100 : sizes[0][1], : sizes[0][0]] == 77).all()
    assert seen[1][0][0, 0] == pytest.approx(PERIOD / 2)
    assert seen[0][1].shape == (2, 2)


def test_the_page_holds_every_picture_and_needs_nothing_else(pair, tmp_path):
    told = record(pair, plan(0, (0.0, 0.0)), plan(5, (1.0, 0.0), (1.0, np.nan, 2.0)))
    found = decisions(told)
    inspection = Inspection(told, found)
    files = list(write_pictures(inspection, range(len(found)), tmp_path))
    assert [file.name for file in files] == [f"decision-00{i}.png" for i in range(4)]
    page = write_page(inspection, tmp_path).read_text()
    assert not re.search(r"(src|href)\s*=\s*[\"'](?!data:)|url\(|@import|fetch\(", page)
    data = json.loads(re.search(r'id="data">(.*?)</script>', page, re.S)[1])
    assert [b64decode(step["picture"]) for step in data["steps"]] == [file.read_bytes() for file in files]
    assert len(data["steps"][0]["cells"]) == len(data["heads"])
    assert page.count("</script>") == 2  # the name of the world did not end one


def test_a_run_is_kept_and_inspected(tmp_path, capsys, monkeypatch):
    from hpp_framework.evaluation import showcase

    monkeypatch.setattr(showcase, "write_video", lambda *_: None)
    out = tmp_path / "run"
    options = "--world simple --planner centralized-mp --backend batch --episode 3 --out"
    main(["run", *options.split(), str(out)])
    assert json.loads((out / "summary.json").read_text())["episode"] == 3
    capsys.readouterr()
    main(["inspect", str(out), "--step", "1"])
    said = capsys.readouterr().out
    assert "episode 3" in said
    assert "why: a rule sets the goal" in said
    assert [file.name for file in (out / "inspect").iterdir()] == ["decision-001.png"]
    again = tmp_path / "again"
    main(["run", "--config", str(out / "config.json"), "--out", str(again)])
    summaries = [json.loads((folder / "summary.json").read_text()) for folder in (out, again)]
    for summary in summaries:
        del summary["plan_ms_median"]
    assert summaries[0] == summaries[1]


def test_mistakes_are_said(pair, tmp_path, capsys):
    save_record(tmp_path / FILE, record(pair, plan(0, (0.0, 0.0))))
    for arguments, message in (
        ([str(tmp_path / "none.npz")], "there is no episode"),
        ([str(tmp_path), "--step", "2"], "it has 0 to 1"),
        ([str(tmp_path), "--out", str(tmp_path / FILE / "x")], "cannot write"),
    ):
        with pytest.raises(SystemExit) as stop:
            main(["inspect", *arguments])
        assert stop.value.code == 2
        assert message in capsys.readouterr().err


def test_a_run_s_episode_number_is_checked(tmp_path, capsys):
    from hpp_framework.evaluation.showcase import recorded_episode

    for content, message in (('{"episode": -1}', "0 or more"), ('{"episode": true}', "damaged")):
        (tmp_path / "config.json").write_text(content)
        with pytest.raises(ConfigError, match=message):
            recorded_episode(tmp_path / "config.json")
    with pytest.raises(SystemExit):
        main(["run", "--out", str(tmp_path / "out"), "--episode", "-1"])
    assert "0 or more" in capsys.readouterr().err


def test_an_episode_of_an_evaluation_is_run_again_as_it_was(tmp_path, monkeypatch):
    """Also where agents and sensors draw random numbers."""
    from hpp_framework.evaluation import showcase
    from hpp_framework.evaluation.experiment import Experiment, run_experiment

    monkeypatch.setattr(showcase, "write_video", lambda *_: None)
    experiment = Experiment(
        worlds=("simple",), planners=("centralized-rp",), episodes=3, seed=5001,
        disturbances="ideal:position_std=0.1",
    )  # fmt: skip
    run_experiment(experiment, tmp_path / "all")
    with (tmp_path / "all" / "episodes.csv").open() as stream:
        row = list(csv.DictReader(stream))[1]
    told = showcase.showcase(experiment, tmp_path / "one", episode=1, say=lambda _: None)
    assert told["success"] == bool(int(row["success"]))
    assert told["final_distance_m"] == pytest.approx(float(row["final_distance_m"]), abs=6e-4)


def test_records_without_plans_can_be_looked_at(pair, tmp_path):
    told = record(pair, steps=2)
    told = replace(told, agents=tuple(replace(a, goals=np.full_like(a.goals, np.nan)) for a in told.agents))
    assert decisions(told) == []
    assert len(list(frames(told))) == 3 + LAST_FRAMES
