"""Control stacks: how they are named, that mistakes are explained, and what must hold of every layer."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch

from hpp_framework.config.control_choice import make_control, parse_control
from hpp_framework.config.planner_choice import parameters
from hpp_framework.config.settings import altered
from hpp_framework.control.safety_filter import SafetyFilter
from hpp_framework.control.terminal_approach import TerminalApproach
from hpp_framework.core.control import ControlContext, ControlLayer
from hpp_framework.core.disturbances import Disturbances
from hpp_framework.core.world import Box, World
from hpp_framework.episodes.core import EpisodeBatch
from hpp_framework.evaluation.experiment import Experiment, run_experiment
from hpp_framework.plugins.build import parse_team
from hpp_framework.plugins.builtin import DEFAULT_CONTROL
from hpp_framework.plugins.registry import hub
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.utils.errors import ConfigError, UnknownNameError
from hpp_framework.worlds.generators.training import training
from hpp_framework.worlds.spawn import spawn_poses

LAYERS = [entry.name for entry in hub().layers]
TASKS = ("rendezvous", "handover")


def stack_of(text, names="fetch,freight", agent=0, task="rendezvous"):
    robots = parse_team(names).robots
    return make_control(text, robots, agent, hub().tasks.create(task, robots))


def test_a_stack_is_built_in_its_order_with_its_settings():
    stack = stack_of(" terminal-approach:near=1.2:careful=0.5 , safety-filter", agent=1)
    assert [type(layer) for layer in stack.layers] == [TerminalApproach, SafetyFilter]
    assert (stack.layers[0].config.near, stack.layers[0].config.careful) == (1.2, 0.5)
    assert stack.layers[0].agent == 1
    assert parameters(stack.layers[1]) == parameters(stack_of("safety-filter").layers[0])


def test_none_is_an_empty_stack():
    assert parse_control(" none ") == ()
    assert stack_of("none").layers == ()


def test_the_default_stack_has_all_bundled_layers():
    assert sorted(choice.name for choice in parse_control(DEFAULT_CONTROL)) == LAYERS
    assert len(stack_of(DEFAULT_CONTROL).layers) == len(LAYERS)


@pytest.mark.parametrize(
    ("text", "kind", "words"),
    [
        ("safety-filtr", UnknownNameError, "safety-filtr.*[Dd]id you mean 'safety-filter'"),
        ("safety-filter,none", UnknownNameError, "none"),
        ("safety-filter,stop-on-success,safety-filter", ConfigError, "names layer 'safety-filter' twice"),
        ("safety-filter:margin=0,safety-filter", ConfigError, "names layer 'safety-filter' twice"),
        ("safety-filter,,stop-on-success", ConfigError, "has an empty entry.*single commas, or write 'none'"),
        ("", ConfigError, "has an empty entry"),
        ("safety-filter,", ConfigError, "has an empty entry"),
        (":margin=1", ConfigError, "has an empty entry"),
        ("safety-filter:margin", ConfigError, "margin"),
        ("safety-filter:margin=0:margin=1", ConfigError, "margin"),
        ("safety-filter:margn=1", ConfigError, "layer 'safety-filter'.*margn.*'margin'"),
        ("safety-filter:margin=wide", ConfigError, "margin"),
        ("safety-filter:margin=-1", ConfigError, "'margin' must be at least 0"),
        ("stop-on-success:beyond=-1", ConfigError, "beyond >= 0"),
    ],
)
def test_mistakes_are_explained(text, kind, words):
    with pytest.raises(kind, match=words):
        stack_of(text)


def test_experiments_refuse_mistakes_before_anything_is_written(tmp_path):
    wrong = Experiment(worlds=("simple",), planners=("centralized-mp",), control="safety-filtr", episodes=1)
    with pytest.raises(UnknownNameError, match="safety-filter"):
        run_experiment(wrong, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@dataclass(frozen=True, kw_only=True)
class SlowConfig:
    """How slow.

    Attributes:
        share: of the speed.
    """

    share: float = 0.5


class Slow(ControlLayer):
    """Lets robots drive at a share of the speed."""

    def __init__(self, config):
        self.config = config

    def filter(self, observation, waypoint, command):
        return command * torch.tensor([self.config.share, 1.0])


def slow(context: ControlContext):
    assert context.robot is context.robots[context.agent]
    return Slow(altered(SlowConfig(), context.settings, "layer 'test-slow'"))


def test_a_layer_of_ones_own_runs_in_an_experiment(register, tmp_path):
    register("layers", "test-slow", slow)
    driven = {}
    for control in ("none", "test-slow", "test-slow:share=0"):
        experiment = Experiment(
            worlds=("simple",), planners=("centralized-rp",), control=control, episodes=1, seed=3
        )
        (cell,) = run_experiment(experiment, tmp_path / control.replace(":", "-"))["cells"]
        driven[control] = cell["final_distance_mean_m"]
    # robots start 5 m apart, and stay so where no speed is left
    assert driven["test-slow:share=0"] == pytest.approx(5.0, abs=1e-3)
    assert len(set(driven.values())) == 3


def test_settings_of_a_layer_without_settings_are_refused(register):
    register("layers", "test-bare", lambda context: ControlLayer())
    assert len(stack_of("test-bare").layers) == 1
    with pytest.raises(ConfigError, match="layer 'test-bare' has no settings, but 'test-bare:x=1'"):
        stack_of("test-bare:x=1")


@pytest.fixture(scope="module")
def seen():
    """Return what the first of two robots knows: at speed towards the other, before a box, and in rooms."""
    robots = parse_team("fetch,freight").robots
    rng = np.random.default_rng(4)
    worlds, starts = [], []
    for gap in (1.4, 1.5, 1.6, 2.2, 2.6, 3.0, 3.4):
        worlds.append(World(name="open"))
        starts.append([[0.0, 0.0, 0.1], [gap, 0.0, np.pi]])
    for gap in (0.9, 1.1, 1.3, 1.5):
        worlds.append(World(name="box", boxes=(Box(center=(gap + 0.5, 0.2), size=(1.0, 1.0)),)))
        starts.append([[0.0, 0.0, 0.0], [-3.0, 3.0, 0.0]])
    for _ in range(4):
        worlds.append(training(rng))
        starts.append(spawn_poses(worlds[-1], robots, rng))
    batch = EpisodeBatch(BatchSimulator(robots), disturbances=Disturbances(position_std=0.005))
    batch.begin(worlds, torch.from_numpy(np.stack(starts)).float(), range(len(worlds)))
    for _ in range(6):
        batch.step(torch.tensor([1.0, 0.0]).expand(len(worlds), 2, 2))
    # the last robot's lidar has not sent anything that can be believed for a while
    scan_age = torch.zeros(len(worlds))
    scan_age[-1] = 0.4
    return replace(batch.observe(0), scan_age=scan_age)


def asked(layer, seen):
    """Return what a layer makes of waypoints all around the robots, and of commands."""
    count = len(seen.pose)
    generator = torch.Generator().manual_seed(1)
    goal = seen.pose[:, :2] + 6 * torch.rand(count, 2, generator=generator) - 3
    goal[::3] = seen.pose[::3, :2] - 4 * torch.stack([seen.pose[::3, 2].cos(), seen.pose[::3, 2].sin()], -1)
    command = torch.tensor([1.0, 0.2]) - torch.rand(count, 2, generator=generator) * torch.tensor([0.2, 0.4])
    return goal, command, layer.redirect(seen, goal, goal), layer.filter(seen, goal, command)


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("name", LAYERS)
def test_layers_are_stateless(name, task, seen):
    """The same question has the same answer, whatever was asked in between, and inputs stay as they are."""
    layer = stack_of(name, task=task)
    _, _, *first = asked(layer, seen)
    before = [seen.poses.clone(), seen.scans.clone(), seen.velocity.clone()]
    late = replace(seen, poses=seen.poses.flip(1), velocity=seen.velocity + 0.3)
    asked(layer, late)
    _, _, *again = asked(layer, seen)
    for one, other in zip(first, again, strict=True):
        assert torch.equal(one, other)
    for one, other in zip(before, (seen.poses, seen.scans, seen.velocity), strict=True):
        assert torch.equal(one, other)


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("name", LAYERS)
def test_layers_do_not_mix_the_episodes_of_a_batch(name, task, seen):
    layer = stack_of(name, task=task)
    goal, command, waypoints, commands = asked(layer, seen)
    for row in range(len(goal)):
        alone, rows = seen.episodes(slice(row, row + 1)), slice(row, row + 1)
        assert torch.equal(layer.redirect(alone, goal[rows], goal[rows])[0], waypoints[row])
        assert torch.equal(layer.filter(alone, goal[rows], command[rows])[0], commands[row])


@pytest.mark.parametrize("name", LAYERS)
def test_the_questions_above_are_answered_by_every_layer(name, seen):
    """A layer that changed nothing there would pass whatever it did elsewhere."""
    goal, command, waypoints, commands = asked(stack_of(name), seen)
    changed = (waypoints != goal).any(1) | (commands != command).any(1)
    assert int(changed.sum()) > 0
