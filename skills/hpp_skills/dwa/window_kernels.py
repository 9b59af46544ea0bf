"""Warp kernels of the dynamic window approach: look around, rate every command, choose one."""

import warp as wp

wp.set_module_options({"enable_backward": False})

PI = wp.constant(3.14159265358979)
FAR = wp.constant(1.0e3)
"""Metres: further than any lidar sees."""
STRAIGHT = wp.constant(1.0e-3)
"""Curvature in 1/m below which an arc is a line."""
MISSED = wp.constant(0.999)
"""Share of the maximum range from which on a beam hit nothing."""
RETREAT = wp.constant(0.002)
"""Metres by which a point that is too near already may come nearer still."""
DIRECTIONS = wp.constant(72)
BLOCKED = wp.constant(-20.0)
UNSEEN = wp.constant(-15.0)
"""Merits of directions that are blocked at once, and of those that the lidar does not see: a direction that
is free for less than half as far as it should be is worse than one that is not seen."""
INADMISSIBLE = wp.constant(-1.0e3)
HASTY = wp.constant(-10.0)
"""Scores of commands that cannot be stopped from in time, and of those that turn into what is not seen."""


@wp.struct
class Window:
    """Numbers of one robot and of the configuration; see ``RobotSpec`` and ``DwaConfig``."""

    speed_max: float
    turn_rate: float
    acceleration: float
    turn_acceleration: float
    radius: float
    mount: wp.vec3
    first_angle: float
    angle_step: float
    field_of_view: float
    max_range: float
    period: float
    speeds: int
    turns: int
    look_ahead: float
    horizon: float
    """Metres: the longest arc that is looked at."""
    margin: float
    blind_turn: float
    side_reach: float
    free_path: float
    keep: float
    goal_radius: float
    heading: float
    progress: float
    clearance: float
    side: float
    speed: float


@wp.func
def wrapped(angle: float) -> float:
    """Wrap an angle into [-pi, pi)."""
    return angle - 2.0 * PI * wp.floor((angle + PI) / (2.0 * PI))


@wp.func
def line_hit(point: wp.vec3) -> float:
    """Metres that the robot may drive straight ahead before it touches a point; FAR if it never does."""
    half_sq = point[2] * point[2] - point[1] * point[1]
    if half_sq <= 0.0:
        return FAR
    half = wp.sqrt(half_sq)
    if point[0] + half < 0.0:
        return FAR
    return wp.max(point[0] - half, 0.0)


@wp.func
def line_room(point: wp.vec3, length: float, room: wp.vec2) -> wp.vec2:
    """Do what ``arc_room`` does, for a straight path."""
    gap = wp.abs(point[1]) - point[2]
    if gap <= 0.0:
        return wp.vec2(wp.min(room[0], line_hit(point)), room[1])
    if point[0] >= 0.0 and point[0] <= length:
        return wp.vec2(room[0], wp.min(room[1], gap))
    return room


@wp.func
def arc_room(point: wp.vec3, radius: float, length: float, room: wp.vec2) -> wp.vec2:
    """Lessen the room that the robot has along a left arc by what one point leaves it.

    Args:
        point: x, y and the distance at which it counts as touched, in the frame of the arc's start.
        radius: of the arc, metres.
        length: of the arc, along which gaps count.
        room: metres to the first hit, and the least gap beside the arc, as the points before leave them.
    """
    # is the point's distance from the arc's centre within reach of the radius? Squared, as for most it is not
    reach = point[2] + room[1]
    away_sq = point[0] * point[0] + point[1] * point[1]
    further = away_sq - 2.0 * radius * point[1] - reach * reach
    if further >= 2.0 * radius * reach or (radius > reach and further <= -2.0 * radius * reach):
        return room
    across = radius - point[1]
    rho = wp.sqrt(point[0] * point[0] + across * across)
    off = wp.abs(rho - radius)
    gap = off - point[2]
    if gap > 0.0:
        angle = wp.atan2(point[0], across)
        if angle >= 0.0 and angle * radius <= length:
            return wp.vec2(room[0], wp.min(room[1], gap))
        return room
    # no arc to a hit is shorter than the straight line
    if away_sq >= (room[0] + point[2]) * (room[0] + point[2]):
        return room
    # half the angle between touching the point and being at its side, by the law of cosines
    share = (point[2] * point[2] - off * off) / wp.max(4.0 * radius * rho, 1.0e-9)
    if share >= 1.0:
        return wp.vec2(0.0, room[1])
    angle = wp.atan2(point[0], across)
    spread = 2.0 * wp.asin(wp.sqrt(share))
    hit = angle - spread
    if hit < 0.0:
        hit = wp.where(angle + spread > 0.0, 0.0, hit + 2.0 * PI)
    return wp.vec2(wp.min(room[0], hit * radius), room[1])


@wp.func
def free_ahead(
    robot: int, angle: float, limit: float, count: int, points: wp.array2d(dtype=wp.vec3)
) -> float:
    """Return how far the robot could drive in a direction once it has turned there, at most ``limit``."""
    free = float(limit)
    cos = wp.cos(angle)
    sin = wp.sin(angle)
    for p in range(count):
        point = points[robot, p]
        x = cos * point[0] + sin * point[1]
        if x > 0.0:
            y = cos * point[1] - sin * point[0]
            free = wp.min(free, line_hit(wp.vec3(x, y, point[2])))
    return free


@wp.func
def aim(
    robot: int,
    goal: wp.vec2,
    turn_rate: float,
    count: int,
    points: wp.array2d(dtype=wp.vec3),
    window: Window,
) -> wp.vec2:
    """Return the point to head for: the goal, or a point in the free direction nearest to it."""
    distance = wp.length(goal)
    bearing = wp.atan2(goal[1], goal[0])
    limit = wp.min(window.free_path, distance)
    half = 0.5 * window.field_of_view
    seen = wp.abs(wrapped(bearing - window.mount[2])) <= half
    if not seen or free_ahead(robot, bearing, limit, count, points) >= limit:
        return goal
    # where it looks once it has stopped turning: a robot that looks for a way out keeps turning to the same
    # side
    facing = 0.5 * turn_rate * wp.abs(turn_rate) / window.turn_acceleration
    best = float(-FAR)
    target = goal
    for k in range(DIRECTIONS):
        angle = (float(k) + 0.5) * 2.0 * PI / float(DIRECTIONS) - PI
        merit = -wp.abs(wrapped(angle - bearing)) - window.keep * wp.abs(wrapped(angle - facing))
        if wp.abs(wrapped(angle - window.mount[2])) > half:
            merit += UNSEEN
        else:
            free = free_ahead(robot, angle, limit, count, points)
            merit += wp.where(free >= limit, 0.0, BLOCKED * (1.0 - 0.5 * free / limit))
        if merit > best:
            best = merit
            target = limit * wp.vec2(wp.cos(angle), wp.sin(angle))
    return target


@wp.func
def eye_then(poses: wp.array2d(dtype=wp.vec3), robot: int, entry: int, window: Window) -> wp.vec3:
    """Return the lidar's pose at an entry of the history, in the robot's present frame."""
    now = poses[robot, poses.shape[1] - 1]
    then = poses[robot, entry]
    cos = wp.cos(then[2])
    sin = wp.sin(then[2])
    x = then[0] + cos * window.mount[0] - sin * window.mount[1] - now[0]
    y = then[1] + sin * window.mount[0] + cos * window.mount[1] - now[1]
    cos = wp.cos(now[2])
    sin = wp.sin(now[2])
    return wp.vec3(cos * x + sin * y, cos * y - sin * x, then[2] - now[2] + window.mount[2])


@wp.func
def is_seen(x: float, y: float, window: Window) -> bool:
    """Return whether a point lies in the present field of view."""
    angle = wp.atan2(y - window.mount[1], x - window.mount[0]) - window.mount[2]
    return wp.abs(wrapped(angle)) <= 0.5 * window.field_of_view


@wp.kernel
def look(
    start: int,
    scans: wp.array3d(dtype=float),
    poses: wp.array2d(dtype=wp.vec3),
    velocities: wp.array(dtype=wp.vec2),
    goals: wp.array(dtype=wp.vec2),
    window: Window,
    points: wp.array2d(dtype=wp.vec3),
    counts: wp.array(dtype=int),
    targets: wp.array(dtype=wp.vec2),
):
    """Turn scans into points near the robots, and find what to head for.

    Earlier scans add what has left the field of view since and is still close.

    Args:
        start: first robot of this launch.
        scans: ranges of each robot, metres, oldest first.
        poses: of each robot when it took them, world frame.
        velocities: forward speed and turn rate of each robot.
        goals: in the robots' frames.
        window: numbers.
        points: out; x, y in the robots' frames and the distance at which a point counts as touched.
        counts: out; points of each robot.
        targets: out; in the robots' frames.
    """
    robot = start + wp.tid()
    body = window.radius + window.margin
    newest = scans.shape[1] - 1
    count = int(0)
    for back in range(scans.shape[1]):
        entry = newest - back
        eye = eye_then(poses, robot, entry, window)
        reach = body + wp.where(back == 0, window.horizon, window.side_reach)
        for beam in range(scans.shape[2]):
            distance = scans[robot, entry, beam]
            if distance < MISSED * window.max_range and count < points.shape[1]:
                angle = eye[2] + window.first_angle + float(beam) * window.angle_step
                x = eye[0] + distance * wp.cos(angle)
                y = eye[1] + distance * wp.sin(angle)
                away = wp.sqrt(x * x + y * y)
                if away < reach and (back == 0 or not is_seen(x, y, window)):
                    points[robot, count] = wp.vec3(x, y, wp.min(body, wp.max(away - RETREAT, 0.0)))
                    count = count + 1
    counts[robot] = count
    targets[robot] = aim(robot, goals[robot], velocities[robot][1], count, points, window)


@wp.func
def command_of(index: int, velocity: wp.vec2, window: Window) -> wp.vec2:
    """Return one command of the window; the last one is to brake along the present arc."""
    if index == window.speeds * window.turns:
        seconds = wp.max(velocity[0] / window.acceleration, wp.abs(velocity[1]) / window.turn_acceleration)
        return velocity * wp.max(1.0 - window.period / wp.max(seconds, 1.0e-6), 0.0)
    change = window.acceleration * window.period
    low = wp.clamp(velocity[0] - change, 0.0, window.speed_max)
    high = wp.clamp(velocity[0] + change, 0.0, window.speed_max)
    change = window.turn_acceleration * window.period
    right = wp.clamp(velocity[1] - change, -window.turn_rate, window.turn_rate)
    left = wp.clamp(velocity[1] + change, -window.turn_rate, window.turn_rate)
    faster = float(index / window.turns) / float(window.speeds - 1)
    lefter = float(index % window.turns) / float(window.turns - 1)
    return wp.vec2(low + faster * (high - low), right + lefter * (left - right))


@wp.func
def after_period(velocity: wp.vec2, command: wp.vec2, window: Window) -> wp.vec3:
    """Return the pose one control period ahead, in the robot's frame: speeds ramp, then stay."""
    slower = velocity[0] - command[0]
    ramp = wp.min(wp.abs(slower) / window.acceleration, window.period)
    ahead = command[0] * window.period + 0.5 * slower * ramp
    slower = velocity[1] - command[1]
    ramp = wp.min(wp.abs(slower) / window.turn_acceleration, window.period)
    turn = command[1] * window.period + 0.5 * slower * ramp
    return wp.vec3(ahead * wp.cos(0.5 * turn), ahead * wp.sin(0.5 * turn), turn)


@wp.func
def along_arc(pose: wp.vec3, curvature: float, length: float) -> wp.vec3:
    """Return the pose at the end of an arc."""
    turn = curvature * length
    chord = float(length)
    if wp.abs(turn) > 1.0e-4:
        chord = 2.0 * wp.sin(0.5 * turn) / curvature
    return wp.vec3(
        pose[0] + chord * wp.cos(pose[2] + 0.5 * turn),
        pose[1] + chord * wp.sin(pose[2] + 0.5 * turn),
        pose[2] + turn,
    )


@wp.func
def room_along(
    robot: int,
    pose: wp.vec3,
    curvature: float,
    length: float,
    count: int,
    points: wp.array2d(dtype=wp.vec3),
    window: Window,
) -> wp.vec2:
    """Return the metres to the first hit along an arc, at most the horizon, and the least gap beside it."""
    room = wp.vec2(window.horizon, window.side_reach)
    mirror = wp.where(curvature < 0.0, -1.0, 1.0)
    bend = wp.abs(curvature)
    straight = bend < STRAIGHT
    radius = 1.0 / wp.max(bend, STRAIGHT)
    cos = wp.cos(pose[2])
    sin = wp.sin(pose[2])
    for p in range(count):
        point = points[robot, p]
        x = point[0] - pose[0]
        y = point[1] - pose[1]
        point = wp.vec3(cos * x + sin * y, mirror * (cos * y - sin * x), point[2])
        if straight:
            room = line_room(point, length, room)
        else:
            room = arc_room(point, radius, length, room)
    return room


@wp.func
def heading_error(error: float, turn_rate: float, window: Window) -> float:
    """Return what a turn rate leaves of a heading error: how far it turns past, or what it does not reach."""
    turned = 0.5 * turn_rate * turn_rate / window.turn_acceleration
    if turn_rate * error <= 0.0:
        return wp.min(wp.abs(error) + turned, PI)
    if turned >= wp.abs(error):
        return turned - wp.abs(error)
    return wp.max(wp.abs(error) - wp.abs(turn_rate) * window.look_ahead, 0.0)


@wp.kernel
def rate(
    start: int,
    velocities: wp.array(dtype=wp.vec2),
    goals: wp.array(dtype=wp.vec2),
    targets: wp.array(dtype=wp.vec2),
    points: wp.array2d(dtype=wp.vec3),
    counts: wp.array(dtype=int),
    window: Window,
    scores: wp.array2d(dtype=float),
):
    """Rate every command of the window.

    Args:
        start: first robot of this launch.
        velocities: forward speed and turn rate of each robot.
        goals: in the robots' frames.
        targets: what to head for, in the robots' frames.
        points: near the robots, as ``look`` wrote them.
        counts: points of each robot.
        window: numbers.
        scores: out, (robot, command); much below zero where the robot could not stop in time.
    """
    offset, index = wp.tid()
    robot = start + offset
    velocity = velocities[robot]
    command = command_of(index, velocity, window)
    speed = command[0]
    pose = after_period(velocity, command, window)
    target = targets[robot]
    before = wp.length(target)
    room = wp.vec2(window.horizon, window.side_reach)
    length = float(0.0)
    end = pose
    seconds = wp.max(speed / window.acceleration, wp.abs(command[1]) / window.turn_acceleration)
    needed = 0.5 * speed * seconds
    if speed > 1.0e-3:
        curvature = command[1] / speed
        length = wp.min(speed * window.look_ahead, before)
        room = room_along(robot, pose, curvature, length, counts[robot], points, window)
        length = wp.min(length, room[0])
        end = along_arc(pose, curvature, length)
    else:
        # turning in place leads nowhere: whatever drives on is preferred, but standing still is not
        room[0] = 0.0
    away = wp.vec2(target[0] - end[0], target[1] - end[1])
    left = wp.length(away)
    error = wrapped(wp.atan2(away[1], away[0]) - pose[2])
    # the direction of a target says nothing where it is reached
    missed = heading_error(error, command[1], window) * wp.min(2.0 * left, 1.0)
    score = window.heading * (1.0 - missed / PI)
    score += window.progress * (before - left) / (window.speed_max * window.look_ahead)
    score += window.clearance * room[0] / window.horizon
    score += window.side * room[1] / window.side_reach
    score += window.speed * speed / window.speed_max
    if speed > 1.0e-3:
        if needed > room[0]:
            # the lesser evil, should nothing be admissible: what leaves most room to brake without turning
            shortage = 0.5 * speed * speed / window.acceleration - room[0]
            score = INADMISSIBLE - 100.0 * shortage
        elif 0.5 * wp.abs(command[1]) * seconds > window.blind_turn:
            score += HASTY
    # the goal is where it must be able to stop, too
    to_goal = wp.length(wp.vec2(goals[robot][0] - pose[0], goals[robot][1] - pose[1]))
    stopping = 0.5 * speed * speed / window.acceleration
    scores[robot, index] = score - 10.0 * wp.max(stopping - to_goal, 0.0)


@wp.kernel
def choose(
    start: int,
    velocities: wp.array(dtype=wp.vec2),
    goals: wp.array(dtype=wp.vec2),
    scores: wp.array2d(dtype=float),
    window: Window,
    commands: wp.array(dtype=wp.vec2),
):
    """Give each robot the first of its best commands, and rest to those at their goals.

    Args:
        start: first robot of this launch.
        velocities: forward speed and turn rate of each robot.
        goals: in the robots' frames.
        scores: (robot, command).
        window: numbers.
        commands: out; forward speed and turn rate.
    """
    robot = start + wp.tid()
    best = int(0)
    for index in range(1, scores.shape[1]):
        if scores[robot, index] > scores[robot, best]:
            best = index
    command = command_of(best, velocities[robot], window)
    if wp.length(goals[robot]) < window.goal_radius:
        command = wp.vec2(0.0, 0.0)
    commands[robot] = command
