"""Everything registered keeps its promises; and ``hpp check`` finds, names and teaches what does not."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from hpp_framework import testing
from hpp_framework.cli.main import main
from hpp_framework.plugins.registry import BrokenPlugin, Entry, hub
from hpp_framework.testing import CheckError, build, check_planner, check_robot, inventory, report
from hpp_framework.testing.inventory import check_broken, check_target, find_targets
from hpp_framework.utils.errors import UnknownNameError

ROOT = Path(__file__).parents[2]
MODULES = (
    build, testing.purity, testing.robot, testing.skill, testing.task, testing.predictor, testing.planner,
    testing.world, inventory,
)  # fmt: skip
BUNDLED = find_targets("hpp-framework")[0]
LATTICE = {"horizon": 4, "reach": 1.7}
SMALLER = {
    "hpp": LATTICE,
    "full-communication": LATTICE,
    "perfect-model": LATTICE,
    "hpp-options": {f"lattice.{name}": value for name, value in LATTICE.items()},
    "rrt-cem": {"horizon": 4, "cem.iterations": 2, "cem.samples": 6, "cem.elites": 2},
}


@pytest.mark.parametrize("target", BUNDLED, ids=[f"{target.kind}-{target.name}" for target in BUNDLED])
def test_everything_bundled_is_fine(target):
    if target.name in SMALLER:
        check_planner(target.name, settings=SMALLER[target.name])
    else:
        check_target(target)


def test_every_rule_is_explained_on_the_page():
    page = (ROOT / "docs" / "plugins.md").read_text().replace("\\", "")
    rules = [report.RAISES, *(rule for module in MODULES for rule in module.RULES)]
    assert len({rule.name for rule in rules}) == len(rules)
    for rule in rules:
        row = rf"\| `{rule.name}` \| [^|]+ \| {re.escape(rule.why)} \| {re.escape(rule.fix)} \|"
        assert re.search(row, page), rule.name


def test_rules_say_why_and_what_instead():
    for module in MODULES:
        for rule in module.RULES:
            assert re.fullmatch(r"[a-z-]+", rule.name)
            assert len(rule.why) > 20
            assert len(rule.fix) > 20
            assert rule.why.endswith(".")


@pytest.fixture
def printed(capsys):
    """Return a function that runs a command and returns its exit status and what it printed."""

    def run(*words):
        status = 0
        try:
            main(words)
        except SystemExit as stop:
            status = stop.code
        captured = capsys.readouterr()
        return status, " ".join((captured.out + captured.err).split())

    return run


def test_a_name_is_checked(printed):
    status, text = printed("check", "pure-pursuit")
    assert status == 0
    assert "skill 'pure-pursuit'" in text
    assert "1 checked, all fine." in text


def test_findings_are_printed_and_end_with_1(printed, register):
    robot = hub().robots.create("freight")
    register("robots", "test-rover", lambda: robot)
    status, text = printed("check", "test-rover")
    assert status == 1
    assert "robot 'test-rover': 1 finding" in text
    assert "name is 'freight', but it is registered as 'test-rover'. [robot-name]" in text
    assert "why: weights, cards and results are filed under RobotSpec.name" in text
    assert "1 checked, 1 of them with 1 finding in all." in text


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("check pure-pursuitt", "no distribution or registered thing called 'pure-pursuitt'. Did you mean"),
        ("check pytest", "is installed, but registers nothing. Its pyproject.toml needs"),
        ("check hypothesis", '\nhypothesis = "hypothesis.plugin:register"\n'.replace("\n", " ")),
        ("check p2p --robot fetsh", "Did you mean 'fetch'?"),
        ("check hpp --team fetch,,", "empty entry"),
    ],
)
def test_wrong_names_are_refused(words, expected, printed):
    status, text = printed(*words.split())
    assert status == 2
    assert expected in text


def test_a_distribution_is_found_by_any_spelling():
    assert len(find_targets("HPP_Framework")[0]) == len(BUNDLED)
    with pytest.raises(UnknownNameError):
        find_targets("hpp-framework-extras")


def test_a_source_that_cannot_be_imported_is_a_finding(register):
    register("robots", "test-ghost", "no_such_package.rover:rover")
    with pytest.raises(
        CheckError, match="cannot be imported: 'test-ghost' from this process could not be loaded"
    ):
        check_robot("test-ghost")


@pytest.mark.parametrize("kind", ["robots", "tasks", "checkpoints"])
def test_the_remedy_for_a_source_names_its_own_registry(kind, register):
    register(kind, "test-ghost", "no_such_package.rover:rover")
    with pytest.raises(CheckError) as error:
        check_target(find_targets("test-ghost")[0][0])
    (finding,) = error.value.findings
    assert finding.rule.name == "import"
    assert f'hub.{kind}.add("name", "my_package.module:factory")' in str(finding)


def test_a_value_that_is_refused_at_import_is_named_with_its_line(register, tmp_path, monkeypatch):
    number = "\n\nLIMITS = DriveLimits(speed=(0, 1), turn_rate=-2.0, acceleration=1, turn_acceleration=1)\n"
    (tmp_path / "test_odd_rover.py").write_text(f"from hpp_framework.core.robot import DriveLimits{number}")
    monkeypatch.syspath_prepend(tmp_path)
    register("robots", "test-odd", "test_odd_rover:rover")
    with pytest.raises(CheckError) as error:
        check_robot("test-odd")
    (finding,) = error.value.findings
    assert finding.rule.name == "build"
    assert finding.what == (
        "gives a value that is refused: drive limits: 'turn_rate' must be greater than 0, got -2.0. "
        "Use a positive number. (test_odd_rover.py:3)"
    )
    assert finding.rule.fix == "a value that it accepts."


def test_an_error_that_no_check_foresaw_does_not_stop_the_others(printed, register, monkeypatch):
    def fail(name):
        raise ArithmeticError("odd")

    monkeypatch.setattr(inventory, "check_robot", fail)
    status, text = printed("check", "fetch")
    assert status == 1
    assert "the check was stopped by ArithmeticError: odd" in text


@pytest.mark.parametrize(
    ("folder", "words"),
    [
        (lambda path: path / "nowhere", "no existing folder"),
        (lambda path: path, "no readable card beside it"),
    ],
)
def test_folders_of_weights_are_looked_into(folder, words, register, tmp_path):
    (tmp_path / "p2p").mkdir()
    (tmp_path / "p2p" / "self-disc.safetensors").write_bytes(b"")
    register("checkpoints", "test-weights", lambda: folder(tmp_path))
    with pytest.raises(CheckError, match=words):
        check_target(find_targets("test-weights")[0][0])


def test_clashes_are_findings(monkeypatch):
    one = hub().robots.entry("freight")
    two = Entry("freight", one.source, "", "other-robots 2.0")
    monkeypatch.setattr(hub().robots, "_entries", {})
    monkeypatch.setattr(hub().robots, "_clashes", {"freight": (one, two)})
    with pytest.raises(CheckError, match="the name is taken: Two robots are called 'freight'"):
        check_target(find_targets("other-robots")[0][0])


@pytest.fixture
def broken():
    plugin = BrokenPlugin("rover", "rover-plugin 1.0", "It wants numpy 7.")
    hub().broken.append(plugin)
    yield plugin
    hub().broken.remove(plugin)


def test_broken_plugins_are_findings(broken):
    targets, plugins = find_targets("rover_plugin")
    assert (targets, plugins) == ([], [broken])
    assert "the plugin is broken: It wants numpy 7." in str(check_broken(plugins[0]))
