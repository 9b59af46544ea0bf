"""``hpp new``: the packages that it writes install, register, and pass their own tests."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
import tomllib

import pytest

from hpp_framework.cli.main import main
from hpp_framework.onboarding.names import Name
from hpp_framework.onboarding.scaffold import PACKAGE, SAMPLES

NAMED = {"task": "Lab_A/by-the-window", "skill": "lab-b/slow-and-sure", "robot": "lab-c/hexa-bot"}
"""Other names than the templates'."""
SPELLINGS = ("package", "package_module", "thing", "thing_module", "class_name")
WORDS = {getattr(Name(PACKAGE, thing), spelling) for thing in SAMPLES.values() for spelling in SPELLINGS}
SHOW = """
import json
from hpp_framework.plugins.registry import hub
found = {kind: {e.name: e.origin for e in hub().registries()[kind]} for kind in ("tasks", "skills", "robots")}
print(json.dumps(found | {"qualified": "lab-a/by-the-window" in hub().tasks}))
"""


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Return a folder with a package of every kind, written under other names than the templates'."""
    folder = tmp_path_factory.mktemp("new")
    for kind, name in NAMED.items():
        main(["new", kind, name, "--out", str(folder)])
    return folder


@pytest.fixture(scope="module")
def site(written):
    """Return a folder that all of them are installed in."""
    pip = "-m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --no-index"
    packages = [str(written / name) for name in ("lab-a", "lab-b", "lab-c")]
    target = ["--target", str(written / "site")]
    subprocess.run([sys.executable, *pip.split(), *target, *packages], check=True, timeout=240)
    return written / "site"


def python(site, *arguments, **options):
    environment = {**os.environ, "PYTHONPATH": str(site)}
    return subprocess.run(
        [sys.executable, *arguments], env=environment, capture_output=True, text=True, timeout=240, **options
    )


def test_nothing_of_the_templates_names_is_left(written):
    files = [file for file in written.rglob("lab-*/**/*") if file.is_file()]
    # that of a task brings no weights
    assert len(files) == 6 + 7 + 7
    for file in files:
        text = file.read_text() + str(file.relative_to(written))
        assert not [word for word in WORDS if word in text], file
        if file.suffix == ".py":
            ast.parse(file.read_text())
    project = tomllib.loads((written / "lab-a" / "pyproject.toml").read_text())["project"]
    assert project["name"] == "lab-a"
    assert project["entry-points"]["hpp_framework.plugins"] == {"lab_a": "lab_a.plugin:register"}


def test_every_package_registers_what_it_brings(site):
    done = python(site, "-c", SHOW)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["tasks"]["by-the-window"] == "lab-a 0.1.0"
    assert found["skills"]["slow-and-sure"] == "lab-b 0.1.0"
    assert found["robots"]["hexa-bot"] == "lab-c 0.1.0"
    assert found["qualified"]


def test_every_package_passes_its_own_tests(written, site):
    folders = [str(written / name / "tests") for name in ("lab-a", "lab-b", "lab-c")]
    done = python(site, "-m", "pytest", "-q", "-p", "no:cacheprovider", *folders, cwd=written)
    assert done.returncode == 0, done.stdout + done.stderr
    assert " passed" in done.stdout
    assert "skipped" not in done.stdout


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("my+pkg/door", "'my+pkg/door' is no usable name. Write PACKAGE/NAME, e.g. 'my-pkg/rover'"),
        ("my-pkg/", "'my-pkg/' is no usable name"),
        ("7wonders/door", "'7wonders/door' is no usable name"),
        ("my-pkg/class", "'my-pkg/class' is no usable name"),
        ("my-pkg/a/b", "'my-pkg/a/b' is no usable name"),
        (".pkg", "'.pkg' is no usable name"),
        ("numpy/door", "would be imported as 'numpy', and a module of that name is installed already"),
        ("json", "would be imported as 'json', and a module of that name is installed already"),
        ("hpp-framework", "and a module of that name is installed already. Choose another name."),
        ("my-pkg/plugin", "'plugin' is the name of a module that every package has"),
    ],
)
def test_names_that_cannot_be_used_are_refused(refused, name, message):
    refused(f"new task {name}", [message])


def test_a_package_of_ones_own_that_is_installed_can_be_added_to_or_removed(site):
    done = python(site, "-c", "from hpp_framework.cli.main import main; main(['new', 'skill', 'lab-a/shy'])")
    assert done.returncode == 2
    assert "Choose another name, or uninstall it: pip uninstall lab-a." in done.stderr
    assert 'into its plugin.py: hub.KIND.add("shy", "lab_a.shy:shy")' in done.stderr


def test_a_folder_that_is_there_is_left_alone(tmp_path, capsys):
    (tmp_path / "my-pkg").mkdir()
    with pytest.raises(SystemExit) as stop:
        main(["new", "task", "my-pkg", "--out", str(tmp_path)])
    assert stop.value.code == 2
    assert "my-pkg' is there already; nothing was written. Choose another name" in capsys.readouterr().err
    assert not list((tmp_path / "my-pkg").iterdir())


def test_the_next_commands_are_said(tmp_path, capsys):
    main(["new", "task", "Some_Lab", "--out", str(tmp_path)])
    assert (tmp_path / "some-lab" / "some_lab" / "meet_at_door.py").is_file()
    said = capsys.readouterr().out
    assert f"cd {tmp_path / 'some-lab'}\n  pip install -e '.[test]'\n  pytest" in said
