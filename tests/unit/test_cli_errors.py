"""Wrong input gets one clear line and a non-zero exit, never a traceback."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from rich.console import Console

from hpp_framework.cli.evaluate import Evaluate
from hpp_framework.cli.evaluate_skill import TABLE_WIDTH, skill_table
from hpp_framework.cli.evaluate_tables import blame_table, comparison_table, summary_table
from hpp_framework.cli.main import main
from hpp_framework.cli.run import Run
from hpp_framework.plugins.registry import hub
from hpp_framework.plugins.weights import load_checkpoint, save_checkpoint

WORLD = "name: room\nbounds: [-5, -5, 5, 5]\n"

# (arguments, what the message must contain)
MISTAKES = [
    ("run --world wal", ["no world", "'wall'"]),
    ("run --world nowhere.yaml", ["nowhere.yaml"]),
    ("run --team fetch,frieght", ["no robot", "'freight'"]),
    ("run --team ,", ["empty entry"]),
    ("run --team fetch,,freight", ["empty entry"]),
    ("run --team a=fetch,a=freight", ["id 'a'", "twice"]),
    ("run --team =fetch", ["id=robot"]),
    ("run --planner hp", ["no planner", "'hpp'"]),
    ("run --preset bset", ["no preset", "'best'"]),
    ("run --task rendevous", ["no task", "'rendezvous'"]),
    ("run --skill p2", ["no skill", "'p2p'"]),
    ("run --backend gazebo", ["gazebo", "sapien"]),
    ("run --seed one", ["one"]),
    ("run --disturbances ideal:position_std=-1", ["position_std", "at least 0"]),
    ("run --disturbances field:lost_beams=1.5", ["lost_beams"]),
    ("run --disturbances filed", ["Did you mean 'field'"]),
    ("run --disturbances field:wind=1", ["'wind'", "disturbances"]),
    ("run --estimator tracked", ["Did you mean 'tracker'"]),
    ("run --estimator none:noise=2", ["has no settings"]),
    (f"run --team {','.join(['fetch'] * 30)} --world {{tiny}}", ["no room for 30 robots"]),
    ("evaluate --worlds simple,simple", ["'simple' twice"]),
    ("evaluate --planners hpp,,centralized-mp", ["empty entry"]),
    ("evaluate --planners centralised-mp", ["'centralized-mp'"]),
    ("evaluate --planners centralized-mp --preset bset", ["no preset", "'best'"]),
    ("evaluate --config nowhere.json", ["nowhere.json"]),
    ("evaluate --episodes 0 --planners centralized-mp", ["episodes must be at least 1"]),
    ("evaluate --worlds {bad}", ["bad.yaml", "boxs", "boxes"]),
    ("list robot", ["'robots'"]),
    ("collect --team fetch --trajectories 0", ["'trajectories' must be at least 1"]),
    ("collect --team fetch --world trainin", ["'training'"]),
    ("train skill p3p --robot fetch", ["'p2p'"]),
    ("train skill p2p --robot fletch", ["'fetch'"]),
    ("train skill p2p --robot fetch --init frieght", ["weights file or robot", "'frieght'", "'freight'"]),
    ("train skill p2p --robot fetch --init frieght.safetensors", ["'frieght.safetensors' does not exist"]),
    ("train skill p2p --robot fetch --steps 0", ["--steps must be at least 1"]),
    ("train predictor delta-pose --data {empty}", ["'delta-pose-lidar'"]),
    ("train predictor delta-pose-lidar --data {empty}", ["not a data set", "hpp collect"]),
    ("fly", ["fly"]),
    ("run --wrold wall", ["--wrold"]),
]  # fmt: skip


@pytest.mark.parametrize(("command", "expected"), MISTAKES, ids=[m[0][:60] for m in MISTAKES])
def test_a_mistake_gets_a_clear_message(command, expected, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.yaml").write_text(WORLD + "boxs:\n  - {center: [0, 0], size: [1, 1]}\n")
    (tmp_path / "tiny.yaml").write_text(WORLD)
    (tmp_path / "empty").mkdir()
    filled = command.format(bad="bad.yaml", tiny="tiny.yaml", empty="empty")
    with pytest.raises(SystemExit) as stop:
        main(filled.split())
    captured = capsys.readouterr()
    message = " ".join((captured.err + captured.out).split())
    assert stop.value.code not in (0, None)
    assert "Traceback" not in message
    for part in expected:
        assert part in message


def test_out_is_a_file(tmp_path, capsys):
    (tmp_path / "taken").write_text("")
    with pytest.raises(SystemExit):
        main(["run", "--out", str(tmp_path / "taken")])
    assert "cannot write to" in capsys.readouterr().err


def test_read_only_folder(capsys):
    # not even root may write here
    with pytest.raises(SystemExit) as stop:
        main(["evaluate", "--planners", "centralized-mp", "--out", "/proc/nothing"])
    assert stop.value.code == 2
    assert "cannot write to" in capsys.readouterr().err


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_full_disk(tmp_path, monkeypatch, capsys):
    (tmp_path / "episodes.csv.tmp").symlink_to("/dev/full")
    with pytest.raises(SystemExit) as stop:
        main(f"evaluate --worlds simple --planners centralized-mp --episodes 1 --out {tmp_path}".split())
    assert stop.value.code == 2
    message = capsys.readouterr().err
    assert "No space left" in message
    assert "kept" in message


def test_another_experiment_in_the_folder(tmp_path, capsys):
    command = (
        f"evaluate --worlds simple --planners centralized-mp --episodes 1 --out {tmp_path} --seed".split()
    )
    main([*command, "1"])
    with pytest.raises(SystemExit):
        main([*command, "2"])
    assert "another experiment (seed differ)" in capsys.readouterr().err


def test_weights_of_another_robot_and_damaged_weights(tmp_path):
    from hpp_framework.utils.errors import CheckpointError

    load = hub().skills.entry("p2p").factory()
    fetch, freight = hub().robots.create("fetch"), hub().robots.create("freight")
    file = tmp_path / "fetch.safetensors"
    save_checkpoint(file, load(fetch).network.state_dict(), {"skill": "p2p", "robot": "fetch"})
    with pytest.raises(CheckpointError, match="made for robot = 'fetch', but 'freight'"):
        load(freight, file)
    file.write_bytes(b"not weights")
    with pytest.raises(CheckpointError, match="cannot be read"):
        load_checkpoint(file, {})


@pytest.mark.parametrize(("command", "resumes"), [(Evaluate, True), (Run, False)])
def test_an_interruption_says_whether_the_command_resumes(command, resumes, monkeypatch, capsys):
    def interrupt(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "run", interrupt)
    with pytest.raises(SystemExit) as stop:
        main([command.__name__.lower()])
    assert stop.value.code == 130
    assert ("the same command resumes" in capsys.readouterr().err) == resumes


def test_messages_are_not_markup(capsys):
    """A message with brackets, such as `pip install 'x[y]'`, is printed as it is."""
    console = Console(width=200)
    row = {
        "world": "[red]room[/].yaml", "planner": "[bold]p", "success": 0.5, "success_low": 0.1,
        "success_high": 0.9, "first_contact": 0.5, "time_median_s": None, "time_over_bound_median": None,
        "rpl": 0.0, "price_median": None, "collision_episodes": 0, "episodes": 1,
        "final_distance_mean_m": 1.0, "plan_ms_median": 1.0,
    }  # fmt: skip
    console.print(summary_table([row]))
    shown = capsys.readouterr().out
    versus = {
        **row, "against": "[b]q", "success_difference": [0.1, -0.1, 0.3], "improvement": [0.6, 0.5, 0.7],
        "success_p": 0.5, "time_ratio_median": None, "time_p": None,
    }  # fmt: skip
    console.print(comparison_table([versus]))
    assert "[b]q" in capsys.readouterr().out
    lost = {part: [0.1, 0.0, 0.2] for part in ("silence", "predictor", "skill")}
    console.print(blame_table([{**row, **lost}]))
    assert "[red]room[/].yaml" in capsys.readouterr().out
    assert "[red]room[/].yaml" in shown
    assert "[bold]p" in shown


def test_long_names_of_skills_are_shown_whole(capsys):
    score = {
        "success": 0.975, "success_low": 0.871, "success_high": 0.996, "clean": 0.9, "collision": 0.1,
        "freeze": 0.0, "spl": 0.9, "spl_low": 0.8, "spl_high": 0.95, "time_median_s": 12.3,
        "time_ratio_median": 1.1,
    }  # fmt: skip
    about = {
        "robot": "freight", "world": "training", "episodes": 40, "backend": "batch", "seed": 0,
        "draw": "even", "clearance": 0.05, "goal_distance": (1.0, 15.0), "summary": score,
        "bins": [{"trusted": False}] * 12,
    }  # fmt: skip
    rows = [
        {**about, "skill": "my-skill/cautious"},
        {**about, "skill": "a-package-of-long-names/" + "x" * 30},
    ]
    Console(width=TABLE_WIDTH).print(skill_table(rows))
    shown = capsys.readouterr().out
    assert "my-skill/cautious" in shown
    assert "trusted bins" in shown
    assert "…" not in shown


def test_the_installed_command_prints_no_traceback():
    done = subprocess.run(
        [str(Path(sys.executable).with_name("hpp")), "run", "--world", "wal"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr.startswith("hpp: There is no world called 'wal'. Did you mean 'wall'?")
