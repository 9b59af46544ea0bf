"""Searches go phase by phase, keep what has finished, stop poor trials, and say what they found."""

from __future__ import annotations

import json
import sys
import warnings
from contextlib import suppress
from threading import Lock

import optuna
import pytest
from hpp_skills.p2p import search as p2p_search
from hpp_skills.p2p.recipe import Recipe
from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

from hpp_framework.cli.main import main
from hpp_framework.core.skill import SkillTraining
from hpp_framework.plugins.registry import hub
from hpp_framework.training.search import phase as search_phase
from hpp_framework.training.search import report as search_report
from hpp_framework.training.search.phase import PhaseSearch
from hpp_framework.training.search.report import draw_search, train_command
from hpp_framework.training.search.run import open_journal, search_skill
from hpp_framework.training.search.space import SearchConfig, SkillSearch
from hpp_framework.training.search.trial import TrialTask, run_trial
from hpp_framework.utils.errors import ConfigError, HppError
from hpp_framework.utils.executor import run_tasks

TRAINED = []
"""What the toy trainer was called with in this process."""
INLINE = Lock()
"""Held by a trial in this process, whose output goes to a file of its own."""


def train(config):
    """Write the settings as weights, and a curve that ends at what they are worth."""
    TRAINED.append(config)
    if config.settings.get("toy.fail"):
        raise ValueError("the policy diverged")
    if config.settings.get("toy.wrong"):
        raise ConfigError("toy.wrong is wrong")
    worth = value(config.settings)
    rows = [{"steps": config.steps * k // 4, "value": worth * k / 4} for k in (1, 2, 3, 4)]
    (config.out / "curve.json").write_text(json.dumps(rows))
    file = config.out / "toy.safetensors"
    file.write_text(json.dumps(dict(config.settings)))
    return file


def value(settings):
    """Return the score: best, 1, at x = 0.7, size = 40, kind = b."""
    x, size = settings.get("toy.x", 0.2), settings.get("toy.size", 10)
    kind = settings.get("toy.kind", "a")
    return 1 - (x - 0.7) ** 2 - ((size - 40) / 100) ** 2 - (0.2 if kind == "a" else 0)


def judge(file, robot, seed):
    return {
        "score": value(json.loads(file.read_text())),
        "robot": float(len(robot.name)),
        "seed": float(seed),
    }


def curve(folder):
    with suppress(FileNotFoundError):
        return {row["steps"]: row["value"] for row in json.loads((folder / "curve.json").read_text())}
    return {}


def toy_search():
    return SkillSearch(
        phases={
            "reward": {
                "toy.x": FloatDistribution(0.0, 1.0),
                "toy.rate": FloatDistribution(1e-5, 1e-3, log=True),
            },
            "network": {
                "toy.size": IntDistribution(8, 64),
                "toy.kind": CategoricalDistribution(("a", "b")),
            },
        },
        start={"toy.x": 0.2, "toy.rate": 1e-4, "toy.size": 10, "toy.kind": "a"},
        objective=judge,
        curve=curve,
    )


def inline(function, tasks, **_):
    """Do a trial in this process."""
    reports = []
    with INLINE:
        for task in tasks:
            function(task, reports.append)
    yield from reports


@pytest.fixture(autouse=True)
def toy(monkeypatch):
    if "toy" not in hub().skill_searches:
        hub().skill_trainers.add("toy", train)
        hub().skill_searches.add("toy", toy_search)
    monkeypatch.setattr(search_phase, "run_tasks", inline)
    # a second each
    monkeypatch.setattr(search_report, "draw_search", lambda *_: None)
    TRAINED.clear()


def config(out, **changes):
    wanted = {"skill": "toy", "robot": "fetch", "out": out, "steps": 400, "trials": (14, 10), "seed": 5001}
    return SearchConfig(**{**wanted, **changes})


def finished(out):
    """Return what the journal says of every trial, by phase and number."""
    storage, search = open_journal(out), toy_search()
    phases = [PhaseSearch(config(out), search, name, {}, storage, lambda *_: None) for name in search.phases]
    return {(row.phase, row.number): row for phase in phases for row in phase.rows()}


def test_a_search_finds_something_better_than_the_baseline(tmp_path):
    best = search_skill(config(tmp_path))
    rows = finished(tmp_path)
    baseline = rows["reward", 0].score
    assert baseline == pytest.approx(value({}))
    assert best.score > baseline + 0.25
    assert best.score == max(row.score for row in rows.values())
    assert abs(best.settings["toy.x"] - 0.7) < 0.2
    assert best.settings["toy.kind"] == "b"
    assert isinstance(best.settings["toy.size"], int)
    assert [len([key for key in rows if key[0] == phase]) for phase in ("reward", "network")] == [14, 10]


def test_a_phase_begins_with_and_keeps_the_best_of_the_one_before(tmp_path):
    search_skill(config(tmp_path, trials=(6, 4)))
    rows = finished(tmp_path)
    first = [row for row in rows.values() if row.phase == "reward"]
    best = max(first, key=lambda row: row.score)
    assert first[0].settings == {"toy.x": 0.2, "toy.rate": 1e-4}
    for row in (row for row in rows.values() if row.phase == "network"):
        assert {name: row.settings[name] for name in best.settings} == best.settings
    again = rows["network", 0]
    assert (again.score, again.folder) == (best.score, best.folder)
    assert again.settings == {**best.settings, "toy.size": 10, "toy.kind": "a"}
    # the same training twice would say nothing new
    assert len(TRAINED) == 6 + 4 - 1


def test_given_settings_are_held_or_started_from(tmp_path):
    search_skill(config(tmp_path, trials=(2, 2), settings={"toy.x": 0.5, "toy.kind": "b", "toy.other": 3}))
    rows = finished(tmp_path)
    assert rows["reward", 0].settings["toy.x"] == 0.5
    assert rows["network", 0].settings["toy.kind"] == "b"
    assert all(row.settings["toy.other"] == 3 for row in rows.values())


def test_trainings_are_told_what_to_do(tmp_path):
    search_skill(config(tmp_path, trials=(2, 1)))
    first = TRAINED[0]
    assert (first.robot, first.steps, first.seed, first.threads, first.judge) == (
        "fetch",
        400,
        5001,
        1,
        False,
    )
    assert first.out == tmp_path / "reward" / "trial-000"
    assert finished(tmp_path)["reward", 0].metrics["seed"] > 0


@pytest.mark.parametrize("stop_after", [3, 9])
def test_an_interrupted_search_ends_as_one_that_was_not(tmp_path, stop_after):
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    search_skill(config(whole, trials=(7, 5)))
    ended = []

    def interrupt(row, curve):
        if row.state == "finished":
            ended.append(row)
            if len(ended) == stop_after:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        search_skill(config(broken, trials=(7, 5)), interrupt)
    kept = {key: row for key, row in finished(broken).items() if row.state == "finished"}
    assert len(kept) == stop_after
    assert (broken / "report.md").exists()
    search_skill(config(broken, trials=(7, 5)))
    assert finished(broken) == finished(whole)


def test_a_trial_under_way_when_killed_is_taken_up_again(tmp_path):
    def kill(row, curve):
        if row.number == 2 and row.state == "unfinished":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        search_skill(config(tmp_path, trials=(4, 1)), kill)
    under_way = finished(tmp_path)["reward", 2]
    assert under_way.state == "unfinished"
    # a line that was being written when the process was killed
    with (tmp_path / "trials.journal").open("a") as journal:
        journal.write('{"op_code": 5, "wor')
    search_skill(config(tmp_path, trials=(4, 1)))
    rows = finished(tmp_path)
    assert {row.state for row in rows.values()} == {"finished"}
    assert rows["reward", 2].settings == under_way.settings
    assert len(rows) == 5


def test_what_is_trained_is_only_judged_again(tmp_path):
    out = tmp_path / "trial"
    task = TrialTask(
        trainer=train, search=toy_search(), seed=1,
        training=SkillTraining(robot="fetch", out=out, steps=400, settings={"toy.x": 0.7}),
    )  # fmt: skip
    assert len(list(inline(run_trial, [task]))) == 2
    *_, last = inline(run_trial, [task])
    assert last["score"] == pytest.approx(value({"toy.x": 0.7}))
    assert len(TRAINED) == 1


def test_side_by_side_trials_are_as_many_and_the_first_is_the_baseline(tmp_path):
    search_skill(config(tmp_path, trials=(7, 3), workers=3))
    rows = finished(tmp_path)
    assert len(rows) == 10
    assert rows["reward", 0].settings == {"toy.x": 0.2, "toy.rate": 1e-4}


def test_poor_trainings_are_stopped_at_the_median(tmp_path):
    search_skill(config(tmp_path, trials=(12, 3), rungs=(0.25, 0.5)))
    rows = [row for row in finished(tmp_path).values() if row.phase == "reward"]
    for row in rows:
        before = sorted(value(r.settings) for r in rows if r.score is not None and r.number < row.number)
        half = len(before) // 2
        median = (before[half] + before[-half - 1]) / 2 if before else 0
        poor = len(before) >= 4 and row.number > 0 and value(row.settings) < median
        assert row.state == ("stopped" if poor else "finished"), row
    assert "stopped" in {row.state for row in rows}
    assert "below the median" in (tmp_path / "report.md").read_text()


def test_the_report_holds_every_trial_and_the_winner(tmp_path, monkeypatch):
    monkeypatch.setattr(search_report, "draw_search", draw_search)
    best = search_skill(config(tmp_path, trials=(12, 3), rungs=(0.5,)))
    report = (tmp_path / "report.md").read_text()
    reward = report[report.index("## Phase reward") : report.index("## Phase network")]
    for row in (row for row in finished(tmp_path).values() if row.phase == "reward"):
        name = "0 (baseline)" if row.number == 0 else row.number
        score = "" if row.score is None else f"{row.score:.4f}"
        assert f"| {name} | {row.state} | {score} | {row.settings['toy.x']} |" in reward
    scores = [float(line.split("|")[3]) for line in reward.splitlines() if "| finished |" in line]
    assert scores == sorted(scores, reverse=True)
    assert f"trial {best.number} of {best.phase}" in report
    assert train_command(config(tmp_path), best.settings) in report
    chosen = json.loads((tmp_path / "best.json").read_text())
    assert chosen["settings"] == best.settings
    assert chosen["metrics"]["score"] > chosen["baseline_metrics"]["score"]
    assert (tmp_path / "report.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("trials", [1, 3])
def test_a_phase_of_one_parameter_is_drawn(tmp_path, trials):
    study = optuna.create_study(direction="maximize")
    for number in range(trials):
        trial = study.ask({"toy.x": FloatDistribution(0.0, 1.0)})
        study.tell(trial, number)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        draw_search(tmp_path / "report.png", [study])
    assert (tmp_path / "report.png").read_bytes().startswith(b"\x89PNG")


def test_the_command_of_the_winner_reads_back_as_it_was(tmp_path):
    from hpp_framework.config.settings import parse_settings

    settings = {"toy.rate": 1e-05, "toy.size": 12, "toy.kind": "b", "toy.x": 0.2, "toy.on": True}
    command = train_command(config(tmp_path), settings)
    assert command.startswith("hpp train skill toy --robot fetch --set ")
    assert parse_settings(command.split("--set ")[1].split(), "--set") == settings


def test_a_trial_that_fails_is_noted_and_the_search_goes_on(tmp_path, monkeypatch):
    def sometimes(settings):
        if settings["toy.x"] > 0.6:
            raise ValueError("the policy diverged")
        return 1.0

    monkeypatch.setattr(f"{__name__}.value", sometimes)
    search_skill(config(tmp_path, trials=(8, 1)))
    rows = [row for row in finished(tmp_path).values() if row.phase == "reward"]
    failed = [row for row in rows if row.state == "failed"]
    assert failed
    assert all((row.settings["toy.x"] > 0.6) == (row in failed) for row in rows)
    assert "ValueError: the policy diverged" in (tmp_path / "report.md").read_text()
    assert "Traceback" in (tmp_path / failed[0].folder / "failure.txt").read_text()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"toy.fail": True}, "the baseline failed: ValueError: the policy diverged"),
        ({"toy.wrong": True}, "is wrong"),
    ],
)
def test_what_would_fail_everywhere_ends_the_search(tmp_path, settings, message):
    with pytest.raises(HppError, match=message):
        search_skill(config(tmp_path, settings=settings))
    assert len(TRAINED) == 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"trials": (3,)}, "each phase .reward, network."),
        ({"trials": (3, 0)}, "at least 1"),
        ({"rungs": (0.5, 0.3)}, "rising shares"),
        ({"rungs": (1.0,)}, "rising shares"),
        ({"settings": {"toy.x": 3.0}}, "cannot start from toy.x = 3.0.*0 to 1"),
        ({"settings": {"toy.kind": "c"}}, "cannot start from toy.kind = 'c'.*a . b"),
        ({"skill": "toi"}, "Did you mean 'toy'"),
        ({"robot": "fetsh"}, "Did you mean 'fetch'"),
    ],
)
def test_wrong_options_are_refused(tmp_path, changes, message):
    with pytest.raises(HppError, match=message):
        search_skill(config(tmp_path, **changes))
    assert not TRAINED


@pytest.mark.parametrize("changes", [{"steps": 500}, {"seed": 6001}, {"trials": (2, 2)}, {"rungs": (0.5,)}])
def test_a_folder_of_another_search_is_refused(tmp_path, changes):
    search_skill(config(tmp_path, trials=(2, 1)))
    with pytest.raises(ConfigError, match=f"holds another search .{next(iter(changes))} was"):
        search_skill(config(tmp_path, **{"trials": (2, 1), **changes}))
    TRAINED.clear()
    search_skill(config(tmp_path, trials=(2, 1), workers=2))
    assert not TRAINED


def test_wrong_searches_are_refused():
    phase = {"toy.x": FloatDistribution(0.0, 1.0)}
    for phases, start, message in (
        ({}, {}, "one or more phases"),
        ({"reward": phase, "network": phase}, {"toy.x": 0.5}, "two phases"),
        ({"reward": phase}, {}, "without a value of 'toy.x'"),
        ({"reward": phase}, {"toy.x": 2.0}, "cannot start from"),
        ({"reward": {"toy.x": IntDistribution(1, 5)}}, {"toy.x": 2.5}, "cannot start from"),
        ({"reward": {"toy.x": IntDistribution(1, 1)}}, {"toy.x": 1}, "'toy.x' needs two or more"),
        ({"reward": {"toy.x": CategoricalDistribution((1,))}}, {"toy.x": 1}, "'toy.x' needs two or more"),
        ({"reward": {"toy.x": CategoricalDistribution((1, 1))}}, {"toy.x": 1}, "'toy.x' needs two or more"),
    ):
        with pytest.raises(ConfigError, match=message):
            SkillSearch(phases=phases, start=start, objective=judge)
    # a whole number is welcome where a real one is searched
    SkillSearch(phases={"reward": phase}, start={"toy.x": 1}, objective=judge)


def test_importances_say_what_the_score_hangs_on(tmp_path):
    search, watch = toy_search(), lambda *_: None
    search_skill(config(tmp_path))
    phase = PhaseSearch(config(tmp_path), search, "reward", {}, open_journal(tmp_path), watch)
    found = search_report.importances(phase.study)
    assert sum(found.values()) == pytest.approx(1)
    assert found["toy.x"] > found["toy.rate"]
    search_skill(config(tmp_path / "short", trials=(3, 1)))
    phase = PhaseSearch(config(tmp_path), search, "reward", {}, open_journal(tmp_path / "short"), watch)
    assert search_report.importances(phase.study) == {}


def test_the_command_searches_and_says_how_to_train_the_winner(tmp_path, capsys):
    out = tmp_path / "found"
    arguments = ["search", "skill", "toy", "--steps", "400", "--workers", "1", "--out", str(out)]
    main([*arguments, "--trials", "3,2"])
    printed = capsys.readouterr().out
    assert "reward 0: finished, score" in printed
    assert "hpp train skill toy --robot fetch --set toy.x=" in printed
    for wrong, message in (
        (["--trials", "3,x"], "--trials takes whole numbers"),
        (["--trials", "3,2", "--rungs", "a"], "--rungs takes numbers"),
        (["--trials", "4,2"], "holds another search"),
        (["--trials", "3,2", "--set", "toy.x"], "NAME=VALUE"),
    ):
        with pytest.raises(SystemExit) as ended:
            main([*arguments, *wrong])
        assert ended.value.code == 2
        assert message in " ".join(capsys.readouterr().err.split())


def test_without_optuna_the_command_says_how_to_get_it(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "optuna", None)
    for name in [name for name in sys.modules if name.startswith("hpp_framework.training.search")]:
        monkeypatch.delitem(sys.modules, name)
    with pytest.raises(SystemExit) as ended:
        main(["search", "skill", "toy", "--out", str(tmp_path)])
    assert ended.value.code == 2
    assert "pip install hpp-framework[search]" in capsys.readouterr().err


def test_there_is_no_report_before_there_is_a_baseline(tmp_path):
    def interrupt(row, curve):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        search_skill(config(tmp_path), interrupt)
    assert not (tmp_path / "report.md").exists()
    assert not (tmp_path / "best.json").exists()


def test_a_search_that_finds_nothing_better_says_so(tmp_path):
    best = search_skill(config(tmp_path, trials=(1, 1)))
    report = (tmp_path / "report.md").read_text()
    assert "Best: trial 0 of network" in report
    assert "Nothing that was tried was better" in report
    assert json.loads((tmp_path / "best.json").read_text())["settings"] == best.settings
    assert best.settings == toy_search().start


def test_a_trial_has_a_process_of_its_own(tmp_path):
    task = TrialTask(
        trainer=train, search=toy_search(), seed=1,
        training=SkillTraining(robot="fetch", out=tmp_path, steps=400, settings={"toy.x": 0.7}),
    )  # fmt: skip
    reports = list(run_tasks(run_trial, [task], workers=1, every=0.05))
    assert set(reports[:-1]) == {None}
    assert reports[-1]["score"] == pytest.approx(value({"toy.x": 0.7}))
    assert sorted(curve(tmp_path)) == [100, 200, 300, 400]
    assert not TRAINED  # not here


def test_p2p_declares_what_its_recipe_has():
    found = hub().skill_searches.create("p2p")
    names = [name for phase in found.phases.values() for name in phase]
    assert list(found.phases) == ["reward", "network"]
    # every bound is of the kind that the recipe takes
    for phase in found.phases.values():
        for name, searched in phase.items():
            choice = isinstance(searched, CategoricalDistribution)
            for end in searched.choices if choice else (searched.low, searched.high):
                assert Recipe().altered({name: end})
    assert Recipe().altered(found.start) == Recipe()
    assert set(names) == set(found.start)


@pytest.mark.usefixtures("tiny_training")
def test_p2p_is_trained_and_judged_with_the_settings_of_a_trial(tmp_path, monkeypatch):
    monkeypatch.setattr(p2p_search, "WORLDS", ("training",))
    monkeypatch.setattr(p2p_search, "NAVIGATION_TASKS", 1)
    settings = {"reward.touch": -0.4, "network.hidden": 64, "ppo.n_epochs": 1, "network.scan": "dense"}
    task = TrialTask(
        trainer=hub().skill_trainers.entry("p2p").factory(), seed=1,
        search=hub().skill_searches.create("p2p"),
        training=SkillTraining(
            robot="fetch", out=tmp_path, steps=64, seed=5001, threads=1, settings=settings, judge=False
        ),
    )  # fmt: skip
    reports = []
    run_trial(task, reports.append)
    under_way, metrics = reports
    assert under_way is None
    assert sorted(p2p_search.training_success(tmp_path)) == [64]
    assert 0 <= metrics["score"] <= 1
    assert metrics["navigation_tasks"] == 1
    assert metrics["score"] == (metrics["success"] + metrics["clean"]) / 2
    card = json.loads((tmp_path / "fetch.json").read_text())
    assert card["network"]["hidden"] == 64
    assert card["recipe"]["reward"]["touch"] == -0.4
    # the training may be writing while it is watched
    with (tmp_path / "curve.jsonl").open("a") as stream:
        stream.write('{"steps": 12')
    assert sorted(p2p_search.training_success(tmp_path)) == [64]
