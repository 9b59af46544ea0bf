"""Values that configs and YAML files refuse, and the text that says so."""

from __future__ import annotations

import dataclasses
import math
from typing import Literal

import pytest

from hpp_framework.config.settings import parse_settings
from hpp_framework.config.yaml_files import DEEPEST, LARGEST_FILE, parse_yaml, read_yaml
from hpp_framework.core.world import Box
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.validation import Count, Number, Share, validated

BOMB = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{new}: &{new} [{', '.join([f'*{old}'] * 10)}]\n" for old, new in zip("abcdef", "bcdefg", strict=True)
)
CHAIN = "a0: &a0 [1]\n" + "".join(f"a{i}: &a{i} [*a{i - 1}]\n" for i in range(1, 60))


@validated
class ExampleConfig:
    """For tests only."""

    count: Count = 1
    share: Share = 0.5
    place: tuple[Number, Number] = (0.0, 0.0)
    kind: Literal["near", "far"] = "near"
    inner: Box | None = None


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"count": 0}, "example: 'count' must be at least 1, got 0. Use 1 or more."),
        ({"count": 1.5}, "example: 'count' must be a whole number, got 1.5."),
        ({"count": True}, "example: 'count' must be a whole number, got True."),
        ({"share": 1.5}, "example: 'share' must be at most 1, got 1.5."),
        ({"share": math.nan}, "example: 'share' must be finite, got nan."),
        ({"share": "0.5"}, "example: 'share' must be a number, got '0.5'. Write it unquoted"),
        ({"place": (0.0, math.inf)}, "example: 'place[1]' must be finite, got inf."),
        ({"place": (0.0,)}, "example: 'place[1]' is missing."),
        ({"kind": "near by"}, "example: 'kind' must be 'near' or 'far', got 'near by'. Did you mean 'near'?"),
        (
            {"cuont": 3},
            "example: 'cuont' is not a known key. Did you mean 'count'? Known here: count, share,",
        ),
    ],
)
def test_configs_say_which_value_is_wrong_and_what_would_be_right(given, message):
    with pytest.raises(ConfigError) as caught:
        ExampleConfig(**given)
    assert str(caught.value).startswith(message)


def test_configs_are_frozen_dataclasses_whose_copies_are_checked_too():
    config = ExampleConfig(count=2, place=(1, 2))
    assert config == ExampleConfig(count=2, place=(1.0, 2.0))
    assert hash(config) == hash(dataclasses.replace(config))
    assert dataclasses.asdict(config)["place"] == (1.0, 2.0)
    with pytest.raises(dataclasses.FrozenInstanceError):
        config.count = 3
    with pytest.raises(ConfigError, match="'count' must be at least 1"):
        dataclasses.replace(config, count=0)


def test_a_config_keeps_the_very_objects_it_is_given():
    box = Box(center=(0, 0), size=(1, 1))
    assert ExampleConfig(inner=box).inner is box


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("time: 1:30", "line 1, column 7: '1:30' is no plain decimal number"),
        ("at: [010]", "'010' is no plain decimal number"),
        ("at: 0x1F", "'0x1F' is no plain decimal number"),
        ("at: 0b11", "'0b11' is no plain decimal number"),
        ("at: 1_000", "'1_000' is no plain decimal number"),
        ("at: 1:30.5", "'1:30.5' is no plain decimal number"),
        ("at: " + "9" * 400, "a number of 400 characters is too long"),
        ("at: 0." + "9" * 400, "a number of 402 characters is too long"),
        ("3: 4", "the key '3' is not text; put it in quotes"),
        ("yes: 4", "the key 'yes' is not text"),
        ("~: 4", "the key '~' is not text"),
        ("[1]: 4", "a key must be text"),
        ("{a: 1}: 4", "a key must be text"),
        ("a: &b c\n*b : 4", "line 2, column 1: the alias '*b'"),
        ("a: {b: 1, b: 2}", "the key 'b' is given twice"),
        ("a: &a [*a]", "the alias '*a' stands for nothing that it may repeat here"),
        ("a: *b", "the alias '*b' stands for nothing"),
        (BOMB, "there are more than 200000 values, aliases written out"),
        (CHAIN, f"lists and mappings lie more than {DEEPEST} levels inside each other"),
        ("[" * 60 + "]" * 60, f"more than {DEEPEST} levels"),
        ("[" * 100_000, f"more than {DEEPEST} levels"),
        ("- " * 100_000, f"more than {DEEPEST} levels"),
        (
            "a: !!python/object/apply:os.getcwd []",
            "the tag 'tag:yaml.org,2002:python/object/apply:os.getcwd'",
        ),
        ("a: !!int x", "the tag 'tag:yaml.org,2002:int' is not allowed"),
        ("a: !!set {b, c}", "the tag 'tag:yaml.org,2002:set' is not allowed"),
        ("a: 1\n---\na: 2", "expected a single document"),
    ],
)
def test_yaml_that_is_read_otherwise_than_it_looks_or_exhausts_memory_is_refused(text, problem):
    with pytest.raises(ConfigError) as caught:
        parse_yaml(text, "it")
    assert str(caught.value).startswith("it: line ")
    assert problem in str(caught.value)


def test_usual_yaml_means_what_it_says():
    text = (
        "a: &a {x: 1, y: -2.5, z: [+3, 0, 0.0, .5, 1.0e-2, 1.5E+3]}\nb: *a\nc: {<<: *a, x: 4}\n"
        "d: '1:30'\ne: \"010\"\nf: far-sighted\ng: true\nh: ~\ni: .inf\n"
    )
    first = {"x": 1, "y": -2.5, "z": [3, 0, 0.0, 0.5, 0.01, 1500.0]}
    assert parse_yaml(text, "it") == {
        "a": first, "b": first, "c": {**first, "x": 4}, "d": "1:30", "e": "010", "f": "far-sighted",
        "g": True, "h": None, "i": math.inf,
    }  # fmt: skip
    assert parse_yaml("[" * DEEPEST + "]" * DEEPEST, "it")


def test_large_files_are_refused_unread(tmp_path):
    file = tmp_path / "large.yaml"
    with file.open("wb") as opened:
        opened.truncate(LARGEST_FILE + 1)
    with pytest.raises(ConfigError, match=r"large\.yaml: is larger than 10 MB"):
        read_yaml(file, kind="world", least="bounds: [0, 0, 1, 1]")


@pytest.mark.parametrize("value", ["1:30", "010", "[1, {", "9" * 5000, "\x07"])
def test_settings_that_no_yaml_has_are_refused_by_name(value):
    with pytest.raises(ConfigError, match="--set, setting 'a'"):
        parse_settings([f"a={value}"], "--set")
