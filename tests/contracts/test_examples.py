"""The programs in examples run, at tiny scale, and stay short."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import pytest

from hpp_framework.plugins.registry import hub

FOLDER = Path(__file__).parents[2] / "examples"
RUNS = {
    "sb3_goals": (["--steps", "4", "--episodes", "1", "--options", "p2p,pure-pursuit"], "after 4 goals"),
    "marl_pettingzoo": (["--steps", "64"], "64 steps of 2 robots"),
    "custom_task": (["--episodes", "1"], "1.00 of 1 episodes"),
    "team_of_eight": (
        ["--robots", "3", "--episodes", "1", "--planner", "centralized-mp"],
        "3 robots in simple",
    ),
}


@pytest.fixture
def forget_tasks():
    before = set(hub().tasks._entries)
    yield
    for name in set(hub().tasks._entries) - before:
        del hub().tasks._entries[name]


@pytest.mark.parametrize("name", RUNS)
@pytest.mark.usefixtures("forget_tasks")
def test_example_runs(name, monkeypatch, capsys, tmp_path):
    if name == "marl_pettingzoo":
        pytest.importorskip("supersuit", reason="needs the extra 'examples'")
    options, words = RUNS[name]
    monkeypatch.setattr(sys, "argv", [name, *options])
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(FOLDER / f"{name}.py"), run_name="__main__")
    assert words in capsys.readouterr().out


def test_examples_are_short_and_named():
    programs = sorted(FOLDER.glob("*.py"))
    assert [program.stem for program in programs] == sorted(RUNS)
    for program in programs:
        assert len(program.read_text().splitlines()) < 80
        assert program.name in (FOLDER / "README.md").read_text()
