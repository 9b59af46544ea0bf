"""What is shipped: the wheel's contents, the environment's repaired cv2, and the pins."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import sysconfig
import tarfile
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


def build(kind: str, checkout: Path, folder: Path) -> Path:
    """Return the ``wheel`` or ``sdist`` that hatchling builds, without isolation and without a network."""
    code = f"import sys, hatchling.build as b; print(b.build_{kind}(sys.argv[1]))"
    done = subprocess.run(
        [sys.executable, "-c", code, str(folder)], cwd=checkout, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    return folder / done.stdout.split()[-1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> zipfile.ZipFile:
    return zipfile.ZipFile(build("wheel", ROOT, tmp_path_factory.mktemp("wheel")))


@pytest.fixture(scope="module")
def clean(wheel, tmp_path_factory) -> Path:
    """Return an environment that has the wheel and what it needs, but not this checkout."""
    home = tmp_path_factory.mktemp("clean")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", home], check=True)
    python = home / "bin" / "python"
    install = [sys.executable, "-m", "pip", "--python", python, "install", "-qq", "--no-deps", "--no-index"]
    subprocess.run([*install, wheel.filename], check=True)
    site = next(home.glob("lib/python*/site-packages"))
    # a folder named in a .pth joins the path, but its own .pth files, the checkout's among them, are not read
    (site / "needed.pth").write_text(sysconfig.get_path("purelib"))
    return home


def hpp(clean: Path, *words: str) -> str:
    done = subprocess.run(
        [clean / "bin" / "hpp", *words], cwd=clean, capture_output=True, text=True, timeout=800
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


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


def test_the_sdist_is_enough_to_build_the_same_wheel(wheel, tmp_path):
    with tarfile.open(build("sdist", ROOT, tmp_path)) as archive:
        archive.extractall(tmp_path, filter="data")
    (unpacked,) = (path for path in tmp_path.iterdir() if path.is_dir())
    assert {path.name for path in unpacked.iterdir()} >= {"README.md", "LICENSE", "docs", "tests"}
    again = zipfile.ZipFile(build("wheel", unpacked, tmp_path))
    assert {each.filename: each.CRC for each in again.infolist()} == {
        each.filename: each.CRC for each in wheel.infolist()
    }


def test_the_wheel_works_without_the_checkout(clean):
    code = "import hpp_framework, sys; print(hpp_framework.__file__, sys.path)"
    done = subprocess.run(
        [clean / "bin" / "python", "-c", code], cwd=clean, capture_output=True, text=True, timeout=120
    )
    assert str(clean) in done.stdout.split()[0]
    assert f"'{ROOT}'" not in done.stdout
    listed = hpp(clean, "list")
    assert all(name in listed for name in ("fetch", "p2p", "rendezvous", "navigation", "far-sighted"))


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_wheel_films_an_episode_with_its_own_weights(clean):
    said = hpp(clean, "run", "--world", "simple", "--backend", "batch", "--out", "film")
    assert "film" in said
    assert (clean / "film" / "episode.mp4").stat().st_size > 1000
    assert json.loads((clean / "film" / "config.json").read_text())["planners"] == ["hpp"]


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_doctor_is_content_with_the_wheel(clean):
    said = hpp(clean, "doctor")
    for fine in ("batch simulator: works", "plugins: ", "weights: "):
        assert f"ok  {fine}" in said


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
    wanted = project["dependencies"] + extras["dev"] + extras["docs"] + extras["examples"]
    pins = (ROOT / "constraints" / "ci.txt").read_text().lower().replace("_", "-")
    for requirement in wanted:
        name = re.match(r"[A-Za-z0-9_.-]+", requirement)
        assert name
        assert f"\n{name[0].lower().replace('_', '-')}==" in pins, requirement
