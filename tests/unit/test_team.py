"""Teams from text."""

from __future__ import annotations

import pytest

from hpp_framework.core.team import Member, Team
from hpp_framework.plugins.build import parse_team
from hpp_framework.utils.errors import ConfigError, UnknownNameError


@pytest.mark.parametrize(
    ("text", "ids", "robots"),
    [
        ("fetch,freight", ("fetch", "freight"), ("fetch", "freight")),
        (" fetch , freight ", ("fetch", "freight"), ("fetch", "freight")),
        ("fetch,fetch,freight", ("fetch-1", "fetch-2", "freight"), ("fetch", "fetch", "freight")),
        ("alice=fetch,bob=freight", ("alice", "bob"), ("fetch", "freight")),
        ("alice=fetch,fetch", ("alice", "fetch"), ("fetch", "fetch")),
        ("fetch", ("fetch",), ("fetch",)),
    ],
)
def test_teams_keep_their_order_and_number_equal_models(text, ids, robots):
    team = parse_team(text)
    assert team.ids == ids
    assert tuple(robot.name for robot in team.robots) == robots
    assert len(team) == len(ids)
    assert {member.skill for member in team.members} == {"p2p"}


@pytest.mark.parametrize("text", ["", "  ", ",", "fetch,", ",fetch", "fetch,,freight"])
def test_empty_entries_are_refused(text):
    with pytest.raises(ConfigError, match="has an empty entry; write robots separated by commas"):
        parse_team(text)


@pytest.mark.parametrize("text", ["=fetch", "alice=", "="])
def test_half_an_assignment_is_refused(text):
    with pytest.raises(ConfigError, match="write 'id=robot'"):
        parse_team(text)


@pytest.mark.parametrize("text", ["a=fetch,a=freight", "fetch=freight,fetch"])
def test_an_id_used_twice_is_refused(text):
    with pytest.raises(ConfigError, match="is used twice"):
        parse_team(text)


def test_unknown_robots_and_skills_are_suggested():
    with pytest.raises(UnknownNameError, match="no robot called 'fetsh'. Did you mean 'fetch'"):
        parse_team("fetsh,freight")
    with pytest.raises(UnknownNameError, match="no skill called 'p2q'. Did you mean 'p2p'"):
        parse_team("fetch", skill="p2q")


def test_a_team_needs_a_robot():
    with pytest.raises(ConfigError, match="at least one robot"):
        Team(())


def test_members_of_a_team_made_by_hand_need_their_own_ids(fetch, freight):
    with pytest.raises(ConfigError, match="'a' is used twice"):
        Team((Member(id="a", robot=fetch, skill="p2p"), Member(id="a", robot=freight, skill="p2p")))
