"""The reference in docs says all: every command, every configuration, every check of the doctor."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import re
import shlex
import sys
from pathlib import Path

import pytest
import tyro

from hpp_framework.cli import main as command_line

DOCS = Path(__file__).parents[2] / "docs"
sys.path.insert(0, str(DOCS / "_extensions"))
reference = pytest.importorskip("hpp_reference", reason="needs the extra 'docs'")

CONFIGURATION = (DOCS / "reference" / "configuration.rst").read_text()
LISTED = re.findall(r"hpp-config:: (\S+)", CONFIGURATION)


@pytest.fixture(scope="module")
def helps() -> dict[str, str]:
    return {" ".join(words): text for words, text in reference.commands()}


def test_every_command_is_in_the_reference(helps):
    said = " ".join(" ".join(helps.values()).split())
    for name in reference.public_modules("hpp_framework.cli"):
        for command in vars(importlib.import_module(name)).values():
            if inspect.isclass(command) and command.__module__ == name and hasattr(command, "run"):
                first = " ".join(inspect.cleandoc(command.__doc__ or "").split("\n\n")[0].split())
                assert first in said, f"{name}.{command.__name__} is missing from the reference of commands"


def test_help_fits_its_page(helps):
    assert {"", "run", "train predictor", "evaluate skill"} <= set(helps)
    assert "--seed INT" in helps["run"]
    assert max(len(line) for text in helps.values() for line in text.splitlines()) <= reference.WIDTH


def test_configurations_are_found():
    assert {"hpp_framework.planning.hpp.lattice.LatticeConfig", "hpp_skills.p2p.recipe.Recipe"} <= set(LISTED)
    assert not set(LISTED) & set(reference.other_configs(CONFIGURATION))
    assert set(reference.configs()) <= {*LISTED, *reference.other_configs(CONFIGURATION)}


@pytest.mark.parametrize("path", [*LISTED, *reference.other_configs(CONFIGURATION)])
def test_every_setting_is_described(path):
    module, _, name = path.rpartition(".")
    config = getattr(importlib.import_module(module), name)
    table = reference.config_table(config)
    assert all(f"``{field.name}``" in table for field in dataclasses.fields(config))


def test_troubleshooting_explains_every_check_of_the_doctor():
    source = (DOCS.parent / "hpp_framework" / "cli" / "doctor.py").read_text()
    checks = set(re.findall(r'Finding\(\s*"([^"]+)"', source))
    assert len(checks) >= 9
    headings = set(re.findall(r"^## (.+)$", (DOCS / "troubleshooting.md").read_text(), re.MULTILINE))
    assert checks <= headings


def commands_in_docs() -> list[tuple[str, str]]:
    found = []
    for page in sorted([*DOCS.rglob("*.md"), DOCS.parent / "README.md"]):
        for block in re.findall(r"```(?:sh|bash|console)?\n(.*?)```", page.read_text(), re.DOTALL):
            for line in block.replace("\\\n", " ").splitlines():
                if re.match(r"(\.venv/bin/)?hpp ", line):
                    found.append((page.name, line))
    return found


def test_every_command_in_the_docs_can_be_read():
    lines = commands_in_docs()
    assert len(lines) > 40
    for page, line in lines:
        assert understood(shlex.split(line, comments=True)[1:]), f"{page}: hpp does not understand '{line}'"


def understood(words: list[str]) -> bool:
    config = (tyro.conf.FlagConversionOff,)
    try:
        tyro.cli(command_line.Command, prog="hpp", args=words, config=config, console_outputs=False)
    except SystemExit:
        return False
    return True
