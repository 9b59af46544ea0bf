"""Warp kernels of the batch simulator: drive with contact, and lidar by angular rasterisation.

Geometry of all worlds lies in flat arrays; world ``w`` owns segments
``segment_start[w]:segment_start[w + 1]`` and likewise discs. Flags as in ``hpp_framework.worlds.slicing``.
"""

import warp as wp

PI = wp.constant(3.14159265358979)
SEEN = wp.constant(1)
TOUCHED = wp.constant(2)
ONE_SIDED = wp.constant(4)
RELAXATIONS = wp.constant(3)
TOUCH = wp.constant(1.0e-4)
REACH = wp.constant(0.05)


@wp.struct
class Robot:
    """Numbers of one robot that the kernels need; see ``RobotSpec``."""

    speed_min: float
    speed_max: float
    turn_rate: float
    acceleration: float
    turn_acceleration: float
    radius: float
    profile_radius: float
    height: float
    mass: float
    mount: wp.vec3
    lidar_height: float
    min_range: float
    max_range: float
    first_angle: float
    angle_step: float
    beams: int


@wp.struct
class Geometry:
    """All worlds of a pool."""

    segments: wp.array(dtype=wp.vec4)
    segment_heights: wp.array(dtype=wp.vec2)
    segment_flags: wp.array(dtype=int)
    segment_start: wp.array(dtype=int)
    discs: wp.array(dtype=wp.vec3)
    disc_heights: wp.array(dtype=wp.vec2)
    disc_start: wp.array(dtype=int)


@wp.func
def limit(value: float, low: float, high: float) -> float:
    """Clamp a value."""
    return wp.min(wp.max(value, low), high)


@wp.func
def from_segment(point: wp.vec2, segment: wp.vec4) -> wp.vec2:
    """Vector from the nearest point of a segment to ``point``."""
    start = wp.vec2(segment[0], segment[1])
    along = wp.vec2(segment[2] - segment[0], segment[3] - segment[1])
    share = limit(wp.dot(point - start, along) / wp.max(wp.dot(along, along), 1.0e-12), 0.0, 1.0)
    return point - start - along * share


@wp.func
def clearance(point: wp.vec2, height: float, world: int, geometry: Geometry) -> float:
    """Distance from a point to the nearest obstacle that a body of this height can touch."""
    nearest = float(1.0e9)
    for s in range(geometry.segment_start[world], geometry.segment_start[world + 1]):
        if (geometry.segment_flags[s] & TOUCHED) != 0 and geometry.segment_heights[s][0] < height:
            nearest = wp.min(nearest, wp.length_sq(from_segment(point, geometry.segments[s])))
    nearest = wp.sqrt(nearest)
    for c in range(geometry.disc_start[world], geometry.disc_start[world + 1]):
        if geometry.disc_heights[c][0] < height:
            disc = geometry.discs[c]
            nearest = wp.min(nearest, wp.length(point - wp.vec2(disc[0], disc[1])) - disc[2])
    return nearest


@wp.func
def push_out(point: wp.vec2, radius: float, height: float, world: int, geometry: Geometry) -> wp.vec2:
    """Move a disc out of every obstacle it overlaps, one after the other."""
    for s in range(geometry.segment_start[world], geometry.segment_start[world + 1]):
        if (geometry.segment_flags[s] & TOUCHED) != 0 and geometry.segment_heights[s][0] < height:
            away = from_segment(point, geometry.segments[s])
            distance = wp.length(away)
            if distance < radius and distance > 1.0e-9:
                point += away * ((radius - distance) / distance)
    for c in range(geometry.disc_start[world], geometry.disc_start[world + 1]):
        if geometry.disc_heights[c][0] < height:
            disc = geometry.discs[c]
            away = point - wp.vec2(disc[0], disc[1])
            distance = wp.length(away)
            if distance < radius + disc[2] and distance > 1.0e-9:
                point += away * ((radius + disc[2] - distance) / distance)
    return point


@wp.kernel
def drive(
    commands: wp.array3d(dtype=float),
    robots: wp.array(dtype=Robot),
    geometry: Geometry,
    world_index: wp.array(dtype=int),
    period: float,
    substeps: int,
    poses: wp.array3d(dtype=float),
    velocities: wp.array3d(dtype=float),
    collided: wp.array2d(dtype=wp.bool),
    near: wp.array2d(dtype=int),
    before: wp.array2d(dtype=wp.vec2),
):
    """Drive every robot of one episode for one control period.

    Unicycle under speed and acceleration limits, integrated by the midpoint rule (exact for constant
    acceleration on a straight line). Contact moves discs apart along the normal, so a robot stops head-on and
    slides at an angle; its speed becomes what is left of it along the heading.
    """
    episode = wp.tid()
    world = world_index[episode]
    count = robots.shape[0]
    dt = period / float(substeps)
    for i in range(count):
        robot = robots[i]
        at = wp.vec2(poses[episode, i, 0], poses[episode, i, 1])
        reach = robot.radius + wp.max(robot.speed_max, -robot.speed_min) * period + REACH
        collided[episode, i] = False
        near[episode, i] = 0
        # a neighbour may push us further than we drive
        if clearance(at, robot.height, world, geometry) < 2.0 * reach:
            near[episode, i] = 1
    for _step in range(substeps):
        for i in range(count):
            robot = robots[i]
            theta = poses[episode, i, 2]
            v_old = velocities[episode, i, 0]
            w_old = velocities[episode, i, 1]
            v_goal = limit(commands[episode, i, 0], robot.speed_min, robot.speed_max)
            w_goal = limit(commands[episode, i, 1], -robot.turn_rate, robot.turn_rate)
            v = v_old + limit(v_goal - v_old, -robot.acceleration * dt, robot.acceleration * dt)
            w = w_old + limit(w_goal - w_old, -robot.turn_acceleration * dt, robot.turn_acceleration * dt)
            turn = 0.5 * (w_old + w) * dt
            ahead = 0.5 * (v_old + v) * dt
            heading = theta + 0.5 * turn
            before[episode, i] = wp.vec2(poses[episode, i, 0], poses[episode, i, 1])
            poses[episode, i, 0] = poses[episode, i, 0] + ahead * wp.cos(heading)
            poses[episode, i, 1] = poses[episode, i, 1] + ahead * wp.sin(heading)
            poses[episode, i, 2] = theta + turn - 2.0 * PI * wp.floor((theta + turn + PI) / (2.0 * PI))
            velocities[episode, i, 0] = v
            velocities[episode, i, 1] = w
        for _relaxation in range(RELAXATIONS):
            moved = int(0)
            for i in range(count):
                for j in range(i + 1, count):
                    gap_x = poses[episode, i, 0] - poses[episode, j, 0]
                    gap_y = poses[episode, i, 1] - poses[episode, j, 1]
                    distance = wp.sqrt(gap_x * gap_x + gap_y * gap_y)
                    overlap = robots[i].radius + robots[j].radius - distance
                    if overlap > 0.0 and distance > 1.0e-9:
                        share = robots[j].mass / (robots[i].mass + robots[j].mass)
                        nx = gap_x / distance
                        ny = gap_y / distance
                        poses[episode, i, 0] = poses[episode, i, 0] + nx * overlap * share
                        poses[episode, i, 1] = poses[episode, i, 1] + ny * overlap * share
                        poses[episode, j, 0] = poses[episode, j, 0] - nx * overlap * (1.0 - share)
                        poses[episode, j, 1] = poses[episode, j, 1] - ny * overlap * (1.0 - share)
                        near[episode, i] = near[episode, i] | 2
                        near[episode, j] = near[episode, j] | 2
                        collided[episode, i] = True
                        collided[episode, j] = True
                        moved = 1
            for i in range(count):
                if near[episode, i] != 0:
                    at = wp.vec2(poses[episode, i, 0], poses[episode, i, 1])
                    free = push_out(at, robots[i].radius, robots[i].height, world, geometry)
                    if wp.length(free - at) > TOUCH:
                        collided[episode, i] = True
                        near[episode, i] = near[episode, i] | 2
                        moved = 1
                    poses[episode, i, 0] = free[0]
                    poses[episode, i, 1] = free[1]
            if moved == 0:
                break
        for i in range(count):
            if (near[episode, i] & 2) != 0:
                theta = poses[episode, i, 2]
                travelled = wp.vec2(poses[episode, i, 0], poses[episode, i, 1]) - before[episode, i]
                along = wp.dot(travelled, wp.vec2(wp.cos(theta), wp.sin(theta))) / dt
                v = velocities[episode, i, 0]
                velocities[episode, i, 0] = limit(along, wp.min(v, 0.0), wp.max(v, 0.0))
                near[episode, i] = near[episode, i] & 1


@wp.func
def mark_line(
    low: float,
    high: float,
    normal: wp.vec2,
    offset: float,
    robot: Robot,
    directions: wp.array2d(dtype=wp.vec2),
    episode: int,
    agent: int,
    scans: wp.array3d(dtype=float),
):
    """Enter a line n.p = offset > 0 into the beams between two angles; scans hold inverse ranges."""
    first = wp.max(int(wp.ceil((low - robot.first_angle) / robot.angle_step - 1.0e-4)), 0)
    last = wp.min(int(wp.floor((high - robot.first_angle) / robot.angle_step + 1.0e-4)), robot.beams - 1)
    for k in range(first, last + 1):
        inverse = wp.dot(normal, directions[agent, k]) / offset
        scans[episode, agent, k] = wp.max(scans[episode, agent, k], inverse)


@wp.func
def mark_disc(
    center: wp.vec2,
    radius: float,
    robot: Robot,
    directions: wp.array2d(dtype=wp.vec2),
    episode: int,
    agent: int,
    scans: wp.array3d(dtype=float),
):
    """Enter a disc seen from the origin of the sensor frame."""
    distance_sq = wp.dot(center, center)
    outside = distance_sq - radius * radius
    if outside <= 0.0:
        return
    bearing = wp.atan2(center[1], center[0])
    half = wp.asin(wp.min(radius / wp.sqrt(distance_sq), 1.0))
    for lap in range(-1, 2):
        low = bearing - half + 2.0 * PI * float(lap)
        high = bearing + half + 2.0 * PI * float(lap)
        first = wp.max(int(wp.ceil((low - robot.first_angle) / robot.angle_step)), 0)
        last = wp.min(int(wp.floor((high - robot.first_angle) / robot.angle_step)), robot.beams - 1)
        for k in range(first, last + 1):
            along = wp.dot(center, directions[agent, k])
            root = along * along - outside
            if root > 0.0 and along > 0.0:
                inverse = (along + wp.sqrt(root)) / outside
                scans[episode, agent, k] = wp.max(scans[episode, agent, k], inverse)


@wp.kernel
def cast(
    poses: wp.array3d(dtype=float),
    robots: wp.array(dtype=Robot),
    directions: wp.array2d(dtype=wp.vec2),
    geometry: Geometry,
    world_index: wp.array(dtype=int),
    scans: wp.array3d(dtype=float),
):
    """Cast the lidar of one robot of one episode.

    Each obstacle touches only the beams between its two ends and keeps the largest inverse range, which is
    linear in a beam's direction cosines.
    """
    episode, agent = wp.tid()
    robot = robots[agent]
    world = world_index[episode]
    cos = wp.cos(poses[episode, agent, 2])
    sin = wp.sin(poses[episode, agent, 2])
    eye_x = poses[episode, agent, 0] + cos * robot.mount[0] - sin * robot.mount[1]
    eye_y = poses[episode, agent, 1] + sin * robot.mount[0] + cos * robot.mount[1]
    cos = wp.cos(poses[episode, agent, 2] + robot.mount[2])
    sin = wp.sin(poses[episode, agent, 2] + robot.mount[2])
    farthest = 1.0 / robot.max_range
    for k in range(scans.shape[2]):
        scans[episode, agent, k] = farthest
    for s in range(geometry.segment_start[world], geometry.segment_start[world + 1]):
        flags = geometry.segment_flags[s]
        heights = geometry.segment_heights[s]
        if (flags & SEEN) != 0 and heights[0] <= robot.lidar_height and robot.lidar_height < heights[1]:
            line = geometry.segments[s]
            x0 = cos * (line[0] - eye_x) + sin * (line[1] - eye_y)
            y0 = cos * (line[1] - eye_y) - sin * (line[0] - eye_x)
            x1 = cos * (line[2] - eye_x) + sin * (line[3] - eye_y)
            y1 = cos * (line[3] - eye_y) - sin * (line[2] - eye_x)
            length = wp.sqrt((x1 - x0) * (x1 - x0) + (y1 - y0) * (y1 - y0))
            normal = wp.vec2((y1 - y0) / length, (x0 - x1) / length)
            offset = normal[0] * x0 + normal[1] * y0
            # for a counter-clockwise outline the normal points outwards: the front side has offset < 0
            if not ((flags & ONE_SIDED) != 0 and offset >= 0.0) and wp.abs(offset) > 1.0e-6:
                if offset < 0.0:
                    normal = -normal
                    offset = -offset
                if offset < robot.max_range:
                    a0 = wp.atan2(y0, x0)
                    a1 = wp.atan2(y1, x1)
                    low = wp.min(a0, a1)
                    high = wp.max(a0, a1)
                    if high - low <= PI:
                        mark_line(low, high, normal, offset, robot, directions, episode, agent, scans)
                    else:
                        mark_line(
                            high, low + 2.0 * PI, normal, offset, robot, directions, episode, agent, scans
                        )
                        mark_line(
                            high - 2.0 * PI, low, normal, offset, robot, directions, episode, agent, scans
                        )
    for c in range(geometry.disc_start[world], geometry.disc_start[world + 1]):
        heights = geometry.disc_heights[c]
        if heights[0] <= robot.lidar_height and robot.lidar_height < heights[1]:
            disc = geometry.discs[c]
            center = wp.vec2(
                cos * (disc[0] - eye_x) + sin * (disc[1] - eye_y),
                cos * (disc[1] - eye_y) - sin * (disc[0] - eye_x),
            )
            mark_disc(center, disc[2], robot, directions, episode, agent, scans)
    for j in range(robots.shape[0]):
        if j != agent and robots[j].height > robot.lidar_height:
            dx = poses[episode, j, 0] - eye_x
            dy = poses[episode, j, 1] - eye_y
            center = wp.vec2(cos * dx + sin * dy, cos * dy - sin * dx)
            mark_disc(center, robots[j].profile_radius, robot, directions, episode, agent, scans)
    for k in range(scans.shape[2]):
        inverse = scans[episode, agent, k]
        scans[episode, agent, k] = robot.max_range
        # a miss reads the maximum to the last bit, whatever the rounding of 1 / (1 / x)
        if inverse > farthest:
            scans[episode, agent, k] = wp.max(1.0 / inverse, robot.min_range)
