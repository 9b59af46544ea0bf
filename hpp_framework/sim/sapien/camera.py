"""A camera on a world and its team: 3-D pictures of poses from either simulator.

It owns a scene of visuals only, so that pictures never touch the physics::

    camera = SceneCamera(world, robots, team_view(world, state.poses[0]))
    image = camera.picture(state.poses[0])
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from torch import Tensor

from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.world import World
from hpp_framework.sim.sapien.render import rendering_problem
from hpp_framework.sim.sapien.scene import sapien
from hpp_framework.sim.sapien.visuals import MovingVisual, PersonVisual, RobotVisual, add_world
from hpp_framework.utils.errors import ConfigError, SimulatorError

SHADERS = Path(__file__).parent / "shaders" / "lambert"
SIZE = (960, 720)
FIELD_OF_VIEW = 0.65
"""Vertical, in radians."""

ELEVATION = math.radians(42.0)
"""Angle at which the camera looks down: over a 1 m wall onto robots close behind it."""

SIDESTEP = math.radians(14.0)
"""How far the camera is turned off the perpendicular of the team's line, so that boxes show two sides."""

WIDTH = 8.0
"""Least width in metres that the team's view shows at its centre."""

MARGIN = 1.4
"""Metres kept free at the sides of the outermost robots."""

BOX = (0.5, 1.2)
"""Half width and height in metres of what must be in the picture of each robot."""

FARTHER = 1.04
"""Factor by which the camera is moved back until everything is in the picture."""

OVERSAMPLING = 2
"""Pixels drawn per picture pixel, along each axis; smooths edges."""

AWAY = (1e4, 1e4)
"""Where people are of whom nothing is known, out of sight."""

SUN_ASIDE = math.radians(55.0)
"""Angle between the camera's and the sunlight's direction, seen from above."""

SUN_SLANT = 0.55
"""Length of the shadow of a thing 1 m high, in metres."""

_AMBIENT = (0.46, 0.48, 0.52)
_SUNLIGHT = (0.54, 0.52, 0.48)
_SKY = np.array([[226, 231, 238], [196, 204, 214]], np.float32)
"""Background at the top and at the bottom of a picture."""


@dataclass(frozen=True, kw_only=True)
class View:
    """Where a camera stands and what it looks at.

    Attributes:
        eye: (x, y, z) in metres.
        target: (x, y, z) in metres; not straight below or above the eye.
        field_of_view: vertical, in radians.
    """

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    field_of_view: float = FIELD_OF_VIEW


def team_view(
    world: World,
    poses: Tensor | npt.NDArray[np.floating],
    *,
    paths: Tensor | npt.NDArray[np.floating] | None = None,
    size: tuple[int, int] = SIZE,
) -> View:
    """Choose a view from above and aside that shows a team and what lies between its robots.

    The team's longest line runs across the picture. Of the two sides the camera takes the one nearer to the
    middle of the room.

    Args:
        world: for its bounds.
        poses: (n, 3) or (n, 2) poses that the view is turned by, for example the start.
        paths: (..., 3) or (..., 2) finite poses to be seen as well, for example of an episode.
        size: (width, height) of the picture in pixels.
    """
    points = np.asarray(poses, np.float64)[:, :2]
    gaps = points[:, None] - points[None]
    first, second = np.unravel_index(np.linalg.norm(gaps, axis=-1).argmax(), gaps.shape[:2])
    spread = gaps[first, second]
    length = float(np.linalg.norm(spread))
    along = math.atan2(spread[1], spread[0]) if length > 0.1 else 0.0
    if paths is not None:
        points = np.concatenate(
            [points, np.asarray(paths, np.float64).reshape(-1, np.shape(paths)[-1])[:, :2]]
        )
    turn = np.array([[math.cos(along), -math.sin(along)], [math.sin(along), math.cos(along)]])
    turned = points @ turn
    center = turn @ (turned.min(0) + turned.max(0)) / 2
    half_angle = math.atan(math.tan(FIELD_OF_VIEW / 2) * size[0] / size[1])
    distance = max(WIDTH, length + 2 * MARGIN) / 2 / math.tan(half_angle)
    middle = np.array([world.bounds[0] + world.bounds[2], world.bounds[1] + world.bounds[3]]) / 2
    sides = [
        np.array([math.cos(angle), math.sin(angle)])
        for angle in (along - math.pi / 2 + SIDESTEP, along + math.pi / 2 + SIDESTEP)
    ]
    away = math.cos(ELEVATION) * min(
        sides, key=lambda side: float(np.linalg.norm(center + distance * math.cos(ELEVATION) * side - middle))
    )
    half, height = BOX
    corners = np.array([(x, y, z) for x in (-half, half) for y in (-half, half) for z in (0, height)])
    boxes = (np.column_stack([points, np.zeros(len(points))])[:, None] + corners).reshape(-1, 3)
    while True:
        eye = (*(center + distance * away).tolist(), distance * math.sin(ELEVATION))
        view = View(eye=eye, target=(*center.tolist(), 0.2))
        places, depth = _project(view, boxes, size)
        # from pixel centres to the picture's edges; what is not finite is out of sight from everywhere
        inside = (places >= -0.5) & (places <= np.array(size) - 0.5)
        if ((depth > 0)[:, None] & inside).all() or not np.isfinite(boxes).all():
            return view
        distance *= FARTHER


class SceneCamera:
    """Draws a world and a team at given poses.

    Args:
        world: what stands around.
        robots: the team.
        view: where the camera stands.
        size: (width, height) of pictures in pixels.

    Raises:
        SimulatorError: if SAPIEN cannot draw on this machine; says what to do.
        ConfigError: if the size is not positive, or a mesh file cannot be used.
    """

    def __init__(
        self, world: World, robots: Sequence[RobotSpec], view: View, *, size: tuple[int, int] = SIZE
    ) -> None:
        if min(size) < 1:
            raise ConfigError(f"a picture needs a width and a height of at least 1 pixel, got {size}.")
        problem = rendering_problem()
        if problem is not None:
            raise SimulatorError(problem)
        self.size = size
        _keep_engine()
        # what a render system draws is its own: one for each scene
        self._scene: Any = sapien.Scene([sapien.render.RenderSystem()])
        self._scene.set_ambient_light(_AMBIENT)
        sun = _sun(view)
        self._scene.add_directional_light(sun, _SUNLIGHT)
        add_world(self._scene, world, sun)
        self._world = world
        self._robots = [RobotVisual(self._scene, robot, sun) for robot in robots]
        self._people = [PersonVisual(self._scene, each, i, sun) for i, each in enumerate(world.people)]
        self._moving = [MovingVisual(self._scene, each) for each in world.moving]
        down = np.linspace(0, 1, size[1], dtype=np.float32)[:, None, None]
        self._sky = _SKY[0] * (1 - down) + _SKY[1] * down
        width, height = (side * OVERSAMPLING for side in size)
        self._camera = sapien.render.RenderCameraComponent(width, height, str(SHADERS))
        self._camera.set_fovy(view.field_of_view, compute_x=True)
        self._camera.set_near(0.05)
        self._camera.set_far(200.0)
        entity = sapien.Entity()
        entity.add_component(self._camera)
        entity.set_pose(_looking(view))
        self._scene.add_entity(entity)

    def picture(
        self,
        poses: Tensor | npt.NDArray[np.floating],
        *,
        people: Tensor | npt.NDArray[np.floating] | None = None,
        time: float = 0.0,
    ) -> npt.NDArray[np.uint8]:
        """Return a picture (height, width, 3), red green blue.

        Args:
            poses: (n, 3) of the team.
            people: (p, 3) poses of the world's people, NaN rows for none; None for their starts.
            time: in seconds, which says where moving obstacles are.
        """
        for obstacle in self._moving:
            obstacle.place(time)
        places = [[*(each.start or AWAY), 0.0] for each in self._world.people]
        places = places if people is None else np.asarray(people).tolist()
        for person, (x, y, theta) in zip(self._people, places, strict=False):
            person.place(*((x, y, theta) if math.isfinite(x) else (*AWAY, 0.0)))
        for robot, (x, y, theta) in zip(self._robots, np.asarray(poses).tolist(), strict=True):
            robot.place(x, y, theta)
        self._scene.update_render()
        self._camera.take_picture()
        drawn = np.asarray(self._camera.get_picture("Color"))
        small = cv2.resize(drawn, self.size, interpolation=cv2.INTER_AREA).clip(0, 1)
        color, covered = small[..., :3], small[..., 3:]
        image = (255 * color - self._sky) * covered + self._sky
        return np.rint(image, out=image).astype(np.uint8)


def draw_on_floor(
    image: npt.NDArray[np.uint8],
    view: View,
    path: npt.NDArray[np.floating],
    color: tuple[int, int, int],
    width: int,
) -> None:
    """Draw a line on the floor into a picture, in front of whatever stands there.

    Args:
        image: (height, width, 3) of a camera with this view; changed in place.
        view: where the camera stands.
        path: (t, 2) places in metres; nothing is drawn if one is not finite or not ahead of the camera.
        color: red, green, blue.
        width: of the line in pixels.
    """
    places, depth = _project(view, np.column_stack([path, np.zeros(len(path))]), image.shape[1::-1])
    if not (depth > 0.1).all():
        return
    points = np.round(np.clip(places, -1e5, 1e5) * 16).astype(np.int32)
    cv2.polylines(image, [points], False, color, width, cv2.LINE_AA, 4)


def _project(
    view: View, points: npt.NDArray[np.floating], size: Sequence[int]
) -> tuple[npt.NDArray[np.floating], npt.NDArray[np.floating]]:
    """Return where points (k, 3) are in a picture, in pixels (k, 2), and how far ahead, in metres (k,)."""
    ahead = np.subtract(view.target, view.eye)
    ahead = ahead / np.linalg.norm(ahead)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    offsets = points - np.array(view.eye)
    depth = offsets @ ahead
    focal = size[1] / 2 / math.tan(view.field_of_view / 2)
    across = np.column_stack([offsets @ right, offsets @ np.cross(ahead, right)]) / depth[:, None]
    return across * focal + np.array(size) / 2 - 0.5, depth


@cache
def _keep_engine() -> Any:
    """Hold one render system while this process lives: dropping the last one costs the next seconds."""
    sapien.render.set_camera_shader_dir(str(SHADERS))
    return sapien.render.RenderSystem()


def _sun(view: View) -> tuple[float, float, float]:
    """Return the direction of light over the camera's left shoulder, which lights the sides that it sees."""
    ahead = math.atan2(view.target[1] - view.eye[1], view.target[0] - view.eye[0]) - SUN_ASIDE
    return math.cos(ahead) * SUN_SLANT, math.sin(ahead) * SUN_SLANT, -1.0


def _looking(view: View) -> Any:
    """Return the pose of a camera (x ahead, y left, z up)."""
    ahead = np.subtract(view.target, view.eye)
    ahead = ahead / np.linalg.norm(ahead)
    left = np.cross([0.0, 0.0, 1.0], ahead)
    left /= np.linalg.norm(left)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([ahead, left, np.cross(ahead, left)], axis=1)
    matrix[:3, 3] = view.eye
    return sapien.Pose(matrix)
