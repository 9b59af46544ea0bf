"""Shared by all tests: checked types and array shapes, one thread, robots and small worlds."""

from __future__ import annotations

import os
import sys
from functools import partial
from pathlib import Path

import jaxtyping

ROOT = Path(__file__).parents[1]
PACKAGES = ("hpp_framework", "robots/hpp_robots", "skills/hpp_skills", "tasks/hpp_tasks")
# an int is welcome where a float is asked for, as static checkers see it
CHECKER = "beartype.beartype(conf=beartype.BeartypeConf(is_pep484_tower=True))"
UNCHECKED = {
    # Warp compiles the source of its kernels; wrapping them breaks that
    "hpp_framework.control.safety_kernels",
    "hpp_framework.control.separation_kernels",
    "hpp_framework.sim.batch.kernels",
    "hpp_framework.sim.batch.drive_kernels",
    "hpp_framework.sim.batch.lidar_kernels",
    "hpp_framework.sim.batch.crowd_kernels",
    "hpp_framework.sim.batch.among_kernels",
    "hpp_framework.prediction.one_step_kernels",
    "hpp_framework.perception.local_map_kernels",
    "hpp_framework.perception.estimators.tracker_kernels",
    "hpp_skills.dwa.window_kernels",
    "hpp_tasks.target_slots_kernels",
}


def _modules() -> list[str]:
    """Name every module but the packages' own files, whose names would be prefixes of the unchecked ones."""
    names: list[str] = []
    for package in PACKAGES:
        folder = ROOT / package
        for file in sorted(folder.rglob("*.py")):
            if file.name != "__init__.py":
                names.append(".".join([folder.name, *file.relative_to(folder).with_suffix("").parts]))
    return [name for name in names if name not in UNCHECKED]


# must come before the first import of any of them: modules imported earlier would go unchecked;
# pytest itself imports the errors, to make our warnings fail tests
_early = sorted(set(sys.modules) & set(_modules()) - {"hpp_framework.utils.errors"})
assert not _early, f"imported before the shape checks were switched on: {_early}"
jaxtyping.install_import_hook(_modules(), CHECKER)

import numpy as np  # noqa: E402  # after the hook, as above
import pytest  # noqa: E402  # after the hook
import torch  # noqa: E402  # after the hook

from hpp_framework.core.planner import Decision, MetaPlanner, certain  # noqa: E402  # after the hook
from hpp_framework.core.robot import RobotSpec  # noqa: E402  # after the hook
from hpp_framework.core.world import Box, Cylinder, World  # noqa: E402  # after the hook
from hpp_framework.plugins.registry import hub  # noqa: E402  # after the hook

# two threads on shared cores are slower than one, and one is the same on every machine
torch.set_num_threads(1)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave tests that take minutes to those who ask for them."""
    if os.environ.get("HPP_TESTS") == "all":
        return
    for item in items:
        if item.get_closest_marker("minutes"):
            item.add_marker(pytest.mark.skip(reason="takes minutes; set HPP_TESTS=all"))


@pytest.fixture(scope="session")
def fetch() -> RobotSpec:
    """Return the registered Fetch."""
    return hub().robots.create("fetch")


@pytest.fixture(scope="session")
def freight() -> RobotSpec:
    """Return the registered Freight."""
    return hub().robots.create("freight")


@pytest.fixture(scope="session")
def pair(fetch: RobotSpec, freight: RobotSpec) -> tuple[RobotSpec, RobotSpec]:
    """Return the paper's team."""
    return fetch, freight


@pytest.fixture(scope="session")
def empty_world() -> World:
    """Return 20 x 20 m without anything, walls neither."""
    return World(name="empty", bounds=(-10, -10, 10, 10), walled=False)


@pytest.fixture(scope="session")
def small_world() -> World:
    """Return a walled room of 8 x 8 m with a box, a slanted box and a pillar; its middle is free."""
    return World(
        name="small",
        bounds=(-4, -4, 4, 4),
        boxes=(
            Box(center=(2.5, 2.0), size=(1.0, 0.6)),
            Box(center=(-2.5, 2.0), size=(1.2, 0.3), yaw=0.7),
        ),
        cylinders=(Cylinder(center=(0.0, -3.0), radius=0.3),),
    )


@pytest.fixture
def rng() -> np.random.Generator:
    """Return a fresh numpy generator with a fixed seed."""
    return np.random.default_rng(0)


@pytest.fixture
def torch_rng() -> torch.Generator:
    """Return a fresh torch generator with a fixed seed."""
    return torch.Generator().manual_seed(0)


class _FixedGoal(MetaPlanner):
    plan_every = 5

    def __init__(self, x, y):
        self.goal = torch.tensor([[x, y]])

    def plan(self, observation, belief, rng):
        del belief, rng
        goal = self.goal.expand(len(observation.pose), 2)
        return Decision(goal, certain(goal))


@pytest.fixture(scope="session")
def fixed_goal():
    """Planner that wants all robots at a place (x, y)."""
    return _FixedGoal


@pytest.fixture(scope="session")
def play():
    """Return a function that runs a team, all of which takes part all the time, through episodes.

    Agents are built from an :class:`AgentConfig`, a planner's name, or given.
    """
    from hpp_framework.agents.build import AgentConfig, build_agents
    from hpp_framework.core.schedule import permanent
    from hpp_framework.evaluation.rollout import run_episodes
    from hpp_framework.sim.batch.simulator import BatchSimulator

    def run(team, task, worlds, starts, agents="centralized-mp", *, seeds=None, **options):
        if isinstance(agents, str):
            agents = AgentConfig(planner=agents)
        if isinstance(agents, AgentConfig):
            agents = build_agents(team, task, agents, worlds[0].bounds)
        seeds = range(len(worlds)) if seeds is None else seeds
        with BatchSimulator(team.robots, threads=1) as simulator:
            return run_episodes(
                simulator, worlds, starts, agents, permanent(task, len(team)), seeds=seeds, **options
            )

    return run


@pytest.fixture(scope="session")
def begun():
    """Return a function that begins episodes, in which agents can observe and drive."""
    from hpp_framework.episodes.core import EpisodeBatch
    from hpp_framework.sim.batch.simulator import BatchSimulator

    def begin(robots, worlds, starts, **options):
        batch = EpisodeBatch(BatchSimulator(robots, threads=1), **options)
        batch.begin(worlds, torch.as_tensor(starts, dtype=torch.float32), range(len(worlds)))
        return batch

    return begin


@pytest.fixture
def register(monkeypatch):
    """Return a function that registers a factory for the length of one test."""

    def add(kind, name, factory):
        from hpp_framework.plugins.registry import hub

        registry = hub().registries()[kind]
        monkeypatch.setattr(registry, "_entries", dict(registry._entries))
        registry.add(name, factory)

    return add


@pytest.fixture
def tiny_training(monkeypatch: pytest.MonkeyPatch) -> None:
    """Train the skill ``p2p`` with two robots in one world, and judge it by two steps."""
    from hpp_skills.p2p import train
    from hpp_skills.p2p.recipe import Recipe, Rooms

    from hpp_framework.evaluation.trial import Trial

    rooms = Rooms(world="training", count=1, goals=2, robots=2)
    monkeypatch.setattr(train, "Recipe", partial(Recipe, rooms=rooms))
    monkeypatch.setattr(train, "JUDGED", {"training": {"episodes": 1, "steps": 2}})
    monkeypatch.setattr(train, "Trial", partial(Trial, episodes=1, steps=2))


@pytest.fixture
def refused(tmp_path, monkeypatch, capsys):
    """Run a command in an empty folder; it must say what is expected, end with 2 and write nothing."""
    from hpp_framework.cli.main import main

    def run(command, expected):
        monkeypatch.chdir(tmp_path)
        with pytest.raises(SystemExit) as stop:
            main(command.split())
        captured = capsys.readouterr()
        message = " ".join((captured.err + captured.out).split())
        assert stop.value.code == 2
        assert "Traceback" not in message
        for part in expected:
            assert part in message
        assert not list(Path().iterdir())

    return run
