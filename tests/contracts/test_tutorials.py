"""The three tutorials of the docs, from an empty folder: every command and every file as they are printed.

Blocks ``sh`` are run one after another in one shell; other blocks name a file in their first line and are
written to it. Nothing comes from a package index, and nothing is installed into the environment of the tests.
Two train for minutes and run where ``HPP_TESTS=all``, as ``.ci/run`` sets it; all commands of all three
must be understood.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import sysconfig
from pathlib import Path
from types import SimpleNamespace

import pytest

from hpp_framework.cli import main as command_line

PAGES = Path(__file__).parents[2] / "docs" / "tutorials"
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
NAMED = re.compile(r"(?:#|<!--) (\S+\.\w+)")
TUTORIALS = ("task", "skill", "robot")
TRAINING = ("skill", "robot")
HPP = "from hpp_framework.cli.main import main; main()"


@pytest.fixture
def environment(tmp_path) -> dict[str, str]:
    """Return the variables of an environment of its own, in which this one's packages are installed too."""
    folder = tmp_path / "venv"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True, timeout=120)
    (site,) = (folder / "lib").glob("python*/site-packages")
    (site / "installed.pth").write_text(f"import site; site.addsitedir({sysconfig.get_path('purelib')!r})\n")
    for name, code in (("hpp", f'-c "{HPP}"'), ("pip", "-m pip"), ("pytest", "-m pytest")):
        script = folder / "bin" / name
        script.write_text(f'#!/bin/sh\nexec "{folder}/bin/python" {code} "$@"\n')
        script.chmod(0o755)
    return {
        **os.environ, "PATH": f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}", "PIP_NO_INDEX": "1",
        "PIP_NO_BUILD_ISOLATION": "off", "PIP_DISABLE_PIP_VERSION_CHECK": "1", "OMP_NUM_THREADS": "1",
        # this environment has all of them, but for the opencv-python that sapien asks for: the headless one
        "PIP_NO_DEPS": "1",
        # films from above only: drawing in 3-D takes longer than all else
        "VK_ICD_FILENAMES": "/dev/null", "VK_DRIVER_FILES": "/dev/null",
    }  # fmt: skip


def script(page: Path) -> str:
    """Return a page as one script, which says in the end what processor time it took."""
    lines = ["set -euxo pipefail"]
    for number, (kind, content) in enumerate(BLOCK.findall(page.read_text(encoding="utf-8"))):
        if kind == "sh":
            lines.append(content)
            continue
        named = NAMED.match(content)
        assert named, f"block {number + 1} of {page.name} names no file in its first line"
        lines.append(f"cat > {named[1]} <<'END OF FILE'\n{content}END OF FILE")
    return "\n".join([*lines, "times"])


def commands(page: Path) -> list[str]:
    """Return what a page tells ``hpp`` to do."""
    shell = "".join(
        content for kind, content in BLOCK.findall(page.read_text(encoding="utf-8")) if kind == "sh"
    )
    return [
        line.removeprefix("hpp ").removesuffix(" || true")
        for line in shell.splitlines()
        if line[:4] == "hpp "
    ]


@pytest.mark.parametrize("name", TUTORIALS)
def test_every_command_is_understood(name, monkeypatch):
    parse, understood = command_line.tyro.cli, []

    def only_parse(*options, **named):
        understood.append(parse(*options, **named))
        return SimpleNamespace(run=lambda: None)

    monkeypatch.setattr(command_line.tyro, "cli", only_parse)
    told = commands(PAGES / f"{name}.md")
    for line in told:
        command_line.main(shlex.split(line))
    assert len(understood) == len(told) >= 5
    assert script(PAGES / f"{name}.md")


def test_every_tutorial_writes_packages_of_its_own():
    """So that a reader of all of them never meets a name that is taken."""
    written = [
        line.split()[2].partition("/")[0]
        for name in TUTORIALS
        for line in dict.fromkeys(commands(PAGES / f"{name}.md"))
        if line.startswith("new ") and "--answers" not in line
    ]
    assert len(set(written)) == len(written) >= 3


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.minutes] * (name in TRAINING)) for name in TUTORIALS]
)
def test_a_tutorial_ends_well(name, environment, tmp_path):
    folder = tmp_path / "empty"
    folder.mkdir()
    done = subprocess.run(
        ["bash", "-c", script(PAGES / f"{name}.md")], cwd=folder, env=environment, text=True, timeout=1200,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    print(done.stdout)
    assert done.returncode == 0, done.stdout[-4000:]
    END[name](folder, done.stdout)


def task_ends(folder, said):
    assert (folder / "my-task/out/door/distance.png").is_file()
    assert " checked, all fine" in said


def skill_ends(folder, said):
    assert (folder / "my-skill/my_skill/weights/far-sighted/other-freight-freight.safetensors").is_file()
    assert (folder / "my-skill/out/own/summary.json").is_file()
    assert (folder / "my-skill/out/shy/summary.json").is_file()


def robot_ends(folder, said):
    assert "  acceleration:  # highest acceleration" in said
    assert (folder / "my-robot/my_robot/weights/p2p/rover.safetensors").is_file()
    assert (folder / "my-robot/out/together/summary.json").is_file()
    assert "# Robot `my-robot/rover`" in said


END = {"task": task_ends, "skill": skill_ends, "robot": robot_ends}
