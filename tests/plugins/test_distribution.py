"""What is shipped: the wheel's contents, the environment's repaired cv2, and the pins."""

from __future__ import annotations

import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = {
    "hpp_framework": ROOT / "hpp_framework",
    "hpp_skills": ROOT / "skills" / "hpp_skills",
    "hpp_tasks": ROOT / "tasks" / "hpp_tasks",
    "hpp_robots": ROOT / "robots" / "hpp_robots",
}
DATA = {".yaml", ".safetensors", ".json", ".toml", ".md", ".vert", ".frag", ".glsl", ".typed"}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> zipfile.ZipFile:
    """Return the wheel that hatchling builds from this checkout, without isolation and without a network."""
    folder = tmp_path_factory.mktemp("wheel")
    build = "import sys, hatchling.build as b; print(b.build_wheel(sys.argv[1]))"
    done = subprocess.run(
        [sys.executable, "-c", build, str(folder)], cwd=ROOT, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    return zipfile.ZipFile(folder / done.stdout.split()[-1])


def test_the_wheel_ships_the_four_packages_and_nothing_else(wheel):
    top = {name.split("/")[0] for name in wheel.namelist()}
    assert {name for name in top if not name.endswith(".dist-info")} == set(PACKAGES)


def test_the_wheel_holds_every_module_and_data_file(wheel):
    shipped = set(wheel.namelist())
    for package, folder in PACKAGES.items():
        for file in folder.rglob("*"):
            if file.suffix in {".py", *DATA} and "__pycache__" not in file.parts:
                assert f"{package}/{file.relative_to(folder).as_posix()}" in shipped


def test_the_wheel_says_that_it_is_typed_and_licensed(wheel):
    assert "hpp_framework/py.typed" in wheel.namelist()
    info = next(name for name in wheel.namelist() if name.endswith(".dist-info/METADATA"))
    metadata = wheel.read(info).decode()
    assert "License-Expression: Apache-2.0" in metadata
    assert "Requires-Python: >=3.11" in metadata
    assert any(name.endswith("licenses/LICENSE") for name in wheel.namelist())
    license_text = (ROOT / "LICENSE").read_text()
    assert "Apache License" in license_text
    assert len(license_text) > 10_000


def test_the_wheel_names_command_and_plugins(wheel):
    info = next(name for name in wheel.namelist() if name.endswith(".dist-info/entry_points.txt"))
    text = wheel.read(info).decode()
    assert re.search(r"\[console_scripts\]\nhpp = ", text)
    assert re.search(r"\[hpp_framework.plugins\]\nhpp_framework = .*\nhpp_robots = .*\nhpp_skills = ", text)


def test_the_version_is_said_once(wheel):
    import hpp_framework

    assert f"hpp_framework-{hpp_framework.__version__}-" in wheel.filename.split("/")[-1]
    assert f"## {hpp_framework.__version__}" in (ROOT / "CHANGELOG.md").read_text()


def test_cv2_is_the_headless_build():
    import cv2

    gui = re.search(r"GUI:\s*(\S+)", cv2.getBuildInformation())
    assert gui, "this build of OpenCV does not say what GUI it has"
    assert gui[1] == "NONE", "opencv-python has overwritten opencv-python-headless; run scripts/make-venv.sh"


def test_pins_are_usable_elsewhere():
    pins = [
        line
        for line in (ROOT / "constraints" / "ci.txt").read_text().splitlines()
        if not line.startswith("#")
    ]
    assert all(re.fullmatch(r"[A-Za-z0-9_.-]+==[0-9][0-9a-z.]*", pin) for pin in pins)
    assert any(pin.startswith("torch==") for pin in pins)
    names = [pin.partition("==")[0].lower().replace("_", "-") for pin in pins]
    assert len(names) == len(set(names))


def test_every_dependency_is_pinned():
    import tomllib

    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    wanted = project["dependencies"] + extras["dev"] + extras["docs"]
    pins = (ROOT / "constraints" / "ci.txt").read_text().lower().replace("_", "-")
    for requirement in wanted:
        name = re.match(r"[A-Za-z0-9_.-]+", requirement)
        assert name
        assert f"\n{name[0].lower().replace('_', '-')}==" in pins, requirement
