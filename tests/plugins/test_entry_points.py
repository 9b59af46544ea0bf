"""Plugins of other people: a distribution is built, installed into a folder and found in a fresh process."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

ROVER = """
    import dataclasses

    import torch

    from hpp_framework.plugins.registry import hub
    from hpp_framework.core.skill import Skill


    def register(hub):
        hub.robots.add("rover", "rover_plugin:rover", summary="a test's own robot")
        hub.skills.add("spin", "rover_plugin:Spin", summary="a test's own skill, of no use")


    def rover():
        return dataclasses.replace(hub().robots.create("freight"), name="rover", mass=12.0)


    class Spin(Skill):
        def __init__(self, robot):
            self.robot = robot

        def act(self, observation, goal):
            return torch.tensor([[0.0, 9.0]]).expand(len(goal), 2)
"""
PROJECT = """
    [build-system]
    requires = ["hatchling"]
    build-backend = "hatchling.build"

    [project]
    name = "{name}"
    version = "1.2.3"

    [project.entry-points."hpp_framework.plugins"]
    {module} = "{module}:register"

    [tool.hatch.build.targets.wheel]
    include = ["{module}.py"]
"""
SHOW = """
    import json
    from hpp_framework.utils.errors import HppError
    from hpp_framework.plugins.registry import hub

    print(json.dumps({"robots": {entry.name: entry.origin for entry in hub().robots}}))
"""

ASK = """
    import json
    from hpp_framework.utils.errors import HppError
    from hpp_framework.plugins.registry import hub

    errors = {}
    for name in ("rover", "fetch", "half", "second-fetch/fetch", "hpp-framework/fetch"):
        try:
            errors[name] = hub().robots.entry(name).origin
        except HppError as error:
            errors[name] = f"{type(error).__name__}: {error}"
    broken = {plugin.name: plugin.reason for plugin in hub().broken}
    robots = {entry.name: entry.origin for entry in hub().robots}
    print(json.dumps({"robots": robots, "asked": errors, "broken": broken}))
"""

# name: (code, what it requires)
BAD = {
    "broken-import": ("import no_such_module_at_all", ""),
    "no-register": ("x = 1", ""),
    "raises-register": ("def register(hub):\n    raise ValueError('no licence key')", ""),
    "half-way": (
        "def register(hub):\n    hub.robots.add('half', 'half_way:half')\n    hub.skills.add('half', 1 / 0)",
        "",
    ),
    "leaves": ("raise SystemExit(3)", ""),
    "asks-early": ("from hpp_framework.plugins.registry import hub\nhub()\nregister = print", ""),
    "from-tomorrow": ("raise RuntimeError('imported in vain')", "hpp-framework>=7,<8"),
    "from-yesterday": ("from hpp_framework.core.robot import Robot", ""),
    "second-fetch": (
        "def register(hub):\n    hub.robots.add('fetch', 'second_fetch:fetch')\n"
        "    hub.robots.add('own', 'second_fetch:own')",
        "hpp-framework>=0.1",
    ),
}


def put(target: Path, name: str, code: str, requires: str = "") -> None:
    """Write an installed distribution of one module straight into a folder: quicker than building it."""
    module = name.replace("-", "_")
    (target / f"{module}.py").write_text(code)
    info = target / f"{module}-1.2.3.dist-info"
    info.mkdir()
    metadata = f"Metadata-Version: 2.4\nName: {name}\nVersion: 1.2.3\n"
    (info / "METADATA").write_text(metadata + (f"Requires-Dist: {requires}\n" if requires else ""))
    points = f"[hpp_framework.plugins]\n{module} = {module}:register\n"
    (info / "entry_points.txt").write_text(points)


def install(folder: Path, name: str, code: str) -> Path:
    """Build a distribution of one module and install it into a folder, as its user would."""
    module = name.replace("-", "_")
    source = folder / f"{name}-source"
    source.mkdir()
    (source / f"{module}.py").write_text(textwrap.dedent(code))
    (source / "pyproject.toml").write_text(textwrap.dedent(PROJECT).format(name=name, module=module))
    target = folder / "site"
    subprocess.run(
        [
            sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check",
            "--no-deps", "--no-build-isolation", "--no-index", "--target", str(target), str(source),
        ],
        check=True,
        timeout=120,
    )  # fmt: skip
    return target


def in_fresh_process(target: Path, code: str) -> dict:
    """Run code with a folder of distributions on the path and return what it prints last."""
    path = f"import sys; sys.path.append({str(target)!r})\n"
    done = subprocess.run(
        [sys.executable, "-c", path + textwrap.dedent(code)], capture_output=True, text=True, timeout=280
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    return install(tmp_path_factory.mktemp("plugin"), "rover-plugin", ROVER)


def test_an_installed_plugin_is_found_with_its_origin(site):
    robots = in_fresh_process(site, SHOW)["robots"]
    assert robots["rover"] == "rover-plugin 1.2.3"
    assert robots["fetch"] == "hpp-framework 0.1.0"


def test_what_a_plugin_brings_drives_and_is_checked(site):
    code = """
        import contextlib
        import io
        import json
        import torch
        from hpp_framework.cli.main import main
        from hpp_framework.sim.batch.simulator import BatchSimulator
        from hpp_framework.plugins.build import parse_team
        from hpp_framework.core.world import World

        team = parse_team("rover,fetch")
        simulator = BatchSimulator(team.robots)
        world = World(name="room", bounds=(-5, -5, 5, 5))
        simulator.reset([world], torch.tensor([[[-2.0, 0, 0], [2, 0, 0]]]))
        for _ in range(5):
            state = simulator.step(torch.ones(1, 2, 2))
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            try:
                main(["check", "rover-plugin"])
            except SystemExit as stop:
                status = stop.code
        found = {"status": status, "printed": " ".join(printed.getvalue().split())}
        print(json.dumps({"ids": team.ids, "x": state.poses[0, 0, 0].item(), **found}))
    """
    shown = in_fresh_process(site, code)
    assert shown["ids"] == ["rover", "fetch"]
    assert shown["x"] > -2.0
    assert shown["status"] == 1
    assert "ok robot 'rover'" in shown["printed"]
    assert "skill 'spin': 3 findings" in shown["printed"]
    assert "rover does 0 .. 1 m/s and 3 rad/s. [beyond-limits]" in shown["printed"]
    assert "2 checked, 1 of them with 3 findings in all." in shown["printed"]


def test_nothing_is_imported_before_the_first_look_up(site):
    code = """
        import json, sys
        import hpp_framework.plugins.registry
        late = {"rover_plugin", "hpp_robots", "hpp_skills", "warp", "sapien", "torch"}
        early = sorted(late & set(sys.modules))
        list(hpp_framework.plugins.registry.hub().robots)
        print(json.dumps({"early": early, "loaded": "rover_plugin" in sys.modules}))
    """
    assert in_fresh_process(site, code) == {"early": [], "loaded": True}


@pytest.fixture(scope="module")
def bad(site, tmp_path_factory) -> Path:
    """Return a folder with a plugin that works and many that do not."""
    folder = tmp_path_factory.mktemp("bad") / "site"
    shutil.copytree(site, folder)
    for name, (code, requires) in BAD.items():
        put(folder, name, code, requires)
    return folder


@pytest.fixture(scope="module")
def asked(bad) -> dict:
    return in_fresh_process(bad, ASK)


@pytest.mark.parametrize(
    ("plugin", "message"),
    [
        (
            "broken_import",
            "The plugin 'broken_import' of broken-import 1.2.3 failed to register: "
            "ModuleNotFoundError(\"No module named 'no_such_module_at_all'\"). "
            "Fix 'broken_import:register' or uninstall broken-import 1.2.3.",
        ),
        ("no_register", "The plugin 'no_register' of no-register 1.2.3 failed to register: AttributeError"),
        ("raises_register", "of raises-register 1.2.3 failed to register: ValueError('no licence key')"),
        ("half_way", "The plugin 'half_way' of half-way 1.2.3 failed to register: ZeroDivisionError"),
        ("leaves", "of leaves 1.2.3 failed to register: SystemExit(3)"),
        ("asks_early", "call hub() inside factories only, never when a module is imported"),
        (
            "from_tomorrow",
            "from-tomorrow 1.2.3 was built for hpp-framework<8,>=7, but this is hpp-framework 0.1.0. Install "
            "a version of from-tomorrow made for 0.1.0, or the hpp-framework that it asks for.",
        ),
        (
            "from_yesterday",
            "It does not say which hpp-framework it was built for, maybe another than 0.1.0: its project",
        ),
    ],
)
def test_a_broken_plugin_is_kept_with_its_reason(asked, plugin, message):
    assert message in asked["broken"][plugin]


def test_broken_plugins_leave_the_others_alone(asked):
    assert asked["robots"]["rover"] == "rover-plugin 1.2.3"
    assert asked["robots"]["freight"] == "hpp-framework 0.1.0"
    assert asked["robots"]["own"] == "second-fetch 1.2.3"
    assert len(asked["broken"]) == len(BAD) - 1


def test_what_a_plugin_registered_before_it_failed_is_forgotten(asked):
    assert "half" not in asked["robots"]
    assert asked["asked"]["half"].startswith("UnknownNameError: There is no robot called 'half'.")
    assert "It may belong to a plugin that could not be loaded" in asked["asked"]["half"]
    assert "half-way 1.2.3" in asked["asked"]["half"]


def test_a_name_of_two_plugins_belongs_to_neither_alone(asked):
    assert "fetch" not in asked["robots"]
    assert asked["asked"]["fetch"] == (
        "PluginError: Two robots are called 'fetch': one from hpp-framework 0.1.0, one from second-fetch "
        "1.2.3. Write 'hpp-framework/fetch' or 'second-fetch/fetch', or uninstall one of them."
    )
    assert asked["asked"]["second-fetch/fetch"] == "second-fetch 1.2.3"
    assert asked["asked"]["hpp-framework/fetch"] == "hpp-framework 0.1.0"


def test_list_and_doctor_show_what_is_broken_and_why(bad):
    code = """
        import contextlib, io, json
        from hpp_framework.cli.doctor import _plugins
        from hpp_framework.cli.main import main

        def printed(*words):
            with contextlib.redirect_stdout(io.StringIO()) as out:
                main(words)
            return out.getvalue()

        found = {"json": json.loads(printed("list", "--json")), "table": printed("list", "robots")}
        print(json.dumps({**found, "doctor": [_plugins().fine, _plugins().detail, _plugins().remedy]}))
    """
    shown = in_fresh_process(bad, code)
    rover = next(robot for robot in shown["json"]["robots"] if robot["name"] == "rover")
    assert rover == {
        "name": "rover", "summary": "a test's own robot", "distribution": "rover-plugin", "version": "1.2.3",
    }  # fmt: skip
    assert len(shown["json"]["broken"]) == len(BAD) - 1
    assert shown["json"]["clashes"][0]["name"] == "fetch"
    table = " ".join(shown["table"].split())
    assert "plugins that could not be loaded" in table
    assert "half-way 1.2.3" in table
    fine, detail, remedy = shown["doctor"]
    assert not fine
    assert detail.endswith(f"{len(BAD)} problems")
    assert "no licence key" in remedy
    assert "Two robots are called 'fetch'" in remedy


def test_an_unknown_name_suggests_a_plugins_name(site):
    code = """
        import json
        from hpp_framework.utils.errors import UnknownNameError
        from hpp_framework.plugins.registry import hub

        try:
            hub().robots.create("rovr")
        except UnknownNameError as error:
            print(json.dumps({"error": str(error)}))
    """
    error = in_fresh_process(site, code)["error"]
    assert "There is no robot called 'rovr'. Did you mean 'rover'?" in error
    assert "fetch" in error
