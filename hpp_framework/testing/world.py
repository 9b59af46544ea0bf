"""``check_world``: whether a generator is one of its seed, and robots find room in what it makes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.world import World, box_corners
from hpp_framework.sim.batch.simulator import BatchSimulator
from hpp_framework.testing.build import build, find_source
from hpp_framework.testing.purity import GLOBAL_RNG, drawn_since, global_states, restored_generators, seed_all
from hpp_framework.testing.report import Report, Rule
from hpp_framework.testing.scene import find_robots, first
from hpp_framework.utils.seeding import numpy_rng
from hpp_framework.worlds.loader import LARGEST_SIDE, load_world
from hpp_framework.worlds.spawn import spawn_poses

SEEDED = Rule(
    name="world-seed",
    why="a run is repeated from its seed, on other machines and in other processes.",
    fix="a world drawn from the rng that is passed in, and from nothing else: no time, no set order, "
    "no counter.",
)
WORLD_NAME = Rule(
    name="world-name",
    why="results and their files are named after the world.",
    fix='World(name="...") of letters, digits, spaces, "-" and "_".',
)
BOUNDS = Rule(
    name="bounds",
    why="robots, goals and free space are within the bounds; what lies outside is paid for and never met.",
    fix="obstacles that reach into bounds, or wider bounds; sides of 1 to 200 m.",
)
LOW = Rule(
    name="unseen-obstacle",
    why="a robot touches it, but its lidar passes above it.",
    fix="an obstacle of at least the lidar's height, or none.",
)
ROOM = Rule(
    name="no-room",
    why="no team can start there.",
    fix="fewer obstacles, a smaller spawn.distance or clearance, or a spawn.center area that is free; "
    "fixed starts "
    "apart from each other and from obstacles.",
)
TOUCHES = Rule(
    name="start-touches",
    why="an episode begins with a collision that no robot could have prevented.",
    fix="starts with a clearance; obstacles whose base and height say truly what robots drive under.",
)
RULES = (SEEDED, WORLD_NAME, BOUNDS, LOW, ROOM, TOUCHES)

SIGNATURE = "(rng: numpy.random.Generator) -> World"

BESIDE = 1.0
"""Metres outside of the bounds where an obstacle may stand: a table leg that came to lie in the wall."""


def check_world(
    world: str | Path | World | Callable[[np.random.Generator], World],
    *,
    robots: Sequence[RobotSpec] | None = None,
    seeds: int = 3,
) -> None:
    """Check a world or a generator of worlds.

    Args:
        world: registered name, world file (.yaml), factory or object.
        robots: team that must find room; None for a pair.
        seeds: how many worlds of a generator are looked at.

    Raises:
        CheckError: if anything is wrong; holds everything that was found.
        UnknownNameError: if nothing has that name.
        ConfigError: if a world file has a mistake.
    """
    if isinstance(world, Path) or (isinstance(world, str) and world.endswith((".yaml", ".yml"))):
        world = load_world(Path(world))
    source, report = find_source("world", world, World)
    team = list(robots) if robots is not None else first(find_robots(source.distribution), 2)
    made: list[Any] = []
    if source.factory is None:
        made = [source.made]
    else:
        found = build(source, report, (numpy_rng(0, "checks"),), World, SIGNATURE, fresh=False)
        if isinstance(found, World):
            with report.guarded("the generator", "for some seeds"):
                made = [_check_seed(report, source.factory, seed) for seed in range(seeds)]
    for seed, each in enumerate(made):
        if isinstance(each, World):
            _check_contents(report, each, team)
            _check_room(report, each, team, seed)
    report.finish()


def _check_seed(report: Report, factory: Callable[..., Any], seed: int) -> Any:
    """Make one world twice, under other global generators; return it."""
    worlds: list[Any] = []
    drew: set[str] = set()
    with restored_generators():
        for attempt in (1, 2):
            seed_all(attempt)
            states = global_states()
            worlds.append(factory(numpy_rng(seed, "checks")))
            drew |= set(drawn_since(states))
    if drew:
        report.add(
            GLOBAL_RNG, "the generator", f"drew from the global generator of {' and '.join(sorted(drew))}."
        )
    elif worlds[0] != worlds[1]:
        report.add(
            SEEDED, "the generator",
            f"made two worlds of one seed: {_sum(worlds[0])}, then {_sum(worlds[1])}.",
        )  # fmt: skip
    return worlds[0]


def _sum(world: World) -> str:
    kinds = {"boxes": world.boxes, "cylinders": world.cylinders, "meshes": world.meshes}
    return " and ".join(f"{len(things)} {name}" for name, things in kinds.items() if things) or "an empty one"


def _check_contents(report: Report, world: World, robots: Sequence[RobotSpec]) -> None:
    odd = not world.name.strip() or not world.name.isprintable() or any(mark in world.name for mark in ",/\\")
    report.require(not odd, WORLD_NAME, "name", f"is {world.name!r}.")
    x_min, y_min, x_max, y_max = world.bounds
    longest = max(x_max - x_min, y_max - y_min)
    report.require(
        longest <= LARGEST_SIDE, BOUNDS, "bounds", f"span {longest:g} m; the most is {LARGEST_SIDE:g} m."
    )
    corners = box_corners(world.boxes)
    reach: list[tuple[str, Any, Any]] = [
        (f"boxes[{i}]", each.min(0), each.max(0)) for i, each in enumerate(corners)
    ]
    for i, cylinder in enumerate(world.cylinders):
        center = np.array(cylinder.center)
        reach.append((f"cylinders[{i}]", center - cylinder.radius, center + cylinder.radius))
    for name, low, high in reach:
        if (high < (x_min - BESIDE, y_min - BESIDE)).any() or (low > (x_max + BESIDE, y_max + BESIDE)).any():
            report.add(
                BOUNDS, name,
                f"reaches from {low.round(2).tolist()} to {high.round(2).tolist()}, all of it outside of "
                f"{list(world.bounds)}.",
            )  # fmt: skip
    seen_from = min(robot.lidar.height for robot in robots)
    for name, thing in [
        *((f"boxes[{i}]", box) for i, box in enumerate(world.boxes)),
        *((f"cylinders[{i}]", cylinder) for i, cylinder in enumerate(world.cylinders)),
    ]:
        top = thing.base + thing.height
        report.require(
            top >= seen_from, LOW, name, f"is {top:.2f} m high; the lidar looks at {seen_from:.2f} m."
        )


def _check_room(report: Report, world: World, robots: Sequence[RobotSpec], seed: int) -> None:
    starts: Any = None
    with report.guarded("spawn", rule=ROOM):
        starts = spawn_poses(world, robots, numpy_rng(seed, "checks", "spawn"))
    if starts is None:
        return
    with (
        report.guarded("the world", "in the batch simulator"),
        BatchSimulator(robots, threads=1) as simulator,
    ):
        poses = torch.from_numpy(starts).float()[None]
        simulator.reset([world], poses)
        state = simulator.step(torch.zeros(1, len(robots), 2))
        if bool(state.collided.any()):
            place = [round(v, 2) for v in poses[0, int(state.collided[0].int().argmax())].tolist()]
            report.add(TOUCHES, "spawn", f"puts a robot at {place}, where it touches something at once.")
