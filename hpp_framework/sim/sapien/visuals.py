"""What a camera sees of worlds and robots: floor, obstacles, bodies, and their shadows on the floor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull

from hpp_framework.core.robot import Part, RobotSpec
from hpp_framework.core.world import Box, Cylinder, MovingObstacle, Person, World
from hpp_framework.sim.sapien.scene import UPRIGHT, pose_of, sapien
from hpp_framework.worlds.slicing import load_mesh, standing_faces

Color = tuple[float, float, float]

FLOOR: Color = (0.62, 0.64, 0.66)
ROOM_WALL: Color = (0.66, 0.68, 0.72)
OBSTACLES: tuple[Color, ...] = (
    (0.62, 0.36, 0.22),
    (0.30, 0.45, 0.47),
    (0.68, 0.52, 0.28),
    (0.42, 0.33, 0.45),
    (0.36, 0.46, 0.30),
)
"""Linear colours that obstacles take in turn; away from the orange and blue that tell the robots apart."""

MESH: Color = (0.55, 0.50, 0.42)
DOOR: Color = (0.50, 0.30, 0.16)

COATS: tuple[Color, ...] = (
    (0.62, 0.16, 0.22),
    (0.16, 0.42, 0.30),
    (0.48, 0.30, 0.56),
    (0.70, 0.58, 0.22),
    (0.18, 0.34, 0.44),
    (0.66, 0.40, 0.48),
)
"""Of people, in turn."""
SKINS: tuple[Color, ...] = ((0.78, 0.56, 0.42), (0.52, 0.33, 0.22), (0.86, 0.66, 0.52), (0.34, 0.21, 0.14))
TROUSERS: Color = (0.10, 0.12, 0.17)
HAIR: Color = (0.10, 0.07, 0.05)

Direction = tuple[float, float, float]

DETAIL = 0.04
"""Parts of a body narrower than this, in metres, throw no shadow."""

SHADE = 0.55
"""Share of its light that the floor keeps in shadow."""

SHADOW_HEIGHT = 0.002
"""Shadows lie this high above the floor, in metres; the shader draws the floor's lines up to 5 mm."""


def add_world(scene: Any, world: World, sun: Direction) -> None:
    """Add the visuals of a world to a scene that has a render system.

    Args:
        scene: the scene.
        world: what to show.
        sun: direction in which light falls; its third component is negative.
    """
    x_min, y_min, x_max, y_max = world.bounds
    floor = Box(
        center=((x_min + x_max) / 2, (y_min + y_max) / 2),
        size=(x_max - x_min, y_max - y_min),
        height=0.1,
        base=-0.1,
    )
    _add(scene, [_box(floor, FLOOR)])
    for index, box in enumerate(world.solid_boxes()):
        own = index < len(world.boxes)
        _add(scene, [_box(box, OBSTACLES[index % len(OBSTACLES)] if own else ROOM_WALL)])
        if own:
            _add(scene, _shadow(box.corners(), box.base, box.base + box.height, sun))
    for index, cylinder in enumerate(world.cylinders):
        _add(scene, [_cylinder(cylinder, OBSTACLES[(index + 2) % len(OBSTACLES)])])
        outline = np.array(cylinder.center) + _ring(cylinder.radius)
        _add(scene, _shadow(outline, cylinder.base, cylinder.base + cylinder.height, sun))
    for mesh in world.meshes:
        placed = load_mesh(mesh)
        # the floor of a scan would show in patches, as it is now above and now below the room's
        standing = np.asarray(placed.vertices)[standing_faces(placed)]
        if len(standing):
            _add(scene, [_triangles(standing, MESH)])


class RobotVisual:
    """A robot's body and the shadows of its parts, in a scene that has a render system.

    Args:
        scene: the scene.
        robot: whose body.
        sun: direction in which light falls.
    """

    def __init__(self, scene: Any, robot: RobotSpec, sun: Direction) -> None:
        parts = robot.build_body() or _plain_body(robot)
        self._body = _add(scene, [_part(part) for part in parts])
        self._casting = [part for part in parts if _extent(part)[0] > DETAIL]
        self._shadows = [_add(scene, _part_shadow(part, sun)) for part in self._casting]

    def place(self, x: float, y: float, theta: float) -> None:
        """Move the body to a pose; the sun stays where it is."""
        self._body.set_pose(pose_of(x, y, theta))
        for part, shadow in zip(self._casting, self._shadows, strict=True):
            ahead, left, _ = part.position
            cos, sin = math.cos(theta), math.sin(theta)
            shadow.set_pose(pose_of(x + cos * ahead - sin * left, y + sin * ahead + cos * left, 0.0))


class PersonVisual:
    """A person: legs, a coat, a head, and their shadow, in a scene that has a render system.

    Args:
        scene: the scene.
        person: whose body.
        number: of the person, which chooses the colours.
        sun: direction in which light falls.
    """

    def __init__(self, scene: Any, person: Person, number: int, sun: Direction) -> None:
        self._body = _add(scene, [_part(part) for part in _figure(person, number)])
        outline = _ring(person.radius * 0.8)
        self._shadow = _add(scene, _shadow(outline, 0.0, person.height, sun))

    def place(self, x: float, y: float, theta: float) -> None:
        """Move the person."""
        self._body.set_pose(pose_of(x, y, theta))
        self._shadow.set_pose(pose_of(x, y, 0.0))


def _figure(person: Person, number: int) -> list[Part]:
    """Return the parts of a person: two legs, a body, a head with a cap that shows where it looks."""
    height, radius = person.height, person.radius
    coat, hips, head = COATS[number % len(COATS)], 0.47 * height, 0.075 * height
    shoulders = height - 2 * head
    legs = [
        Part(
            shape="cylinder", size=(0.36 * radius, hips, 0.0), position=(0.0, side * 0.42 * radius, hips / 2),
            color=TROUSERS,
        )
        for side in (-1, 1)
    ]  # fmt: skip
    return [
        *legs,
        Part(
            shape="cylinder", size=(0.82 * radius, shoulders - hips, 0.0),
            position=(0.0, 0.0, (shoulders + hips) / 2), color=coat,
        ),
        Part(
            shape="sphere", size=(head, 0.0, 0.0), position=(0.0, 0.0, height - head),
            color=SKINS[number % len(SKINS)],
        ),
        Part(
            shape="sphere", size=(0.95 * head, 0.0, 0.0), position=(-0.2 * head, 0.0, height - 0.85 * head),
            color=HAIR,
        ),
    ]  # fmt: skip


class MovingVisual:
    """A moving obstacle in a scene that has a render system.

    Args:
        scene: the scene.
        obstacle: what moves.
    """

    def __init__(self, scene: Any, obstacle: MovingObstacle) -> None:
        self._obstacle = obstacle
        middle = obstacle.base + obstacle.height / 2
        length, width = obstacle.size or (0.0, 0.0)
        box = obstacle.size is not None
        part = Part(
            shape="box" if box else "cylinder",
            size=(length, width, obstacle.height) if box else (obstacle.radius or 0.0, obstacle.height, 0.0),
            position=(0.0, 0.0, middle), rotation=(0.0, 0.0, obstacle.yaw), color=DOOR,
        )  # fmt: skip
        self._body = _add(scene, [_part(part)])
        self.place(0.0)

    def place(self, time: float) -> None:
        """Move it to where it is at a time in seconds."""
        self._body.set_pose(pose_of(*self._obstacle.at(time), 0.0))


def _plain_body(robot: RobotSpec) -> tuple[Part, ...]:
    """Stand in for a robot that brings no body."""
    return (
        Part(
            shape="cylinder",
            size=(robot.footprint_radius, robot.height, 0.0),
            position=(0.0, 0.0, robot.height / 2),
        ),
    )


def _add(scene: Any, shapes: Sequence[Any]) -> Any:
    entity = sapien.Entity()
    if shapes:
        component = sapien.render.RenderBodyComponent()
        for shape in shapes:
            component.attach(shape)
        entity.add_component(component)
    scene.add_entity(entity)
    return entity


def _material(color: Color) -> Any:
    material = sapien.render.RenderMaterial()
    material.set_base_color([*color, 1.0])
    return material


def _box(box: Box, color: Color) -> Any:
    shape = sapien.render.RenderShapeBox([box.size[0] / 2, box.size[1] / 2, box.height / 2], _material(color))
    shape.set_local_pose(pose_of(*box.center, box.yaw, box.base + box.height / 2))
    return shape


def _cylinder(cylinder: Cylinder, color: Color) -> Any:
    shape = sapien.render.RenderShapeCylinder(cylinder.radius, cylinder.height / 2, _material(color))
    shape.set_local_pose(sapien.Pose([*cylinder.center, cylinder.base + cylinder.height / 2], UPRIGHT))
    return shape


def _part(part: Part) -> Any:
    material = _material(part.color)
    pose = sapien.Pose(part.position, _rotation(part.rotation))
    if part.shape == "box":
        shape = sapien.render.RenderShapeBox([side / 2 for side in part.size], material)
    elif part.shape == "cylinder":
        shape = sapien.render.RenderShapeCylinder(part.size[0], part.size[1] / 2, material)
        pose = pose * sapien.Pose(q=UPRIGHT)
    else:
        shape = sapien.render.RenderShapeSphere(part.size[0], material)
    shape.set_local_pose(pose)
    return shape


def _rotation(angles: tuple[float, float, float]) -> list[float]:
    """Return the quaternion (w, x, y, z) of turns about x, then y, then z of the parent frame."""
    (cr, cp, cy), (sr, sp, sy) = ([turn(angle / 2) for angle in angles] for turn in (math.cos, math.sin))
    return [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]


def _triangles(corners: npt.NDArray[np.floating], color: Color) -> Any:
    """Build a shape from triangles (t, 3, 3), flat shaded and visible from both sides."""
    both = np.concatenate([corners, corners[:, ::-1]])
    normals = np.cross(both[:, 1] - both[:, 0], both[:, 2] - both[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)
    vertices = both.reshape(-1, 3).astype(np.float32)
    return sapien.render.RenderShapeTriangleMesh(
        vertices,
        np.arange(len(vertices), dtype=np.uint32).reshape(-1, 3),
        np.repeat(normals, 3, axis=0).astype(np.float32),
        np.zeros((len(vertices), 2), np.float32),
        _material(color),
    )


def _ring(radius: float) -> npt.NDArray[np.float64]:
    angles = np.linspace(0, 2 * math.pi, 24, endpoint=False)
    return radius * np.stack([np.cos(angles), np.sin(angles)], -1)


def _shadow(outline: npt.NDArray[np.floating], low: float, high: float, sun: Direction) -> list[Any]:
    """Return the shadow on the floor of an upright convex prism with this outline (k, 2)."""
    slide = np.array(sun[:2]) / -sun[2]
    both = np.concatenate([outline + slide * max(low, 0.0), outline + slide * high])
    rim = both[ConvexHull(both).vertices]
    flat = np.column_stack([rim, np.full(len(rim), SHADOW_HEIGHT)])
    fan = np.stack([np.stack([flat[0], a, b]) for a, b in pairwise(flat[1:])])
    red, green, blue = FLOOR
    return [_triangles(fan, (red * SHADE, green * SHADE, blue * SHADE))]


def _extent(part: Part) -> tuple[float, float]:
    """Return the radius and half the height of an upright cylinder about a part."""
    if part.shape == "sphere":
        return part.size[0], part.size[0]
    if part.shape == "box":
        return (part.size[0] + part.size[1]) / 4, part.size[2] / 2
    radius, half = part.size[0], part.size[1] / 2
    tilt = abs(math.cos(part.rotation[0]) * math.cos(part.rotation[1]))
    return max(radius, half * math.sqrt(1 - tilt**2) / 2), max(radius * 0.7, half * tilt)


def _part_shadow(part: Part, sun: Direction) -> list[Any]:
    """Return the shadow of the upright cylinder about a part, relative to the part's centre."""
    radius, half = _extent(part)
    return _shadow(_ring(radius), part.position[2] - half, part.position[2] + half, sun)
