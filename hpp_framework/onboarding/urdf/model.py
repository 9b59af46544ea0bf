"""What a URDF file says: links with collision shapes and masses, joints, and where all of it is at rest.

Elements and their defaults are those of https://wiki.ros.org/urdf/XML. Only what a planar robot needs is
read, all joints at zero.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import trimesh
from trimesh.transformations import euler_matrix

from hpp_framework.utils.errors import ConfigError, reason

Matrix = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Shape:
    """One collision shape.

    Attributes:
        kind: ``"box"``, ``"cylinder"``, ``"sphere"`` or ``"mesh"``.
        size: full extents of a box, radius and length of a cylinder (along z), radius of a sphere, extents of
            the box around a mesh; metres.
        place: its pose in the root's frame, 4 x 4; of a mesh that of the middle of the box around it.
        points: (p, 3) that it is the hull of, in the root's frame; of a sphere its centre.
        rounding: metres that it reaches beyond these points: a sphere's radius.
    """

    kind: str
    size: tuple[float, ...]
    place: Matrix
    points: Matrix
    rounding: float = 0.0


@dataclass(frozen=True)
class Joint:
    """One joint.

    Attributes:
        name: its own.
        kind: ``"fixed"``, ``"continuous"``, ``"revolute"``, ...
        parent: name of a link.
        child: name of a link.
        origin: pose of the child in the parent's frame, 4 x 4.
        axis: of motion, in the child's frame.
        velocity: limit in rad/s or m/s; None where the file gives none.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: Matrix
    axis: Matrix
    velocity: float | None


@dataclass(frozen=True)
class Model:
    """A robot at rest, in the frame of its root link.

    Attributes:
        file: where it came from.
        root: name of the root link.
        places: pose of every link, 4 x 4.
        shapes: collision shapes by link.
        masses: kilograms by link; links without inertia are missing.
        joints: all of them.
        sensors: elements ``<sensor>`` of the extensions for Gazebo, by link.
    """

    file: Path
    root: str
    places: dict[str, Matrix]
    shapes: dict[str, tuple[Shape, ...]]
    masses: dict[str, float]
    joints: tuple[Joint, ...]
    sensors: dict[str, ET.Element]


def read_urdf(file: Path) -> Model:
    """Read a URDF file.

    Raises:
        ConfigError: if it is missing, no URDF, or names links, shapes or mesh files that are not there.
    """
    try:
        robot = ET.parse(file).getroot()
    except OSError as error:
        raise ConfigError(f"cannot read '{file}': {reason(error)}.") from error
    except ET.ParseError as error:
        raise ConfigError(
            f"'{file}' is no XML: {error}. Write xacro files out first: xacro FILE > FILE.urdf"
        ) from error
    if robot.tag != "robot":
        raise ConfigError(f"'{file}' is no URDF: its root is <{robot.tag}> and not <robot>.")
    links = {_attribute(link, "name", file): link for link in robot.findall("link")}
    joints = tuple(_joint(joint, file) for joint in robot.findall("joint"))
    for joint in joints:
        for name in (joint.parent, joint.child):
            if name not in links:
                raise ConfigError(f"'{file}': joint '{joint.name}' names link '{name}', which is not there.")
    root = _root(links, joints, file)
    places = _places(root, joints)
    lost = sorted(links.keys() - places.keys())
    if lost:
        raise ConfigError(f"'{file}': no joints lead from '{root}' to link '{lost[0]}'.")
    return Model(
        file, root, places,
        {name: tuple(_shapes(link, places[name], file)) for name, link in links.items()},
        {name: mass for name, link in links.items() if (mass := _mass(link, file)) is not None},
        joints,
        _sensors(robot),
    )  # fmt: skip


def _root(links: dict[str, ET.Element], joints: tuple[Joint, ...], file: Path) -> str:
    children = {joint.child for joint in joints}
    roots = [name for name in links if name not in children]
    if len(roots) != 1:
        raise ConfigError(f"'{file}': one link must be the root of all, found {', '.join(roots) or 'none'}.")
    return roots[0]


def _places(root: str, joints: tuple[Joint, ...]) -> dict[str, Matrix]:
    places = {root: np.eye(4)}
    left = list(joints)
    while ready := [joint for joint in left if joint.parent in places]:
        for joint in ready:
            places[joint.child] = places[joint.parent] @ joint.origin
            left.remove(joint)
    return places


def _joint(element: ET.Element, file: Path) -> Joint:
    name = _attribute(element, "name", file)
    ends: list[str] = []
    for end in ("parent", "child"):
        found = element.find(end)
        if found is None:
            raise ConfigError(f"'{file}': joint '{name}' has no <{end}>.")
        ends.append(_attribute(found, "link", file))
    axis, limit = element.find("axis"), element.find("limit")
    velocity = None if limit is None else limit.get("velocity")
    return Joint(
        name, element.get("type", "fixed"), ends[0], ends[1], _origin(element, file),
        _numbers("1 0 0" if axis is None else axis.get("xyz", "1 0 0"), 3, file),
        None if velocity is None else float(_numbers(velocity, 1, file)[0]),
    )  # fmt: skip


def _shapes(link: ET.Element, place: Matrix, file: Path) -> list[Shape]:
    found: list[Shape] = []
    for collision in link.findall("collision"):
        geometry = collision.find("geometry")
        shape = None if geometry is None or len(geometry) == 0 else geometry[0]
        if shape is None:
            raise ConfigError(f"'{file}': a <collision> of link '{link.get('name')}' has no shape.")
        found.append(_shape(shape, place @ _origin(collision, file), file))
    return found


def _shape(element: ET.Element, place: Matrix, file: Path) -> Shape:
    kind = element.tag
    if kind == "sphere":
        radius = float(_numbers(_attribute(element, "radius", file), 1, file)[0])
        return Shape(kind, (radius,), place, place[None, :3, 3], radius)
    if kind == "box":
        size = _numbers(_attribute(element, "size", file), 3, file)
        return Shape(kind, tuple(size.tolist()), place, _moved(trimesh.creation.box(size).vertices, place))
    if kind == "cylinder":
        size = _numbers(
            f"{_attribute(element, 'radius', file)} {_attribute(element, 'length', file)}", 2, file
        )
        prism = trimesh.creation.cylinder(radius=size[0], height=size[1], sections=360)
        return Shape(kind, tuple(size.tolist()), place, _moved(prism.vertices, place))
    if kind == "mesh":
        return _mesh(element, place, file)
    raise ConfigError(f"'{file}' has a <{kind}>; known shapes: box, cylinder, sphere, mesh.")


def _mesh(element: ET.Element, place: Matrix, file: Path) -> Shape:
    target = _mesh_file(_attribute(element, "filename", file), file)
    try:
        mesh = trimesh.load_mesh(target)
        corners = np.asarray(mesh.vertices, np.float64) * _numbers(element.get("scale", "1 1 1"), 3, file)
    except Exception as error:
        raise ConfigError(f"'{file}': the mesh '{target}' cannot be read: {error}.") from error
    low, high = corners.min(0), corners.max(0)
    middle = np.eye(4)
    middle[:3, 3] = (low + high) / 2
    return Shape("mesh", tuple((high - low).tolist()), place @ middle, _moved(corners, place))


def _mesh_file(name: str, file: Path) -> Path:
    """Find a mesh; ``package://NAME/PATH`` is looked for in the folders above the URDF file."""
    path = name.removeprefix("file://")
    if not name.startswith("package://"):
        candidates = [file.parent / path]
    else:
        inside = name.removeprefix("package://")
        folders = file.absolute().parents
        candidates = [folder / part for folder in folders for part in (inside, inside.partition("/")[2])]
    found = next((each for each in candidates if each.is_file()), None)
    if found is None:
        raise ConfigError(
            f"'{file}' names the mesh '{name}', which is not there. Put it beside the file, or into a folder "
            "of its package's name above it."
        )
    return found


def _mass(link: ET.Element, file: Path) -> float | None:
    mass = link.find("inertial/mass")
    return None if mass is None else float(_numbers(_attribute(mass, "value", file), 1, file)[0])


def _sensors(robot: ET.Element) -> dict[str, ET.Element]:
    return {
        name: sensor
        for extension in robot.findall("gazebo")
        if (name := extension.get("reference")) and (sensor := extension.find("sensor")) is not None
    }


def _origin(element: ET.Element, file: Path) -> Matrix:
    """Return the pose that an ``<origin>`` gives: roll, pitch and yaw about fixed axes, then the shift."""
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    out = euler_matrix(*_numbers(origin.get("rpy", "0 0 0"), 3, file), axes="sxyz")
    out[:3, 3] = _numbers(origin.get("xyz", "0 0 0"), 3, file)
    return out


def _moved(points: npt.ArrayLike, place: Matrix) -> Matrix:
    return np.asarray(points, np.float64) @ place[:3, :3].T + place[:3, 3]


def _attribute(element: ET.Element, name: str, file: Path) -> str:
    found = element.get(name)
    if found is None:
        raise ConfigError(f"'{file}': a <{element.tag}> has no '{name}'.")
    return found


def _numbers(text: str, count: int, file: Path) -> Matrix:
    try:
        found = np.array(text.split(), np.float64)
    except ValueError:
        found = np.empty(0)
    if len(found) != count or not np.isfinite(found).all():
        raise ConfigError(f"'{file}': '{text}' must be {count} {'number' if count == 1 else 'numbers'}.")
    return found
