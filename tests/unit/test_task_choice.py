"""Tasks by name, with settings, and from YAML files: what they say and what is refused."""

from __future__ import annotations

import json

import pytest
import torch
from hpp_tasks.formation import eq1_weight

from hpp_framework.config.task_file import make_task, task_name
from hpp_framework.core.composition import ComposedTask
from hpp_framework.core.term import Term
from hpp_framework.evaluation import folder
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import ConfigError, HppError

MEET_AT_DOOR = """
reward:
  - {term: region, x: 2, y: 1, weight: 2}
  - {term: clearance, least: 0.2}
success:
  - {term: region, x: 2, y: 1, radius: 0.8}
  - {term: distance, first: alice, second: bob, most: 1.0, at_most: 0.25}
sustain_steps: 3
rest_speed: null
halts: false
"""


@pytest.fixture
def team():
    return parse_team("alice=fetch,bob=freight")


@pytest.fixture
def written(tmp_path):
    def write(text):
        file = tmp_path / "my_task.yaml"
        file.write_text(text)
        return str(file)

    return write


def test_settings_reach_the_task(team):
    task = make_task("formation:shape=ring:spacing=2:tolerance=0.25", team.robots, team.ids)
    assert isinstance(task, ComposedTask)
    assert task.limits[0].at_most == 0.25
    placed = torch.tensor([[[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]])
    assert task.success(placed).tolist() == [True]
    assert task.reward(placed + torch.tensor([[[0.0] * 3, [1.0, 0.0, 0.0]]])).item() == pytest.approx(
        -2 * 0.5 * eq1_weight(2)
    )


def test_a_file_says_all_of_a_task(team, written):
    task = make_task(written(MEET_AT_DOOR), team.robots, team.ids)
    assert (task.sustain_steps, task.halts) == (3, False)
    gap = 0.5 - sum(robot.footprint_radius for robot in team.robots)
    beside = torch.tensor([[[1.5, 1.0, 0.0], [2.0, 1.0, 0.0]]])
    assert task.success(beside).tolist() == [True]
    apart = torch.tensor([[[0.0, 1.0, 0.0], [2.0, 1.0, 0.0]]])
    assert task.success(apart).tolist() == [False]
    assert task.reward(apart).item() == pytest.approx(-2 * 2.0)
    crowded = torch.tensor([[[3.5, 1.0, 0.0], [4.0, 1.0, 0.0]]])
    assert task.reward(crowded).item() == pytest.approx(-2 * (1.5 + 2.0) - (0.2 - gap), abs=1e-5)
    moving = torch.tensor([[[0.5, 0.0], [0.0, 0.0]]])
    assert task.success(beside, moving).tolist() == [True]


def test_robots_without_ids_go_by_their_index(team, written):
    file = written(MEET_AT_DOOR.replace("alice", "'0'").replace("bob", "'1'"))
    assert make_task(file, team.robots).sustain_steps == 3


def test_terms_come_from_plugins_too(team, written, register):
    class Never(Term):
        def __init__(self, much):
            self.much = much

        def errors(self, poses):
            return torch.full_like(poses[..., 0], self.much)

    register("terms", "never", lambda robots, *, much: Never(much))
    file = written("reward: [{term: never, much: 0.5, weight: 3}]\nsuccess: [{term: never, much: 1}]")
    assert make_task(file, team.robots).reward(torch.zeros(1, 2, 3)).tolist() == [-3.0]


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("formaton", ["no task called 'formaton'", "'formation'"]),
        ("formation:shpe=line", ["'shpe' is no setting of task 'formation'", "'shape'", "spacing"]),
        ("formation:spacing=far", ["'spacing'", "1.2", "'far'"]),
        ("formation:spacing=-1", ["spacing", "positive"]),
        ("formation:shape=square", ["no shape called 'square'", "line, ring"]),
        ("formation:roles=mine", ["roles", "fixed"]),
        ("formation:offsets=[[0, 0]]", ["1 places for 2 robots"]),
        ("formation:offsets=[1, 2]", ["[[0, 0], [1.2, 0]]"]),
        ("rendezvous:radius=1", ["'radius' is no setting of task 'rendezvous'", "It has none"]),
        ("region:radius=wide", ["'radius' of task 'region'", "0.0", "'wide'"]),
        ("region:x", ["NAME=VALUE", "'x'"]),
    ],
)
def test_wrong_settings_say_what_is_right(team, text, parts):
    with pytest.raises(HppError) as caught:
        make_task(text, team.robots, team.ids)
    for part in parts:
        assert part in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ("reward:", "rewards:", ["'rewards' is not a known key", "'reward'"]),
        (
            "clearance, least",
            "clearence, least",
            ["'reward[1]'", "no term called 'clearence'", "'clearance'"],
        ),
        (
            "radius: 0.8",
            "radios: 0.8",
            ["'success[0]'", "'radios' is no setting of term 'region'", "'radius'"],
        ),
        ("first: alice", "first: carol", ["'success[1]'", "'carol' is no robot of the team", "alice, bob"]),
        ("{term: region, x: 2, y: 1, weight: 2}", "{term: region, x: 2}", ["'reward[0]'", "needs 'y'"]),
        ("x: 2, y: 1, weight", "x: two, y: 1, weight", ["'reward[0]'", "'x' of term 'region'", "'two'"]),
        ("weight: 2", "weight: heavy", ["'reward[0].weight' must be a number"]),
        ("at_most: 0.25", "at_most: -1", ["'success[1].at_most' must be at least 0"]),
        ("sustain_steps: 3", "sustain_steps: 0", ["'sustain_steps' must be at least 1"]),
        ("sustain_steps: 3", "sustain_steps: 2.5", ["whole number"]),
        ("rest_speed: null", "rest_speed: 0", ["'rest_speed' must be greater than 0"]),
        ("halts: false", "halts: no way", ["'halts' must be true or false"]),
        ("term: clearance", "least: 0", ["line 4", "given twice"]),
        ("- {term: clearance, least: 0.2}", "- clearance", ["'reward[1]' names no term"]),
    ],
)
def test_mistakes_in_files_are_named(team, written, old, new, parts):
    assert old in MEET_AT_DOOR
    file = written(MEET_AT_DOOR.replace(old, new, 1))
    with pytest.raises(HppError) as caught:
        make_task(file, team.robots, team.ids)
    for part in [file, *parts]:
        assert part in str(caught.value)


@pytest.mark.parametrize(
    ("reward", "parts"),
    [
        (
            lambda poses: poses[..., 0],
            ("one value a team", r"(2, 5, 2). Sum over robots: .sum(-1). `hpp check`"),
        ),
        (lambda poses: poses[:, 1, 0, 0], ("one value a team", "is of shape (2,)")),
        (lambda poses: poses.reshape(2, 3).sum(-1), ("raises RuntimeError", "any leading dimensions")),
        (lambda _: 0.0, ("is of shape ()",)),
    ],
)
def test_answers_of_another_shape_are_refused(team, register, reward, parts):
    class Wrong(type(make_task("rendezvous", team.robots))):
        def reward(self, poses):
            return reward(poses)

    register("tasks", "wrong", lambda _: Wrong(1.0))
    with pytest.raises(ConfigError) as caught:
        make_task("wrong", team.robots)
    for part in ("task 'wrong': reward() of poses of shape (2, 5, 2, 3)", *parts):
        assert part in str(caught.value)


def test_a_missing_file_is_no_task(team):
    with pytest.raises(HppError, match=r"nowhere\.yaml: there is no such file.*task files"):
        make_task("nowhere.yaml", team.robots)


@pytest.mark.parametrize("count", [1, 2, 3, 4])
@pytest.mark.parametrize("name", [entry.name for entry in hub().tasks])
def test_every_task_is_batched_and_forgives_unknown_headings(fetch, name, count):
    if name in NEED_TWO and count < 2:
        pytest.skip("about two robots")
    task = make_task(name, [fetch] * count)
    poses = torch.randn(3, 2, count, 3, generator=torch.Generator().manual_seed(count))
    assert task.reward(poses).shape == task.success(poses).shape == (3, 2)
    assert task.reward(poses)[1].allclose(task.reward(poses[1]), atol=1e-4)
    poses[..., 2] = torch.nan
    assert bool(task.reward(poses).isfinite().all())
    targets = task.targets(torch.zeros(3, 2, 2), poses)
    assert targets is None or targets.shape == (3, 2, count, 3)


NEED_TWO = ("handover", "follow", "pursuit")


def test_a_run_folder_knows_its_task_file(written, tmp_path):
    file = written(MEET_AT_DOOR)
    config = tmp_path / "config.json"
    config.write_text(json.dumps({"task": file, "task_file": folder.task_digest(file)}))
    assert folder.read_config(config, "run")["task"] == file
    written(MEET_AT_DOOR.replace("0.8", "0.9"))
    with pytest.raises(HppError, match="task file .* has changed"):
        folder.read_config(config, "run")
    assert folder.task_digest("formation:shape=ring") is None


def test_tasks_have_short_names():
    assert [task_name(text) for text in ("formation:shape=ring", "here/my_task.yaml")] == [
        "formation",
        "my_task",
    ]
