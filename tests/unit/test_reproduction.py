"""The plan of a reproduction, how it resumes, and how verdicts come from results made by hand."""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import sys
import time
from contextlib import closing
from dataclasses import asdict
from pathlib import Path

import pytest
import tyro

from hpp_framework.cli.evaluate import Evaluate
from hpp_framework.cli.main import main
from hpp_framework.cli.options import names, to_experiment
from hpp_framework.evaluation.experiment import Experiment, read_experiment
from hpp_framework.evaluation.folder import CONFIG, EVALUATE, open_evaluation, record
from hpp_framework.evaluation.predictor_study import PredictorStudy
from hpp_framework.evaluation.rows import EpisodeRow
from hpp_framework.evaluation.statistics import Estimate
from hpp_framework.evaluation.table import read_rows, write_rows
from hpp_framework.reproduction.claims import Claim, Part, verdict
from hpp_framework.reproduction.experiments import BEST, PAPER, SCALES, SCANNED, SIMULATED, experiments
from hpp_framework.reproduction.judge import verdict_lines, write_claims
from hpp_framework.reproduction.measures import Arm, Measures
from hpp_framework.reproduction.plan import Curves, choose, write_plan
from hpp_framework.reproduction.run import reproduce
from hpp_framework.reproduction.statements import claims
from hpp_framework.utils.errors import ConfigError, UnknownNameError

NAN = float("nan")


@pytest.mark.parametrize("scale", SCALES)
def test_the_plan_is_complete_and_unique(scale):
    planned = experiments(scale, 0)
    assert len({each.name for each in planned}) == len(planned)
    assert len({(each.command().partition("--out")[0]) for each in planned}) == len(planned)
    main_work = planned[0].work
    assert isinstance(main_work, Experiment)
    assert {"hpp", "hpp:preset=paper", "maddpg", "rrt-mp", "rrt-cem:known_map=true", "perfect-model"} <= set(
        main_work.planners
    )
    assert len(set(main_work.planners)) == len(main_work.planners)
    if scale != "smoke":
        assert main_work.worlds == (*SIMULATED, *SCANNED)
    figures = " ".join(each.figure or "" for each in planned)
    for number in (4, 5, 7, 8, 9, 10, 11, 12):
        assert str(number) in figures


def test_every_claim_rests_on_experiments_of_the_plan(tmp_path):
    known = {each.name for each in experiments("full", 0)}
    found = claims(tmp_path)
    assert {name for claim in found for name in claim.experiments} <= known
    assert len({claim.claim for claim in found}) == len(found)
    assert all(not claim.parts for claim in found)
    assert {row["verdict"] for row in write_claims(tmp_path)} == {"not measured"}


def test_every_arm_of_a_claim_is_in_the_plan_at_full_scale(tmp_path, monkeypatch):
    planned = {each.name: each.work for each in experiments("full", 0)}
    asked: set[tuple[Arm, str]] = set()

    def remember(self, arm, world):
        asked.add((arm, world))
        return {}

    monkeypatch.setattr(Measures, "episodes", remember)
    claims(tmp_path)
    for arm, world in asked:
        work = planned[arm.experiment]
        assert isinstance(work, Experiment)
        assert arm.planner in work.planners
        assert world in work.worlds
    assert len(asked) > 60


@pytest.mark.parametrize("scale", SCALES)
def test_the_commands_repeat_the_experiments(scale, tmp_path):
    for each in experiments(scale, 3):
        if isinstance(each.work, Curves):
            continue
        program, command, *options = shlex.split(each.command())
        assert (program, command) == ("hpp", "evaluate")
        read = tyro.cli(Evaluate, args=options, config=(tyro.conf.FlagConversionOff,))
        if isinstance(each.work, Experiment) and each.work.members:
            assert read.config == each.folder(Path()) / CONFIG
            recorded = tmp_path / each.name
            open_evaluation(recorded, record(EVALUATE, asdict(each.work), {}))
            assert read_experiment(recorded / CONFIG, "evaluate") == each.work
            continue
        if isinstance(each.work, PredictorStudy):
            judged = read.judge
            assert (judged.name, *names(judged.compare, "--compare")) == each.work.predictors
            assert (judged.trajectories, judged.seed) == (each.work.trajectories, 3)
            assert names(judged.worlds, "--worlds") == each.work.worlds
            continue
        again = to_experiment(
            read, "evaluate", worlds=names(read.worlds, "-"), planners=names(read.planners, "-"),
            episodes=read.episodes,
        )  # fmt: skip
        assert again == each.work


def test_names_are_checked_and_folders_kept_apart(tmp_path):
    planned = experiments("smoke", 0)
    assert [each.name for each in choose(planned, ["losses", "frequency"])] == ["frequency", "losses"]
    with pytest.raises(UnknownNameError, match="frequency"):
        choose(planned, ["frequenzy"])
    write_plan(tmp_path, "smoke", 0, planned)
    write_plan(tmp_path, "smoke", 0, planned)
    with pytest.raises(ConfigError, match="another reproduction \\(seed"):
        write_plan(tmp_path, "smoke", 1, experiments("smoke", 1))


def row(planner: str, world: str, episode: int, time_s: float, **more: float) -> EpisodeRow:
    values = {
        "success": int(time_s == time_s), "first_contact": 0, "first_contact_s": NAN, "collided": 0,
        "touched_obstacle": 0, "touched_robot": 0, "final_distance_m": 1.0, "steps": 100, "plan_ms": 1.0,
        "bound_s": 4.0, "rpl": 0.0, "goal_gap_m": 0.0, "agreement_s": 0.0, "side_flips": 0, "chase": 0.0,
    }  # fmt: skip
    return EpisodeRow(world=world, planner=planner, episode=episode, time_s=time_s, **{**values, **more})


@pytest.fixture
def measures(tmp_path):
    """Of a hundred episodes by hand: a always meets, b in every fifth, c as a but later, d in ten only."""
    rows = [row("a", "wall", e, 5.0, chase=0.1, final_distance_m=0.5) for e in range(100)]
    rows += [row("b", "wall", e, 5.0 if e % 5 == 0 else NAN, chase=0.5 + 0.001 * e) for e in range(100)]
    rows += [row("c", "wall", e, 6.0) for e in range(100)]
    rows += [row("d", "wall", e, 5.0) for e in range(10)]
    rows += [row("a", "simple", e, 5.0 if e % 2 else NAN) for e in range(100)]
    write_rows(tmp_path / "experiments" / "main" / "episodes.csv", rows, EpisodeRow)
    return Measures(tmp_path)


A, B, C, D = (Arm("main", name) for name in "abcd")


@pytest.mark.parametrize(
    ("measure", "arguments", "outcome"),
    [
        ("more_success", (A, B, "wall"), "yes"),
        ("more_success", (B, A, "wall"), "no"),
        ("more_success", (A, C, "wall"), "no"),  # no advantage to speak of
        ("more_success", (D, B, "wall"), "open"),  # too few
        ("better", (A, C, "wall"), "yes"),
        ("better", (C, A, "wall"), "no"),
        ("better", (A, A, "wall"), "no"),
        ("alike", (A, C, "wall"), "yes"),
        ("alike", (A, B, "wall"), "no"),
        ("fails", (B, "wall"), "yes"),
        ("fails", (B, "wall", 0.1), "no"),
        ("fails", (A, "wall"), "no"),
        ("fails", (A, "simple"), "open"),
        ("completes", (A, "wall"), "yes"),
        ("completes", (B, "wall"), "no"),
        ("chases_more", (B, A, "wall"), "yes"),
        ("chases_more", (A, B, "wall"), "no"),
        ("closer", (A, B, "wall"), "yes"),
        ("harder", (A, "simple", "wall"), "yes"),
        ("harder", (A, "wall", "simple"), "no"),
    ],
)
def test_measures_decide_by_their_intervals(measures, measure, arguments, outcome):
    assert getattr(measures, measure)(*arguments).outcome == outcome


def test_what_was_not_run_is_no_part(measures):
    elsewhere = Arm("frequency", "a")
    assert measures.better(A, elsewhere, "wall") is None
    assert measures.fails(A, "navigation") is None
    assert measures.larger(A, C, "wall", "simple") is None


def parts(*outcomes: str) -> list[Part]:
    return [Part(about=str(i), found=Estimate(0, 0, 0), outcome=o) for i, o in enumerate(outcomes)]


@pytest.mark.parametrize(
    ("outcomes", "expected"),
    [
        ((), "not measured"),
        (("open", "open"), "undecided"),
        (("yes", "yes"), "holds"),
        (("yes", "open"), "holds partly"),
        (("yes", "no"), "holds partly"),
        (("no", "open"), "does not hold"),
        (("no",), "does not hold"),
    ],
)
def test_verdicts(outcomes, expected):
    assert verdict(parts(*outcomes)) == expected


def test_the_evidence_of_many_parts_names_the_exceptions():
    many = parts(*["yes"] * 20, "no")
    text = Claim(claim="x", where="y", rule="Rule:", parts=many, experiments=["main"], missing=2).evidence()
    assert "20 of 21 do" in text
    assert "The others: 20: 0.00 (0.00 to 0.00), no." in text
    assert "2 more were not run" in text


def results(folder: Path) -> dict[str, object]:
    """Return all rows without timings, and the bands."""
    found: dict[str, object] = {}
    for file in sorted(folder.glob("experiments/*/episodes.csv")):
        rows = read_rows(file, EpisodeRow)
        found[file.parent.name] = [repr({**vars(r), "plan_ms": 0}) for r in rows]
    for file in sorted(folder.glob("experiments/*/distances/*.npy")):
        found[str(file.relative_to(folder))] = file.read_bytes()
    return found


ONLY = ("frequency", "accumulated", "losses")


def _run(out: Path, workers: int) -> None:
    with closing(reproduce(out, scale="smoke", seed=2, only=ONLY, workers=workers)) as steps:
        for _ in steps:
            pass


def test_claims_about_hpp_are_judged_for_each_preset_alone():
    found = Estimate(0.2, 0.1, 0.3)
    parts = [
        Part(about="a", found=found, outcome="yes", preset="best"),
        Part(about="b", found=found, outcome="no", preset="paper"),
        Part(about="c", found=found, outcome="yes"),
    ]
    claim = Claim(claim="x", where="y", rule="z:", parts=parts, experiments=["main"])
    assert claim.by_preset() == {"best": "holds", "paper": "does not hold"}
    row = claim.as_row()
    assert (row["verdict"], row["presets"]) == ("holds partly", claim.by_preset())
    assert "x [best: holds, paper: does not hold]" in verdict_lines([row])[0]
    assert Claim(claim="x", where="y", rule="z:", parts=parts[::2], experiments=["main"]).by_preset() == {}


def test_measures_say_which_preset_they_judge(measures, tmp_path):
    rows = [row(planner, "wall", e, 5.0) for planner in (BEST, PAPER, "a") for e in range(30)]
    write_rows(tmp_path / "experiments" / "main" / "episodes.csv", rows, EpisodeRow)
    fresh = Measures(tmp_path)
    best, paper = Arm("main", BEST), Arm("main", PAPER)
    for part, preset in (
        (fresh.better(best, A, "wall"), "best"), (fresh.alike(A, paper, "wall"), "paper"),
        (fresh.fails(best, "wall"), "best"), (fresh.fails(A, "wall"), ""),
    ):  # fmt: skip
        assert part is not None
        assert part.preset == preset


@pytest.mark.minutes
@pytest.mark.timeout(900)
def test_a_killed_run_resumes_and_ends_with_the_same_results(tmp_path):
    _run(tmp_path / "whole", workers=2)
    options = f"--scale smoke --seed 2 --only {','.join(ONLY)} --workers 1 --out {tmp_path / 'cut'}"
    code = f"from hpp_framework.cli.main import main; main({['reproduce', *options.split()]})"
    process = subprocess.Popen([sys.executable, "-c", code], start_new_session=True)
    patience = time.monotonic() + 300
    while not (tmp_path / "cut/experiments/frequency/episodes.csv").exists():
        assert process.poll() is None
        assert time.monotonic() < patience
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert not (tmp_path / "cut/experiments/losses/summary.json").exists()
    _run(tmp_path / "cut", workers=1)
    assert results(tmp_path / "cut") == results(tmp_path / "whole")
    texts = [json.dumps(write_claims(tmp_path / name)) for name in ("cut", "whole")]
    assert texts[0] == texts[1]


@pytest.mark.minutes
@pytest.mark.timeout(1200)  # everything, if only a little of each
def test_the_whole_paper_from_the_command_line(tmp_path, capsys):
    out = tmp_path / "out"
    main(["reproduce", "--scale", "smoke", "--films", "False", "--out", str(out)])
    printed = capsys.readouterr().out
    assert "claims of the paper:" in printed
    plan = json.loads((out / "plan.json").read_text())
    assert [each["name"] for each in plan["experiments"]] == [each.name for each in experiments("smoke", 0)]
    for each in plan["experiments"]:
        assert f"{each['name']}: finished" in printed
        assert (out / each["folder"] / "summary.json").exists()
        assert (out / each["folder"] / "distance.npz").exists() == (each["kind"] == "planners")
    assert json.loads((out / "experiments" / "maddpg-training" / "summary.json").read_text())["curves"]
    for claim in json.loads((out / "claims.json").read_text()):
        assert set(claim) == {"claim", "where", "verdict", "presets", "evidence", "numbers", "experiments"}
    assert (out / "report" / "index.html").stat().st_size > 1000
