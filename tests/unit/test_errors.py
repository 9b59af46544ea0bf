"""Messages of unknown names."""

from __future__ import annotations

import inspect

import pytest

from hpp_framework.utils import errors


@pytest.mark.parametrize(
    ("name", "expected"),
    [("fetsh", " Did you mean 'fetch'?"), ("Freight", " Did you mean 'freight'?"), ("zzzz", ""), ("", "")],
)
def test_suggests_the_nearest_name_only_if_it_is_near(name, expected):
    assert errors.suggest(name, ["fetch", "freight"]) == expected


def test_unknown_name_says_what_was_looked_up_and_what_exists():
    message = str(errors.unknown_name("planner", "hp", ["hpp", "centralized-mp"]))
    assert message == "There is no planner called 'hp'. Did you mean 'hpp'? Known: centralized-mp, hpp."


def test_unknown_name_among_nothing():
    assert str(errors.unknown_name("robot", "fetch", [])) == "There is no robot called 'fetch'. Known: none."


def test_every_error_is_an_hpp_error():
    kinds = [kind for _, kind in inspect.getmembers(errors, inspect.isclass) if issubclass(kind, Exception)]
    assert all(issubclass(kind, errors.HppError | UserWarning) for kind in kinds)
