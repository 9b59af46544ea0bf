"""PhysX scenes from ``World`` and ``RobotSpec``: static obstacles, robots as locked-axis bodies, contacts.

Nothing here needs a renderer, and nothing here may create a visual: SAPIEN aborts the process when a visual
lives in a scene without a render system.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh

from hpp_framework.core.robot import RobotSpec
from hpp_framework.core.world import Box, Cylinder, Mesh, MovingObstacle, Person, World
from hpp_framework.utils.errors import ConfigError, SimulatorError
from hpp_framework.worlds.slicing import load_mesh, standing_faces

with warnings.catch_warnings():
    # it warns when there is no system Vulkan loader; rendering_problem() says so in better words
    warnings.simplefilter("ignore")
    import sapien
    from sapien import physx

BAND = 0.005
"""Half the height of the slot around a lidar plane in which a robot has its profile disc, in metres."""

SIDES = 32
"""Sides of the prism that PhysX uses for a cylinder."""

ROUNDNESS = 2 / (1 + math.cos(math.pi / SIDES))
"""Widens a prism so that its corners stand out as much as its faces stand back (0.24 % of the radius)."""

FACET_ERROR = 0.001
"""Largest such error in metres before an obstacle's prism gets more sides."""

UPRIGHT = (math.sqrt(0.5), 0.0, -math.sqrt(0.5), 0.0)
"""Turns the x axis, along which SAPIEN lays cylinders, to z."""

DEPENETRATION_SPEED = 3.0
"""How fast PhysX separates bodies that overlap at the start, in m/s."""

RIGID = 1.0e7
"""Moment of inertia in kg m^2 of a body that contact does not turn."""

LOCKED_AXES = (False, False, True, True, True, False)
"""x, y and yaw are free (True locks)."""


class PhysicsScene:
    """One world with one team in PhysX; gravity is off and there is no floor to touch.

    Args:
        world: obstacles and bounds.
        robots: the team.
        timestep: of a physics tick, in seconds.
    """

    def __init__(self, world: World, robots: Sequence[RobotSpec], timestep: float) -> None:
        # the system comes before the scene: Scene() without arguments also asks for a renderer
        self.system = physx.PhysxCpuSystem()
        self.scene = sapien.Scene([self.system])
        self.scene.timestep = timestep
        self._material = physx.PhysxMaterial(0.0, 0.0, 0.0)
        for box in world.solid_boxes():
            self._add_static([_box_shape(box, self._material)], _box_pose(box))
        for cylinder in world.cylinders:
            self._add_static(_cylinder_shapes(cylinder, self._material), _cylinder_pose(cylinder))
        for mesh in world.meshes:
            self._add_static(_mesh_shapes(mesh, self._material), sapien.Pose())
        self.people = [self._add_kinematic(person_shape(each, self._material)) for each in world.people]
        self.moving = [self._add_kinematic(moving_shape(each, self._material)) for each in world.moving]
        planes = [robot.lidar.height for robot in robots]
        self.bodies: list[Any] = [self._add_robot(robot, planes) for robot in robots]
        self._index = {body.entity.per_scene_id: index for index, body in enumerate(self.bodies)}
        self._persons = {body.entity.per_scene_id for body in self.people}

    def touching(self) -> list[tuple[bool, bool, bool]]:
        """Return whether each robot touched an obstacle, another robot, a person, in the last tick."""
        obstacle, robot, person = ([False] * len(self.bodies) for _ in range(3))
        for contact in self.scene.get_contacts():
            # pairs are listed from 2 cm apart; all numbers are read now, contacts do not survive a tick
            if any(point.separation <= 0 or np.any(point.impulse) for point in contact.points):
                ids = [body.entity.per_scene_id for body in contact.bodies]
                pair = [self._index.get(each) for each in ids]
                touched = obstacle if None in pair else robot
                touched = person if not self._persons.isdisjoint(ids) else touched
                for index in pair:
                    if index is not None:
                        touched[index] = True
        return list(zip(obstacle, robot, person, strict=True))

    def distances(
        self,
        origins: npt.NDArray[np.float32],
        directions: npt.NDArray[np.float32],
        reach: float,
    ) -> npt.NDArray[np.float32]:
        """Cast rays and return the distances (k,) to the first hits; ``reach`` where nothing is hit.

        Args:
            origins: (k, 3) in metres.
            directions: (k, 3) unit vectors.
            reach: longest distance looked for, in metres.
        """
        out = np.full(len(origins), reach, np.float32)
        cast: Any = self.system.raycast
        for k, (origin, direction) in enumerate(zip(origins, directions, strict=True)):
            hit = cast(origin, direction, reach)
            if hit is not None:
                out[k] = hit.distance
        return out

    def _add_static(self, shapes: Iterable[Any], pose: Any) -> None:
        component = physx.PhysxRigidStaticComponent()
        for shape in shapes:
            component.attach(shape)
        self._add_entity(component, pose)

    def _add_kinematic(self, shape: Any) -> Any:
        body = physx.PhysxRigidDynamicComponent()
        body.attach(shape)
        body.set_kinematic(True)
        self._add_entity(body, sapien.Pose())
        return body

    def _add_robot(self, robot: RobotSpec, planes: Sequence[float]) -> Any:
        body = physx.PhysxRigidDynamicComponent()
        for low, high, radius in contact_discs(robot, planes):
            shape = physx.PhysxCollisionShapeCylinder(radius * ROUNDNESS, (high - low) / 2, self._material)
            shape.set_local_pose(sapien.Pose([0, 0, (low + high) / 2], UPRIGHT))
            body.attach(shape)
        body.set_disable_gravity(True)
        body.set_locked_motion_axes(list(LOCKED_AXES))
        body.set_linear_damping(0.0)
        body.set_angular_damping(0.0)
        body.set_sleep_threshold(0.0)
        body.set_max_depenetration_velocity(DEPENETRATION_SPEED)
        body.set_mass(robot.mass)
        body.set_cmass_local_pose(sapien.Pose())
        # PhysX applies locked axes after solving: with its own inertia a robot would answer a contact by
        # tilting instead of stopping, and the corners of its prism would turn it
        body.set_inertia([RIGID, RIGID, RIGID])
        self._add_entity(body, sapien.Pose())
        return body

    def _add_entity(self, component: Any, pose: Any) -> None:
        entity = sapien.Entity()
        entity.add_component(component)
        entity.set_pose(pose)
        self.scene.add_entity(entity)


def person_shape(person: Person, material: Any) -> Any:
    """Return the upright cylinder that stands for a person; its pose is that of the feet."""
    shape = physx.PhysxCollisionShapeCylinder(person.radius * ROUNDNESS, person.height / 2, material)
    shape.set_local_pose(sapien.Pose([0, 0, person.height / 2], UPRIGHT))
    return shape


def moving_shape(obstacle: MovingObstacle, material: Any) -> Any:
    """Return a moving obstacle about the point on the floor below its centre."""
    middle = obstacle.base + obstacle.height / 2
    if obstacle.size is not None:
        half = [obstacle.size[0] / 2, obstacle.size[1] / 2, obstacle.height / 2]
        shape = physx.PhysxCollisionShapeBox(half, material)
        shape.set_local_pose(pose_of(0.0, 0.0, obstacle.yaw, middle))
        return shape
    radius = (obstacle.radius or 0.0) * ROUNDNESS
    shape = physx.PhysxCollisionShapeCylinder(radius, obstacle.height / 2, material)
    shape.set_local_pose(sapien.Pose([0, 0, middle], UPRIGHT))
    return shape


def contact_discs(robot: RobotSpec, planes: Sequence[float]) -> list[tuple[float, float, float]]:
    """Return the upright cylinders (lowest, highest, radius) that stand for a robot, in metres.

    As in the batch simulator the robot touches with its footprint over its whole height, and lidars see its
    profile: around each lidar plane of the team the footprint gives way to the profile.
    """
    discs: list[tuple[float, float, float]] = []
    floor = 0.0
    for low, high in _slots(planes, robot.height):
        if low > floor:
            discs.append((floor, low, robot.footprint_radius))
        discs.append((low, high, robot.profile_radius))
        floor = high
    if floor < robot.height:
        discs.append((floor, robot.height, robot.footprint_radius))
    return discs


def _slots(planes: Sequence[float], height: float) -> list[tuple[float, float]]:
    slots: list[tuple[float, float]] = []
    for plane in sorted(plane for plane in planes if plane < height):
        low, high = max(plane - BAND, 0.0), min(plane + BAND, height)
        if slots and low <= slots[-1][1]:
            low = slots.pop()[0]
        slots.append((low, high))
    return slots


def _box_shape(box: Box, material: Any) -> Any:
    half = [box.size[0] / 2, box.size[1] / 2, box.height / 2]
    return physx.PhysxCollisionShapeBox(half, material)


def _box_pose(box: Box) -> Any:
    return pose_of(*box.center, box.yaw, box.base + box.height / 2)


def _cylinder_shapes(cylinder: Cylinder, material: Any) -> list[Any]:
    if cylinder.radius * (ROUNDNESS - 1) <= FACET_ERROR:
        return [physx.PhysxCollisionShapeCylinder(cylinder.radius * ROUNDNESS, cylinder.height / 2, material)]
    # a large one is a mesh with more sides; their faces stand back by half the square of pi / sides
    sides = math.ceil(math.pi * math.sqrt(cylinder.radius / FACET_ERROR) / 2)
    widened = cylinder.radius * 2 / (1 + math.cos(math.pi / sides))
    prism = trimesh.creation.cylinder(radius=widened, height=cylinder.height, sections=sides)
    prism.apply_transform(trimesh.transformations.rotation_matrix(math.pi / 2, [0, 1, 0]))
    return [_triangles(prism.vertices, prism.faces, material)]


def _cylinder_pose(cylinder: Cylinder) -> Any:
    return sapien.Pose([*cylinder.center, cylinder.base + cylinder.height / 2], UPRIGHT)


def _mesh_shapes(mesh: Mesh, material: Any) -> list[Any]:
    placed = load_mesh(mesh)
    # the floor of a scan is never quite level: as in the batch simulator, robots drive over what lies flat
    faces = standing_faces(placed)
    if len(faces) == 0:
        return []
    # rays and bodies pass through the back of a triangle, and scans have sheets and wrong windings
    try:
        return [
            _triangles(placed.vertices, faces, material),
            _triangles(placed.vertices, faces[:, ::-1], material),
        ]
    except RuntimeError as error:
        raise ConfigError(f"mesh file '{mesh.file}' cannot be used by PhysX: {error}.") from error


def _triangles(vertices: Any, faces: Any, material: Any) -> Any:
    flat = np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(faces, np.uint32)
    if not np.isfinite(flat[0]).all():
        raise SimulatorError("a mesh has vertices that are not finite.")
    return physx.PhysxCollisionShapeTriangleMesh(*flat, [1.0, 1.0, 1.0], material)


def pose_of(x: float, y: float, theta: float, z: float = 0.0) -> Any:
    """Return the ``sapien.Pose`` of a planar pose at height z."""
    return sapien.Pose([x, y, z], [math.cos(theta / 2), 0.0, 0.0, math.sin(theta / 2)])
