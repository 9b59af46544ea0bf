"""World files: a world in YAML, checked so that every mistake names file, key and remedy.

The format is described in ``docs/worlds.md``. Angles in files are in degrees, their keys end in ``_deg``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from hpp_framework.config.yaml_files import FileModel, checked, is_yaml, read_yaml
from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.world import Box, Cylinder, Mesh, SpawnRule, World
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

LARGEST_SIDE = 200.0
"""Longest side of the bounds in metres; the occupancy grid of anything larger does not fit in memory."""


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
Start = Annotated[tuple[Number, Number, Angle], numbers("x", "y", "heading_deg")]


class BoxEntry(FileModel):
    """A box, as :class:`Box` has it."""

    center: Point
    size: Annotated[tuple[Positive, Positive], numbers("along x", "along y")]
    yaw: Angle = Field(0.0, alias="yaw_deg")
    height: Positive = 1.0
    base: NonNegative = 0.0


class CylinderEntry(FileModel):
    """A cylinder, as :class:`Cylinder` has it."""

    center: Point
    radius: Positive
    height: Positive = 1.0
    base: NonNegative = 0.0


class MeshEntry(FileModel):
    """A mesh, as :class:`Mesh` has it."""

    file: Annotated[Text, AfterValidator(_beside)]
    position: Annotated[tuple[Number, Number, Number], numbers("x", "y", "z")] = (0.0, 0.0, 0.0)
    yaw: Angle = Field(0.0, alias="yaw_deg")
    scale: Positive = 1.0


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
    spawn: SpawnEntry | None = None


def resolve_world(name_or_path: str) -> WorldFactory:
    """Return the factory of a registered world or of a world file.

    Args:
        name_or_path: a registered name, or a path that ends in ``.yaml`` or ``.yml``.

    Raises:
        ConfigError: if the file has a mistake.
        UnknownNameError: if nothing is registered under the name.
    """
    if is_yaml(name_or_path):
        world = load_world(Path(name_or_path.strip()))
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
        spawn=SpawnRule(**found.spawn.said()) if found.spawn else SpawnRule(),
        file=file,
    )
    _check_places(world)
    _check_room(world)
    check_spawn(world, robots)
    return world


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
