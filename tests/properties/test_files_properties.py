"""Whatever a file holds, reading it works or ends with an error of the project."""

from __future__ import annotations

import math

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from hpp_framework.config.settings import parse_settings
from hpp_framework.config.task_file import make_task
from hpp_framework.config.team_file import effective_team, read_team_file
from hpp_framework.config.yaml_files import parse_yaml
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import ConfigError, HppError
from hpp_framework.worlds.loader import load_world

KEYS = """
    name bounds walled boxes cylinders meshes spawn center size yaw_deg height base radius file position scale
    distance axis_deg axis_spread_deg clearance poses members id robot skill planner control disturbances
    believes weights joins_at leaves_at reward success term weight at_most sustain_steps rest_speed halts
    dropout
""".split()  # noqa: SIM905  # shorter than a list
WORDS = ["fetch", "p2p", "hpp", "spread", "alice", "", "\x00", "é", "a/b"]
NUMBERS = st.floats() | st.integers(-10, 10) | st.integers()
LEAVES = st.none() | st.booleans() | NUMBERS | st.dates() | st.sampled_from(WORDS) | st.text(max_size=5)
CONTENTS = st.recursive(
    LEAVES,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from(KEYS), inner, max_size=4),
    max_leaves=20,
)
PIECES = [
    *"{}[],:-?&*!|>'\"%@`#~ ab\n\t\x07",
    "\n  ",
    "---",
    "...",
    "<<",
    "&a",
    "*a",
    "!!int",
    "010",
    "1:30",
    ".nan",
]
SNIPPETS = st.lists(st.sampled_from([*PIECES, "9" * 400]) | st.text(max_size=3), max_size=15).map(" ".join)
FEW = settings(max_examples=40, deadline=None)

WORLD = {"bounds": [-5, -5, 5, 5], "boxes": [{"center": [2, 0], "size": [1, 1]}], "spawn": {"distance": 3}}
TASK = {
    "reward": [{"term": "spread", "weight": 2}], "success": [{"term": "spread", "at_most": 1}],
    "sustain_steps": 3, "rest_speed": 0.1,
}  # fmt: skip
TEAM = {
    "disturbances": "field",
    "members": [{"id": "alice", "robot": "fetch", "disturbances": "paper", "joins_at": 0, "leaves_at": 9}],
}


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return tmp_path_factory.mktemp("files") / "some.yaml"


def read_task(file):
    return make_task(str(file), [hub().robots.create("fetch")] * 2)


READERS = {"world": (load_world, WORLD), "task": (read_task, TASK), "team": (read_team_file, TEAM)}


def paths(content, *path):
    """Return the paths to all numbers in nested lists and mappings."""
    if isinstance(content, dict | list):
        inside = content.items() if isinstance(content, dict) else enumerate(content)
        return [found for key, each in inside for found in paths(each, *path, key)]
    return [path] if isinstance(content, int | float) else []


def replaced(content, path, value):
    """Return a copy with another value in one place."""
    if not path:
        return value
    copy = dict(content) if isinstance(content, dict) else list(content)
    copy[path[0]] = replaced(content[path[0]], path[1:], value)
    return copy


def refusal(read, *given):
    """Return the text of the project's error, None if there is none; any other error passes."""
    try:
        read(*given)
    except HppError as error:
        return str(error)
    return None


def refused(read, file, content):
    file.write_text(yaml.safe_dump(content))
    return refusal(read, file)


@FEW
@given(SNIPPETS)
def test_any_text_is_yaml_or_refused_with_a_place(text):
    message = refusal(parse_yaml, text, "it")
    assert message is None or message.startswith("it: ")


@FEW
@given(st.text(max_size=12))
def test_any_text_is_a_setting_or_refused(text):
    message = refusal(parse_settings, [f"a={text}"], "--set")
    assert message is None or "'a'" in message


@pytest.mark.parametrize("kind", READERS)
@FEW
@given(content=CONTENTS)
def test_any_content_is_read_or_refused(file, kind, content):
    message = refused(READERS[kind][0], file, content)
    assert message is None or message.startswith(str(file))


@pytest.mark.parametrize("kind", READERS)
@FEW
@given(data=st.data(), value=CONTENTS)
def test_any_value_in_a_good_file_is_read_or_refused(file, kind, data, value):
    read, good = READERS[kind]
    path = data.draw(st.sampled_from(paths(good)))
    message = refused(read, file, replaced(good, path, value))
    assert message is None or message.startswith(str(file))


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e5, "1", True])
@pytest.mark.parametrize("kind", READERS)
def test_what_is_no_usable_number_is_refused_wherever_a_number_is_expected(file, kind, value):
    read, good = READERS[kind]
    assert refused(read, file, good) is None
    for path in paths(good):
        assert f"{path[0]}" in (refused(read, file, replaced(good, path, value)) or ""), path


@FEW
@given(CONTENTS)
def test_the_effective_team_is_its_own_effective_team(tmp_path_factory, content):
    file = tmp_path_factory.getbasetemp() / "team.yaml"
    for entry in ({"id": "alice", "robot": "fetch", "joins_at": content}, {"id": "a", "robot": "fetch"}):
        try:
            team = effective_team({"members": [entry]}, file)
        except ConfigError:
            continue
        assert effective_team(team, file) == team
