"""The registry: fresh objects, lazy imports, and errors that name both sides."""

from __future__ import annotations

import sys

import pytest

from hpp_framework.plugins.registry import Hub, Registry, hub
from hpp_framework.utils.errors import PluginError, UnknownNameError


@pytest.fixture
def robots() -> Registry:
    return Registry("robot")


def test_lookups_build_fresh_objects_with_the_arguments_given(robots):
    robots.add("box", lambda *args, **kwargs: [args, kwargs])
    first, second = robots.create("box", 1, size=2), robots.create("box", 1, size=2)
    assert first == second == [(1,), {"size": 2}]
    assert first is not second


def test_a_name_is_imported_when_first_used(robots):
    sys.modules.pop("this", None)
    robots.add("zen", "colorsys:rgb_to_hsv", summary="colours")
    sys.modules.pop("colorsys", None)
    assert "colorsys" not in sys.modules
    assert robots.create("zen", 0.0, 0.0, 0.0) == (0.0, 0.0, 0.0)
    assert "colorsys" in sys.modules


def test_unknown_name_suggests(robots):
    robots.add("fetch", list)
    with pytest.raises(UnknownNameError, match="no robot called 'fetsh'. Did you mean 'fetch'"):
        robots.create("fetsh")
    assert "fetsh" not in robots
    assert "fetch" in robots


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("pytest/door", "pytest is installed, but registers no robot: 'hpp check pytest' says what"),
        ("no-such-package/door", None),
        ("own-plugin/door", None),
        ("/door", None),
        ("pytest", None),
    ],
)
def test_an_installed_package_that_registers_none_of_the_kind_is_named(robots, name, hint, monkeypatch):
    versions = {"pytest": "9.0", "own-plugin": "1.0"}
    monkeypatch.setattr(
        "hpp_framework.plugins.registry.installed", lambda names: {each: versions.get(each) for each in names}
    )
    robots.set_origin("own-plugin 1.0")
    robots.add("rover", list)
    with pytest.raises(UnknownNameError) as error:
        robots.create(name)
    if hint is None:
        assert "installed" not in str(error.value)
    else:
        assert hint in str(error.value)


def test_duplicate_names_both_origins(robots):
    robots.set_origin("first-plugin 1.0")
    robots.add("rover", list)
    robots.set_origin("second-plugin 2.0")
    with pytest.raises(PluginError, match=r"Two robots are called 'rover': one from first-plugin 1\.0, "
                                          r"one from second-plugin 2\.0"):  # fmt: skip
        robots.add("rover", dict)
    assert robots.create("rover") == []


@pytest.mark.parametrize("name", ["", " fetch", "fetch ", "a,b"])
def test_unusable_names_are_refused(robots, name):
    with pytest.raises(PluginError, match="not a usable robot name"):
        robots.add(name, list)


@pytest.mark.parametrize("source", ["no_such_module_anywhere:thing", "math:no_such_thing", "math", "tests:"])
def test_a_source_that_cannot_be_imported_names_entry_and_origin(robots, source):
    robots.set_origin("broken-plugin 0.1")
    robots.add("ghost", source)
    with pytest.raises(PluginError, match="'ghost' from broken-plugin 0.1 could not be loaded from"):
        robots.create("ghost")


def test_iteration_is_sorted_and_shows_summaries(robots):
    robots.add("b", list, summary="second")
    robots.add("a", list, summary="first")
    assert [(entry.name, entry.summary) for entry in robots] == [("a", "first"), ("b", "second")]


def test_a_hub_has_a_registry_for_every_noun():
    registries = Hub().registries()
    assert {"robots", "skills", "tasks", "worlds", "planners", "predictors"} <= set(registries)
    assert all(isinstance(registry, Registry) for registry in registries.values())
    assert Hub().robots is not Hub().robots


def test_bundled_names_come_through_the_entry_points():
    assert {"fetch", "freight"} <= {entry.name for entry in hub().robots}
    assert "p2p" in hub().skills
    assert "rendezvous" in hub().tasks
    assert {"hpp", "centralized-mp", "centralized-oa", "centralized-rp"} <= {e.name for e in hub().planners}
    assert {"training", "simple", "wall", "navigation"} <= {e.name for e in hub().worlds}
    assert all("hpp-framework" in entry.origin for entry in hub().robots)


def test_every_registered_source_can_be_imported():
    for name, registry in hub().registries().items():
        for entry in registry:
            assert callable(entry.factory()), (name, entry.name)


def test_everything_a_user_can_list_has_a_summary():
    for name in ("robots", "skills", "tasks", "worlds", "planners", "predictors"):
        for entry in hub().registries()[name]:
            # other tests of this process may have added what they need
            assert entry.summary or entry.origin == "this process", (name, entry.name)


def test_registered_robots_are_fresh_and_equal():
    first, second = hub().robots.create("fetch"), hub().robots.create("fetch")
    assert first == second
    assert first is not second
