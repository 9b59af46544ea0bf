"""Plugins of other people: a distribution is built, installed into a folder and found in a fresh process."""

from __future__ import annotations

import json
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

ROVER = """
    import dataclasses

    from hpp_framework.registry import hub


    def register(hub):
        hub.robots.add("rover", "rover_plugin:rover", summary="a test's own robot")


    def rover():
        return dataclasses.replace(hub().robots.create("freight"), name="rover", mass=12.0)
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
    from hpp_framework.errors import HppError
    from hpp_framework.registry import hub

    try:
        robots = {entry.name: entry.origin for entry in hub().robots}
        print(json.dumps({"robots": robots}))
    except HppError as error:
        print(json.dumps({"error": f"{type(error).__name__}: {error}"}))
"""


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
        [sys.executable, "-c", path + textwrap.dedent(code)], capture_output=True, text=True, timeout=120
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


def test_a_plugins_robot_drives_in_a_team_of_both_kinds(site):
    code = """
        import json
        import torch
        from hpp_framework.sim.batch import BatchSimulator
        from hpp_framework.team import parse_team
        from hpp_framework.worlds.world import World

        team = parse_team("rover,fetch")
        simulator = BatchSimulator(team.robots)
        world = World(name="room", bounds=(-5, -5, 5, 5))
        simulator.reset([world], torch.tensor([[[-2.0, 0, 0], [2, 0, 0]]]))
        for _ in range(5):
            state = simulator.step(torch.ones(1, 2, 2))
        print(json.dumps({"ids": team.ids, "x": state.poses[0, 0, 0].item()}))
    """
    shown = in_fresh_process(site, code)
    assert shown["ids"] == ["rover", "fetch"]
    assert shown["x"] > -2.0


def test_nothing_is_imported_before_the_first_look_up(site):
    code = """
        import json, sys
        import hpp_framework.registry
        late = {"rover_plugin", "hpp_robots", "hpp_skills", "warp", "sapien", "torch"}
        early = sorted(late & set(sys.modules))
        list(hpp_framework.registry.hub().robots)
        print(json.dumps({"early": early, "loaded": "rover_plugin" in sys.modules}))
    """
    assert in_fresh_process(site, code) == {"early": [], "loaded": True}


@pytest.mark.parametrize(
    ("name", "code", "message"),
    [
        (
            "broken-import",
            "import no_such_module_at_all",
            "PluginError: The plugin 'broken_import' of broken-import 1.2.3 failed to register: "
            "ModuleNotFoundError(\"No module named 'no_such_module_at_all'\"). "
            "Fix 'broken_import:register' or uninstall broken-import 1.2.3.",
        ),
        (
            "no-register",
            "x = 1",
            "PluginError: The plugin 'no_register' of no-register 1.2.3 failed to register: AttributeError",
        ),
        (
            "raises-register",
            "def register(hub):\n    raise ValueError('no licence key')",
            "PluginError: The plugin 'raises_register' of raises-register 1.2.3 failed to register: "
            "ValueError('no licence key')",
        ),
        (
            "second-fetch",
            "def register(hub):\n    hub.robots.add('fetch', 'second_fetch:fetch')",
            "PluginError: Two robots are called 'fetch': one from hpp-framework 0.1.0, one from "
            "second-fetch 1.2.3. Rename one or uninstall one of the two.",
        ),
    ],
)
def test_a_bad_plugin_is_an_error_that_names_it(tmp_path, name, code, message):
    error = in_fresh_process(install(tmp_path, name, code), SHOW)["error"]
    assert error.startswith(message)


def test_an_unknown_name_suggests_a_plugins_name(site):
    code = """
        import json
        from hpp_framework.errors import UnknownNameError
        from hpp_framework.registry import hub

        try:
            hub().robots.create("rovr")
        except UnknownNameError as error:
            print(json.dumps({"error": str(error)}))
    """
    error = in_fresh_process(site, code)["error"]
    assert "There is no robot called 'rovr'. Did you mean 'rover'?" in error
    assert "fetch" in error
