"""Driving and seeing among people and moving obstacles: the drive and lidar kernels with these besides.

Worlds in which nothing moves but robots use the plain kernels.
"""

import warp as wp

from hpp_framework.sim.batch.crowd_kernels import (
    DRIVING,
    GRAZE,
    Crowds,
    Mover,
    Walk,
    from_mover,
    move_people,
    place_of,
    planar,
    steer,
)
from hpp_framework.sim.batch.drive_kernels import (
    RELAXATIONS,
    begin_substep,
    end_substep,
    push_apart,
    push_out_of_obstacles,
)
from hpp_framework.sim.batch.kernels import PI, ROUGHLY, Geometry, Robot, rough_bearing
from hpp_framework.sim.batch.lidar_kernels import Eye, is_out_of_view, lesser, past_last_beam, turned

wp.set_module_options({"enable_backward": False})


@wp.struct
class Beams:
    """Directions of all beams in the frame of beam 0."""

    x: wp.array2d(dtype=float)
    y: wp.array2d(dtype=float)


@wp.func
def push_out_of_moving(
    episode: int,
    now: float,
    robots: wp.array(dtype=Robot),
    crowds: Crowds,
    walk: Walk,
    poses: wp.array3d(dtype=float),
    velocities: wp.array3d(dtype=float),
    touched: wp.array2d(dtype=wp.bool),
    touched_obstacle: wp.array2d(dtype=wp.bool),
    touched_person: wp.array2d(dtype=wp.bool),
    gap: wp.array2d(dtype=float),
) -> int:
    """Move robots out of people and moving obstacles, and return whether there were any."""
    moved = int(0)
    own = walk.world[episode]
    first = crowds.first_walker[own]
    count = crowds.first_walker[own + 1] - first
    if walk.near[episode] == 0 and crowds.first_mover[own] == crowds.first_mover[own + 1]:
        return 0
    for i in range(robots.shape[0]):
        radius = robots[i].radius
        at = wp.vec2(poses[episode, i, 0], poses[episode, i, 1])
        start = at
        for p in range(count):
            apart = at - planar(walk.poses[episode, p])
            reach = radius + crowds.walkers[first + p].radius
            distance_sq = wp.dot(apart, apart)
            if distance_sq < reach * reach and distance_sq > 1.0e-12:
                distance = wp.sqrt(distance_sq)
                at = at + apart * (reach / distance - 1.0)
                if reach - distance > GRAZE:
                    touched[episode, i] = True
                    if wp.abs(velocities[episode, i, 0]) > DRIVING:
                        touched_person[episode, i] = True
        for m in range(crowds.first_mover[own], crowds.first_mover[own + 1]):
            mover = crowds.movers[m]
            if mover.base < robots[i].height:
                wall = from_mover(at, mover, place_of(mover, crowds, now))
                if wall[2] < radius:
                    at = at + (radius - wall[2]) * planar(wall)
                    if radius - wall[2] > GRAZE:
                        touched[episode, i] = True
                        touched_obstacle[episode, i] = True
        pushed = wp.length(at - start)
        if pushed > 0.0:
            poses[episode, i, 0] = at[0]
            poses[episode, i, 1] = at[1]
            gap[episode, i] = gap[episode, i] - pushed
            if pushed > GRAZE:
                moved = 1
    return moved


@wp.kernel
def drive_among(
    start: int,
    commands: wp.array4d(dtype=float),
    robots: wp.array(dtype=Robot),
    geometry: Geometry,
    world_index: wp.array(dtype=int),
    period: float,
    substeps: int,
    poses: wp.array3d(dtype=float),
    velocities: wp.array3d(dtype=float),
    touched_obstacle: wp.array2d(dtype=wp.bool),
    touched_robot: wp.array2d(dtype=wp.bool),
    touched: wp.array2d(dtype=wp.bool),
    before: wp.array2d(dtype=wp.vec2),
    gap: wp.array2d(dtype=float),
    touched_person: wp.array2d(dtype=wp.bool),
    crowds: Crowds,
    walk: Walk,
):
    """Drive every robot of one episode for one control period, and let its people walk.

    In each substep people go first, and stop at robots; then robots go, and stop at people. So no robot or
    person is pushed by a person, and a robot only touches a person that it drives into.

    Args:
        start: as ``drive`` has it, and all that are not described here.
        commands: wanted speed and turn rate.
        robots: the team.
        geometry: the worlds.
        world_index: world of each episode.
        period: seconds.
        substeps: of a period.
        poses: of the robots.
        velocities: of the robots.
        touched_obstacle: whether a robot touched an obstacle in the period, moving ones included.
        touched_robot: whether it touched another robot in the period.
        touched: scratch.
        before: scratch.
        gap: metres that a robot may move before it can meet an obstacle that stands.
        touched_person: whether it drove into a person in the period.
        crowds: what moves in the worlds.
        walk: the people.
    """
    episode = start + wp.tid()
    world = world_index[episode]
    dt = period / float(substeps)
    for i in range(robots.shape[0]):
        touched_obstacle[episode, i] = False
        touched_robot[episode, i] = False
        touched_person[episode, i] = False
    steer(episode, world, period, dt, robots, poses, velocities, crowds, walk)
    for part in range(substeps):
        move_people(episode, world, dt, robots, poses, crowds, walk)
        now = float(walk.time[episode]) * dt
        begin_substep(episode, part, dt, commands, robots, poses, velocities, touched, before, gap)
        for _relaxation in range(RELAXATIONS):
            moved = push_apart(episode, robots, poses, touched, touched_robot, gap)
            if push_out_of_moving(
                episode, now, robots, crowds, walk, poses, velocities, touched, touched_obstacle,
                touched_person, gap,
            ):  # fmt: skip
                moved = 1
            if push_out_of_obstacles(episode, world, robots, geometry, poses, touched, touched_obstacle, gap):
                moved = 1
            if moved == 0:
                break
        end_substep(episode, dt, robots, poses, velocities, touched, before)


@wp.func
def meet_disc(
    low: float, high: float, center: wp.vec2, outside: float, eye: Eye, robot: Robot,
    beams: Beams, scans: wp.array2d(dtype=float),
):  # fmt: skip
    """Shorten the beams between two angles, given in beams, that meet a disc."""
    # the angles are wide by part of a beam
    for beam in range(int(low), wp.min(int(high), robot.beams - 1) + 1):
        # without branches, which processors guess wrong here
        along = center[0] * beams.x[eye.agent, beam] + center[1] * beams.y[eye.agent, beam]
        root = along * along - outside
        distance = wp.where(root > 0.0, along - wp.sqrt(wp.max(root, 0.0)), robot.max_range)
        scans[eye.row, beam] = lesser(scans[eye.row, beam], wp.max(distance, robot.min_range))


@wp.func
def see_disc(
    x: float, y: float, radius: float, eye: Eye, robot: Robot, beams: Beams, scans: wp.array2d(dtype=float)
):
    """Shorten the beams that meet a disc at a place in the world."""
    center = turned(eye, x - eye.x, y - eye.y)
    distance_sq = wp.dot(center, center)
    outside = distance_sq - radius * radius
    reach = robot.max_range + radius
    if outside <= 0.0 or outside > reach * reach:
        return
    if is_out_of_view(center[1] < -radius, past_last_beam(center, robot) > radius, robot):
        return
    # not less than the arc sine; each beam is asked whether it meets the disc
    distance = wp.sqrt(distance_sq)
    sine = radius / distance
    half = sine + 0.5708 * sine * sine * sine + ROUGHLY
    low = rough_bearing(center[0], center[1]) - half
    low = wp.where(low < 0.0, low + 2.0 * PI, low) * robot.beams_per_radian
    high = low + 2.0 * half * robot.beams_per_radian
    meet_disc(low, high, center, outside, eye, robot, beams, scans)
    lap = 2.0 * PI * robot.beams_per_radian
    if high >= lap:
        meet_disc(0.0, high - lap, center, outside, eye, robot, beams, scans)


@wp.func
def see_box(
    mover: Mover, place: wp.vec2, eye: Eye, robot: Robot, beams: Beams, scans: wp.array2d(dtype=float)
):
    """Shorten the beams that meet a box from outside, by its two pairs of sides."""
    center = turned(eye, place[0] - eye.x, place[1] - eye.y)
    along = turned(eye, mover.along[0], mover.along[1])
    ahead = wp.dot(center, along)
    beside = along[0] * center[1] - along[1] * center[0]
    if wp.abs(ahead) < mover.half[0] and wp.abs(beside) < mover.half[1]:
        return
    if wp.length(center) - mover.half[0] - mover.half[1] > robot.max_range:
        return
    for beam in range(robot.beams):
        x = beams.x[eye.agent, beam]
        y = beams.y[eye.agent, beam]
        # the beam in the frame of the box; never parallel to a side
        dx = x * along[0] + y * along[1]
        dy = along[0] * y - along[1] * x
        dx = wp.where(wp.abs(dx) < 1.0e-9, 1.0e-9, dx)
        dy = wp.where(wp.abs(dy) < 1.0e-9, 1.0e-9, dy)
        near_x = ahead / dx - mover.half[0] / wp.abs(dx)
        far_x = ahead / dx + mover.half[0] / wp.abs(dx)
        near_y = beside / dy - mover.half[1] / wp.abs(dy)
        far_y = beside / dy + mover.half[1] / wp.abs(dy)
        near = wp.max(near_x, near_y)
        if near > 0.0 and near <= wp.min(far_x, far_y):
            distance = wp.max(near, robot.min_range)
            if distance < scans[eye.row, beam]:
                scans[eye.row, beam] = distance


@wp.kernel
def cast_among(
    start: int,
    poses: wp.array3d(dtype=float),
    robots: wp.array(dtype=Robot),
    beams: Beams,
    substep: float,
    crowds: Crowds,
    walk: Walk,
    scans: wp.array2d(dtype=float),
):
    """Shorten the ranges of one robot of one episode where people and moving obstacles are nearer.

    Args:
        start: episode times robots that thread 0 works on.
        poses: (episodes, robots, 3).
        robots: the team.
        beams: of each robot.
        substep: seconds, the unit of the episodes' time.
        crowds: what moves in the worlds.
        walk: the people.
        scans: (episodes times robots, beams), as ``cast`` leaves them.
    """
    row = start + wp.tid()
    count = robots.shape[0]
    episode = row // count
    agent = row - episode * count
    robot = robots[agent]
    theta = poses[episode, agent, 2]
    cos = wp.cos(theta)
    sin = wp.sin(theta)
    eye = Eye()
    eye.agent = agent
    eye.row = row
    eye.x = poses[episode, agent, 0] + cos * robot.mount[0] - sin * robot.mount[1]
    eye.y = poses[episode, agent, 1] + sin * robot.mount[0] + cos * robot.mount[1]
    eye.cos = wp.cos(theta + robot.mount[2] + robot.first_angle)
    eye.sin = wp.sin(theta + robot.mount[2] + robot.first_angle)
    own = walk.world[episode]
    first = crowds.first_walker[own]
    for p in range(crowds.first_walker[own + 1] - first):
        walker = crowds.walkers[first + p]
        if walker.height > robot.lidar_height:
            place = planar(walk.poses[episode, p])
            see_disc(place[0], place[1], walker.radius, eye, robot, beams, scans)
    now = float(walk.time[episode]) * substep
    for m in range(crowds.first_mover[own], crowds.first_mover[own + 1]):
        mover = crowds.movers[m]
        if mover.base <= robot.lidar_height and robot.lidar_height < mover.top:
            place = place_of(mover, crowds, now)
            if mover.radius > 0.0:
                see_disc(place[0], place[1], mover.radius, eye, robot, beams, scans)
            else:
                see_box(mover, place, eye, robot, beams, scans)
