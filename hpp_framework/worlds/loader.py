"""World files: a world in YAML, checked so that every mistake names file, key and remedy.

The format is described in ``docs/worlds.md``. Angles in files are in degrees, their keys end in ``_deg``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np

from hpp_framework.config.fields import Source, join, read_yaml
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.world import Box, Cylinder, Mesh, SpawnRule, World
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import ConfigError, UnknownNameError
from hpp_framework.worlds.occupancy import free_space
from hpp_framework.worlds.slicing import load_mesh
from hpp_framework.worlds.spawn import check_spawn

T = TypeVar("T")
WorldFactory = Callable[[np.random.Generator], World]

SUFFIXES = (".yaml", ".yml")
LARGEST_SIDE = 200.0
"""Longest side of the bounds in metres; the occupancy grid of anything larger does not fit in memory."""

_WORLD = ("name", "bounds", "walled", "boxes", "cylinders", "meshes", "spawn")
_BOX = ("center", "size", "yaw_deg", "height", "base")
_CYLINDER = ("center", "radius", "height", "base")
_MESH = ("file", "position", "yaw_deg", "scale")
_SPAWN = ("distance", "center", "axis_deg", "axis_spread_deg", "clearance", "poses")
_CORNERS = ("x_min", "y_min", "x_max", "y_max")


def resolve_world(name_or_path: str) -> WorldFactory:
    """Return the factory of a registered world or of a world file.

    Args:
        name_or_path: a registered name, or a path that ends in ``.yaml`` or ``.yml``.

    Raises:
        ConfigError: if the file has a mistake.
        UnknownNameError: if nothing is registered under the name.
    """
    if name_or_path.lower().endswith(SUFFIXES):
        world = load_world(Path(name_or_path))
        return lambda rng: world
    try:
        return hub().worlds.entry(name_or_path).factory()
    except UnknownNameError as error:
        raise UnknownNameError(f"{error} A world file must end in .yaml or .yml.") from error


def load_world(file: Path, robots: Sequence[RobotSpec] = ()) -> World:
    """Read a world file.

    Args:
        file: the YAML file; mesh paths in it are relative to its folder.
        robots: a team; if given, it must also find room at the file's starts.

    Raises:
        ConfigError: if anything in the file is wrong; names the file, the key and the remedy.
    """
    file = Path(file)
    source = Source(file)
    content = source.mapping("", read_yaml(file), _WORLD, required=("bounds",))
    world = World(
        name=_name(source, content),
        bounds=_bounds(source, content["bounds"]),
        walled=source.flag("walled", content.get("walled", True)),
        boxes=_each(source, content, "boxes", _box),
        cylinders=_each(source, content, "cylinders", _cylinder),
        meshes=_each(source, content, "meshes", _mesh),
        spawn=_spawn(source, content.get("spawn")),
        file=file,
    )
    _check_places(source, world)
    _check_room(source, world)
    check_spawn(world, robots)
    return world


def _name(source: Source, content: dict[str, Any]) -> str:
    name = source.text("name", content.get("name", source.file.stem))
    if not name.isprintable() or any(mark in name for mark in ",/\\"):
        raise source.error("name", f"cannot be '{name}'", "Use letters, digits, spaces, '-' and '_'.")
    return name


def _bounds(source: Source, value: object) -> tuple[float, float, float, float]:
    x_min, y_min, x_max, y_max = source.numbers("bounds", value, _CORNERS)
    sides = (x_max - x_min, y_max - y_min)
    if min(sides) < 1 or max(sides) > LARGEST_SIDE:
        raise source.error(
            "bounds",
            f"span {sides[0]:g} x {sides[1]:g} m",
            f"Write [x_min, y_min, x_max, y_max] in metres, each side from 1 to {LARGEST_SIDE:g} m.",
        )
    return x_min, y_min, x_max, y_max


def _each(
    source: Source, content: dict[str, Any], key: str, build: Callable[[Source, str, object], T]
) -> tuple[T, ...]:
    entries = source.items(key, content.get(key))
    return tuple(build(source, f"{key}[{i}]", entry) for i, entry in enumerate(entries))


def _box(source: Source, key: str, value: object) -> Box:
    entry = source.mapping(key, value, _BOX, required=("center", "size"))
    return Box(
        center=_pair(source.numbers(f"{key}.center", entry["center"], ("x", "y"))),
        size=_pair(source.numbers(f"{key}.size", entry["size"], ("along x", "along y"), positive=True)),
        yaw=_angle(source, key, entry, "yaw_deg"),
        height=source.number(f"{key}.height", entry.get("height", 1.0), positive=True),
        base=source.number(f"{key}.base", entry.get("base", 0.0), low=0),
    )


def _cylinder(source: Source, key: str, value: object) -> Cylinder:
    entry = source.mapping(key, value, _CYLINDER, required=("center", "radius"))
    return Cylinder(
        center=_pair(source.numbers(f"{key}.center", entry["center"], ("x", "y"))),
        radius=source.number(f"{key}.radius", entry["radius"], positive=True),
        height=source.number(f"{key}.height", entry.get("height", 1.0), positive=True),
        base=source.number(f"{key}.base", entry.get("base", 0.0), low=0),
    )


def _mesh(source: Source, key: str, value: object) -> Mesh:
    entry = source.mapping(key, value, _MESH, required=("file",))
    place = source.numbers(f"{key}.position", entry.get("position", [0, 0, 0]), ("x", "y", "z"))
    mesh = Mesh(
        file=(source.file.parent / source.text(f"{key}.file", entry["file"])).resolve(),
        position=cast("tuple[float, float, float]", place),
        yaw=_angle(source, key, entry, "yaw_deg"),
        scale=source.number(f"{key}.scale", entry.get("scale", 1.0), positive=True),
    )
    try:
        load_mesh(mesh)
    except ConfigError as error:
        raise ConfigError(f"{source.file}: '{key}.file': {error}") from error
    return mesh


def _spawn(source: Source, value: object) -> SpawnRule:
    entry = source.mapping("spawn", {} if value is None else value, _SPAWN)
    rule = SpawnRule()
    if "poses" in entry:
        for name in entry:
            if name not in ("poses", "clearance"):
                raise source.error(
                    f"spawn.{name}", "has no use beside 'spawn.poses'", "Remove one of the two."
                )
    center = entry.get("center")
    return SpawnRule(
        distance=source.number("spawn.distance", entry.get("distance", rule.distance), positive=True),
        center=None if center is None else _area(source, "spawn.center", center),
        axis=_angle(source, "spawn", entry, "axis_deg") if entry.get("axis_deg") is not None else None,
        axis_spread=math.radians(
            source.number("spawn.axis_spread_deg", entry.get("axis_spread_deg", 0.0), low=0)
        ),
        clearance=source.number("spawn.clearance", entry.get("clearance", rule.clearance), low=0),
        poses=_poses(source, entry["poses"]) if "poses" in entry else None,
    )


def _area(source: Source, key: str, value: object) -> tuple[float, float, float, float]:
    x_min, y_min, x_max, y_max = source.numbers(key, value, _CORNERS)
    if x_min > x_max or y_min > y_max:
        raise source.error(key, f"has its corners swapped: {value}", "Write [x_min, y_min, x_max, y_max].")
    return x_min, y_min, x_max, y_max


def _poses(source: Source, value: object) -> tuple[tuple[float, float, float], ...]:
    entries = source.items("spawn.poses", value)
    if not entries:
        raise source.error(
            "spawn.poses", "is empty", "List a start [x, y, heading_deg] for each robot, or remove it."
        )
    starts: list[tuple[float, float, float]] = []
    for i, entry in enumerate(entries):
        x, y, heading = source.numbers(f"spawn.poses[{i}]", entry, ("x", "y", "heading_deg"))
        starts.append((x, y, math.radians(heading)))
    return tuple(starts)


def _angle(source: Source, key: str, entry: dict[str, Any], name: str) -> float:
    return math.radians(source.number(join(key, name), entry.get(name, 0.0)))


def _pair(values: tuple[float, ...]) -> tuple[float, float]:
    return values[0], values[1]


def _check_places(source: Source, world: World) -> None:
    """Refuse obstacles that lie wholly outside the bounds: nobody would ever meet them."""
    spans: list[tuple[str, np.ndarray, np.ndarray]] = []
    for i, box in enumerate(world.boxes):
        spans.append((f"boxes[{i}].center", box.corners().min(0), box.corners().max(0)))
    for i, cylinder in enumerate(world.cylinders):
        center = np.array(cylinder.center)
        spans.append((f"cylinders[{i}].center", center - cylinder.radius, center + cylinder.radius))
    for i, mesh in enumerate(world.meshes):
        low, high = np.asarray(load_mesh(mesh).bounds)[:, :2]
        spans.append((f"meshes[{i}].position", low, high))
    x_min, y_min, x_max, y_max = world.bounds
    for key, low, high in spans:
        if high[0] <= x_min or high[1] <= y_min or low[0] >= x_max or low[1] >= y_max:
            raise source.error(
                key,
                f"puts it outside the bounds (x {low[0]:.2f}..{high[0]:.2f}, y {low[1]:.2f}..{high[1]:.2f})",
                f"Move it into {list(world.bounds)}, or widen 'bounds'.",
            )


def _check_room(source: Source, world: World) -> None:
    """Refuse worlds in which not even a thin pole could start."""
    space = free_space(world, body_height=0.3)
    free = space.distance > world.spawn.clearance
    if not free.any():
        raise source.error(
            "spawn.clearance",
            f"of {world.spawn.clearance:g} m leaves no free space",
            "Remove or shrink obstacles, widen 'bounds', or lower it.",
        )
