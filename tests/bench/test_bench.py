"""Every benchmark runs at the tiniest scale and says what it measured; nothing here judges speed."""

from __future__ import annotations

import csv
import json

import pytest
import torch

from hpp_framework.bench import suite
from hpp_framework.bench.measurement import Measurement, Settings, SkippedError, ratios, timed
from hpp_framework.bench.report import number, table, write
from hpp_framework.bench.suite import BENCHMARKS, Result, run_benchmark
from hpp_framework.cli.bench import Bench
from hpp_framework.cli.main import main

TINY = Settings(scale="tiny", threads=1)


@pytest.fixture
def one_benchmark(monkeypatch):
    """Replace all benchmarks by one that counts."""

    def counting(settings):
        yield Measurement(name="one", parameters={"robots": 2}, unit="ms", values=(3.0, 1.0, 2.0))
        yield Measurement(name="two", parameters={}, unit="1/s", values=(1234.5,))

    monkeypatch.setattr(suite, "BENCHMARKS", {"counting": "nowhere:counting"})
    monkeypatch.setattr(suite, "find", lambda name: counting)
    return counting


@pytest.mark.filterwarnings("ignore:You have specified a mini-batch size")
@pytest.mark.parametrize("name", BENCHMARKS)
def test_every_benchmark_measures(name, tiny_training):
    threads = torch.get_num_threads()
    results = list(run_benchmark(name, TINY))
    assert results
    assert results[-1].measurements or results[-1].skipped
    for measurement in results[-1].measurements:
        assert measurement.values
        assert min(measurement.values) > 0
        assert measurement.quantile(0) <= measurement.quantile(0.5) <= measurement.quantile(1)
    assert torch.get_num_threads() == threads


def test_a_benchmark_that_cannot_run_says_why(monkeypatch):
    def impossible(settings):
        yield Measurement(name="one", parameters={}, unit="s", values=(1.0,))
        raise SkippedError("no such simulator here.")

    monkeypatch.setattr(suite, "find", lambda name: impossible)
    last = list(run_benchmark("sapien", TINY))[-1]
    assert len(last.measurements) == 1
    assert "skipped. no such simulator here." in str(table(last).title)


def test_actions_are_timed_in_turns():
    calls = []
    seconds = timed({"a": lambda: calls.append("a"), "b": lambda: calls.append("b")}, 2)
    assert calls == ["a", "b"] * 3
    assert [len(each) for each in seconds.values()] == [2, 2]
    assert len(timed({"a": lambda: None}, 5, budget=0.0)["a"]) == 1


def test_ratios_pair_the_rounds():
    assert ratios([2.0, 9.0], [1.0, 3.0]) == (2.0, 3.0)
    with pytest.raises(ValueError, match="shorter"):
        ratios([1.0], [])


@pytest.mark.parametrize(
    ("value", "text"), [(123456.7, "123,457"), (234.5, "234"), (12.345, "12.3"), (0.01234, "0.0123")]
)
def test_numbers_have_three_digits(value, text):
    assert number(value) == text


def test_results_are_written_as_json_and_csv(tmp_path):
    result = Result("any", (Measurement(name="one", parameters={"n": 2}, unit="s", values=(1.0, 3.0)),))
    write(tmp_path, {"cores": 2}, TINY, [result, Result("other", skipped="not here")])
    document = json.loads((tmp_path / "results.json").read_text())
    assert document["machine"]["cores"] == 2
    assert document["settings"]["scale"] == "tiny"
    assert document["skipped"] == {"other": "not here"}
    assert document["measurements"][0]["values"] == [1.0, 3.0]
    rows = list(csv.DictReader((tmp_path / "results.csv").open()))
    assert [(row["benchmark"], row["median"], row["parameters"]) for row in rows] == [("any", "2.0", "n 2")]


def test_the_command_prints_a_table_and_keeps_results(one_benchmark, tmp_path, capsys):
    Bench(names=("counting",), out=tmp_path).run()
    shown = capsys.readouterr().out
    assert "robots 2" in shown
    assert "1,234" in shown
    assert len(json.loads((tmp_path / "results.json").read_text())["measurements"]) == 2


def test_an_interruption_keeps_what_was_measured(monkeypatch, tmp_path, capsys):
    def interrupted(settings):
        yield Measurement(name="one", parameters={}, unit="s", values=(1.0,))
        raise KeyboardInterrupt

    monkeypatch.setattr(suite, "find", lambda name: interrupted)
    with pytest.raises(SystemExit) as stopped:
        main(["bench", "scans", "--out", str(tmp_path)])
    assert stopped.value.code == 130
    assert f"What was finished is in '{tmp_path}'" in capsys.readouterr().err
    assert len(json.loads((tmp_path / "results.json").read_text())["measurements"]) == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["simulatio"], "no benchmark called 'simulatio'. Did you mean 'simulation'?"),
        (["scans", "--device", "gpu"], "--device must be 'cpu' or 'cuda', got 'gpu'"),
        (["scans", "--team", "fetchh"], "no robot called 'fetchh'"),
    ],
)
def test_mistakes_get_a_clear_line(arguments, message, tmp_path, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["bench", *arguments, "--out", str(tmp_path)])
    assert stopped.value.code == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
