"""World files: a world in YAML, checked so that every mistake names file, key and remedy.

The format is described in ``docs/worlds.md``. Angles in files are in degrees, their keys end in ``_deg``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from hpp_framework.config.settings import call_with, parse_settings
from hpp_framework.config.yaml_files import FileModel, checked, is_yaml, read_yaml
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.world import Box, Cylinder, Mesh, MovingObstacle, Person, SpawnRule, World
from hpp_framework.plugins.registry import hub
from hpp_framework.utils.errors import ConfigError, UnknownNameError
from hpp_framework.utils.validation import (
    LISTED,
    Flag,
    NonNegative,
    Number,
    Positive,
    Text,
    filled,
    mistake,
    numbers,
)
from hpp_framework.worlds.occupancy import free_space
from hpp_framework.worlds.slicing import load_mesh
from hpp_framework.worlds.spawn import check_spawn

WorldFactory = Callable[[np.random.Generator], World]
Built = TypeVar("Built")

LARGEST_SIDE = 200.0
"""Longest side of the bounds in metres; the occupancy grid of anything larger does not fit in memory."""

MOST_PEOPLE = 1000


def _printable(name: str) -> str:
    if not name.isprintable() or any(mark in name for mark in ",/\\"):
        raise mistake(f"cannot be '{name}'", "Use letters, digits, spaces, '-' and '_'.")
    return name


def _ordered(area: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    x_min, y_min, x_max, y_max = area
    if x_min > x_max or y_min > y_max:
        raise mistake(f"has its corners swapped: {list(area)}", "Write [x_min, y_min, x_max, y_max].")
    return area


def _spanning(bounds: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    sides = (bounds[2] - bounds[0], bounds[3] - bounds[1])
    if min(sides) < 1 or max(sides) > LARGEST_SIDE:
        raise mistake(
            f"span {sides[0]:g} x {sides[1]:g} m",
            f"Write [x_min, y_min, x_max, y_max] in metres, each side from 1 to {LARGEST_SIDE:g} m.",
        )
    return bounds


def _beside(file: str, info: Any) -> Path:  # a ValidationInfo, which beartype cannot check
    return (info.context / file).resolve()


Angle = Annotated[Number, AfterValidator(math.radians)]
"""Degrees in the file, radians in the program."""
Point = Annotated[tuple[Number, Number], numbers("x", "y")]
Area = Annotated[tuple[Number, Number, Number, Number], numbers("x_min", "y_min", "x_max", "y_max")]
Key = Annotated[tuple[NonNegative, Number, Number], numbers("time in seconds", "x", "y")]
Start = Annotated[tuple[Number, Number, Angle], numbers("x", "y", "heading_deg")]


MOTION = ("velocity", "speed", "path", "waypoints", "motion", "times", "moving")
"""Keys by which files try to move an obstacle that stands."""


class Standing(FileModel):
    """Base of obstacles that stand."""

    @model_validator(mode="before")
    @classmethod
    def _no_motion(cls, value: Any) -> Any:
        for key in MOTION if isinstance(value, dict) else ():
            if key in value:
                raise mistake(
                    "is not a key of an obstacle that stands",
                    "List obstacles that move under 'moving' (size or radius, path: [[time, x, y], ...]), "
                    "and pedestrians under 'people'.",
                    key,
                )
        return value


class BoxEntry(Standing):
    """A box, as :class:`Box` has it."""

    center: Point
    size: Annotated[tuple[Positive, Positive], numbers("along x", "along y")]
    yaw: Angle = Field(0.0, alias="yaw_deg")
    height: Positive = 1.0
    base: NonNegative = 0.0


class CylinderEntry(Standing):
    """A cylinder, as :class:`Cylinder` has it."""

    center: Point
    radius: Positive
    height: Positive = 1.0
    base: NonNegative = 0.0


class MeshEntry(Standing):
    """A mesh, as :class:`Mesh` has it."""

    file: Annotated[Text, AfterValidator(_beside)]
    position: Annotated[tuple[Number, Number, Number], numbers("x", "y", "z")] = (0.0, 0.0, 0.0)
    yaw: Angle = Field(0.0, alias="yaw_deg")
    scale: Positive = 1.0


class PersonEntry(FileModel):
    """A pedestrian, as :class:`Person` has it."""

    start: Point | None = None
    waypoints: Annotated[tuple[Point, ...], LISTED] = ()
    goal: Point | None = None
    loop: Flag = True
    speed: NonNegative | None = None
    radius: Positive = 0.25
    height: Positive = 1.7


class MovingEntry(FileModel):
    """An obstacle on a timetable, as :class:`MovingObstacle` has it."""

    path: Annotated[tuple[Key, ...], LISTED, filled("List [time, x, y] of its centre.")]
    size: Annotated[tuple[Positive, Positive], numbers("along x", "along y")] | None = None
    radius: Positive | None = None
    yaw: Angle = Field(0.0, alias="yaw_deg")
    height: Positive = 2.0
    base: NonNegative = 0.0
    loop: Flag = False


def _counted(value: Any) -> Any:
    """Take a number of people for as many of whom nothing is said."""
    if isinstance(value, bool) or not isinstance(value, int):
        return value
    if not 0 <= value <= MOST_PEOPLE:
        raise mistake(f"must be from 0 to {MOST_PEOPLE}, got {value}", "Give a number of people, or a list.")
    return [{} for _ in range(value)]


class SpawnEntry(FileModel):
    """Where robots start, as :class:`SpawnRule` has it."""

    distance: Positive = 5.0
    center: Annotated[Area, AfterValidator(_ordered)] | None = None
    axis: Angle | None = Field(None, alias="axis_deg")
    axis_spread: Annotated[NonNegative, AfterValidator(math.radians)] = Field(0.0, alias="axis_spread_deg")
    clearance: NonNegative = 0.15
    poses: Annotated[
        tuple[Start, ...] | None,
        LISTED,
        filled("List a start [x, y, heading_deg] for each robot, or remove it."),
    ] = None

    @model_validator(mode="after")
    def _poses_alone(self) -> SpawnEntry:
        for name in sorted(self.model_fields_set - {"poses", "clearance"}) if self.poses else ():
            key = type(self).model_fields[name].alias or name
            raise mistake("has no use beside 'spawn.poses'", "Remove one of the two.", key)
        return self


class WorldFile(FileModel):
    """A world file."""

    name: Annotated[Text, AfterValidator(_printable)] = ""
    bounds: Annotated[Area, AfterValidator(_spanning)]
    walled: Flag = True
    boxes: Annotated[tuple[BoxEntry, ...], LISTED] = ()
    cylinders: Annotated[tuple[CylinderEntry, ...], LISTED] = ()
    meshes: Annotated[tuple[MeshEntry, ...], LISTED] = ()
    people: Annotated[tuple[PersonEntry, ...], LISTED, BeforeValidator(_counted)] = ()
    moving: Annotated[tuple[MovingEntry, ...], LISTED] = ()
    spawn: SpawnEntry | None = None


def resolve_world(name_or_path: str) -> WorldFactory:
    """Return the factory of a registered world or of a world file.

    Args:
        name_or_path: a registered name, with settings of its generator or without
            (``"crowd:people=10"``), or a path that ends in ``.yaml`` or ``.yml``.

    Raises:
        ConfigError: if the file or a setting has a mistake.
        UnknownNameError: if nothing is registered under the name.
    """
    if is_yaml(name_or_path):
        world = load_world(Path(name_or_path.strip()))
        return lambda rng: world
    name, *pairs = name_or_path.split(":")
    try:
        factory = hub().worlds.entry(name).factory()
    except UnknownNameError as error:
        raise UnknownNameError(f"{error} A world file must end in .yaml or .yml.") from error
    owner = f"world '{name_or_path}'"
    settings = parse_settings(pairs, owner)
    return (lambda rng: call_with(factory, {"rng": rng}, settings, owner)) if settings else factory


def load_world(file: Path, robots: Sequence[RobotSpec] = ()) -> World:
    """Read a world file.

    Args:
        file: the YAML file; mesh paths in it are relative to its folder.
        robots: a team; if given, it must also find room at the file's starts.

    Raises:
        ConfigError: if anything in the file is wrong; names the file, the key and the remedy.
    """
    file = Path(file)
    content = read_yaml(file, kind="world", least="bounds: [x_min, y_min, x_max, y_max]")
    if isinstance(content, dict):
        content = {"name": file.stem, **content}
    found = checked(WorldFile, content, file)
    world = World(
        name=found.name,
        bounds=found.bounds,
        walled=found.walled,
        boxes=tuple(Box(**each.said()) for each in found.boxes),
        cylinders=tuple(Cylinder(**each.said()) for each in found.cylinders),
        meshes=tuple(Mesh(**each.said()) for each in found.meshes),
        people=tuple(_built(Person, each, file, f"people[{i}]") for i, each in enumerate(found.people)),
        moving=tuple(
            _built(MovingObstacle, each, file, f"moving[{i}]") for i, each in enumerate(found.moving)
        ),
        spawn=SpawnRule(**found.spawn.said()) if found.spawn else SpawnRule(),
        file=file,
    )
    _check_places(world)
    _check_room(world)
    check_spawn(world, robots)
    return world


def _built(kind: Callable[..., Built], entry: FileModel, file: Path, key: str) -> Built:
    """Build what an entry describes; what its keys contradict is told with the entry's place in the file."""
    try:
        return kind(**entry.said())
    except ConfigError as error:
        raise ConfigError(f"{file}: '{key}': {error}") from error


def _mesh(world: World, key: str, mesh: Mesh) -> Any:
    try:
        return load_mesh(mesh)
    except ConfigError as error:
        raise ConfigError(f"{world.label}: '{key}.file': {error}") from error


def _check_places(world: World) -> None:
    """Refuse meshes that cannot be read, and obstacles that no robot can meet: wholly outside the bounds."""
    spans: list[tuple[str, np.ndarray, np.ndarray]] = []
    for i, box in enumerate(world.boxes):
        spans.append((f"boxes[{i}].center", box.corners().min(0), box.corners().max(0)))
    for i, cylinder in enumerate(world.cylinders):
        center = np.array(cylinder.center)
        spans.append((f"cylinders[{i}].center", center - cylinder.radius, center + cylinder.radius))
    for i, mesh in enumerate(world.meshes):
        low, high = np.asarray(_mesh(world, f"meshes[{i}]", mesh).bounds)[:, :2]
        spans.append((f"meshes[{i}].position", low, high))
    for i, person in enumerate(world.people):
        known = [("start", person.start), ("goal", person.goal)]
        known += [(f"waypoints[{k}]", point) for k, point in enumerate(person.waypoints)]
        for name, point in known:
            if point is not None:
                spans.append((f"people[{i}].{name}", np.array(point), np.array(point)))
    for i, obstacle in enumerate(world.moving):
        outlines = np.concatenate([obstacle.outline(time) for time, _, _ in obstacle.path])
        spans.append((f"moving[{i}].path", outlines.min(0), outlines.max(0)))
    x_min, y_min, x_max, y_max = world.bounds
    for key, low, high in spans:
        if high[0] <= x_min or high[1] <= y_min or low[0] >= x_max or low[1] >= y_max:
            raise ConfigError(
                f"{world.label}: '{key}' puts it outside the bounds "
                f"(x {low[0]:.2f}..{high[0]:.2f}, y {low[1]:.2f}..{high[1]:.2f}). "
                f"Move it into {list(world.bounds)}, or widen 'bounds'."
            )


def _check_room(world: World) -> None:
    """Refuse worlds in which not even a thin pole could start."""
    if not (free_space(world, body_height=0.3).distance > world.spawn.clearance).any():
        raise ConfigError(
            f"{world.label}: 'spawn.clearance' of {world.spawn.clearance:g} m leaves no free space. "
            "Remove or shrink obstacles, widen 'bounds', or lower it."
        )
