"""Warp kernels of the safety filter: gather what a robot could touch, and correct its command."""

import warp as wp

wp.set_module_options({"enable_backward": False})

PI = wp.constant(3.14159265358979)
MISSED = wp.constant(0.999)
"""Share of the maximum range from which on a beam hit nothing."""
SPACING = wp.constant(0.02)
"""Metres from one point of a scan to the next that is kept; a footprint that touches both comes less than a
millimetre farther between them."""
NEARER = wp.constant(0.001)
"""Metres by which a point within the margin may come nearer still: scans of one thing differ by as much."""
SHARE = wp.constant(0.25)
"""Share of the margin within which nothing may come nearer at all."""
SLACK = wp.constant(1.0e-6)
"""Square metres that rounding may cost."""
STEP = wp.constant(0.1)
"""Seconds between the places of a foreseen motion; at 1 m/s the footprint's edge between two of them is
4 mm inside the sum of their discs."""
SPEEDS = wp.constant(4)
TURNS = wp.constant(7)
"""Speeds and turn rates that are tried instead of the wanted ones."""
CREEP = wp.constant(0.03)
"""Speed in m/s below which a robot that wants to drive counts as stopped."""
HEADINGS = wp.constant(48)
LOOKS = wp.constant(4)
"""Headings in which a stopped robot looks for a way out, and places along each."""


@wp.struct
class Limits:
    """Numbers of one robot and of the configuration; see ``RobotSpec`` and ``SafetyFilterConfig``."""

    speed_min: float
    speed_max: float
    turn_rate: float
    acceleration: float
    turn_acceleration: float
    radius: float
    mount: wp.vec3
    half_view: float
    max_range: float
    body: float
    period: float
    margin: float
    way_out: float


@wp.func
def in_view(point: wp.vec2, limits: Limits) -> bool:
    """Return whether a point in the robot's frame lies in the present field of view."""
    angle = wp.atan2(point[1] - limits.mount[1], point[0] - limits.mount[0]) - limits.mount[2]
    angle -= 2.0 * PI * wp.floor((angle + PI) / (2.0 * PI))
    return wp.abs(angle) <= limits.half_view


@wp.func
def on_teammate(
    row: int, entry: int, agent: int, place: wp.vec2, poses: wp.array3d(dtype=wp.vec3), body: float
) -> bool:
    """Return whether a place in the world was on another robot."""
    for robot in range(poses.shape[2]):
        at = poses[row, entry, robot]
        if robot != agent and wp.length(place - wp.vec2(at[0], at[1])) < body:
            return True
    return False


@wp.func
def keep_off(point: wp.vec2, margin: float, limits: Limits) -> wp.vec3:
    """Return a point with the square of the distance that the robot's middle must keep from it."""
    away = wp.length(point)
    floor = wp.min(away, limits.radius + SHARE * limits.margin)
    apart = wp.min(limits.radius + margin, wp.max(away - NEARER, floor))
    return wp.vec3(point[0], point[1], apart * apart - SLACK)


@wp.kernel
def gather(
    scans: wp.array3d(dtype=float),
    beams: wp.array(dtype=wp.vec2),
    poses: wp.array3d(dtype=wp.vec3),
    agent: int,
    velocities: wp.array(dtype=wp.vec2),
    jitter: wp.array(dtype=float),
    limits: Limits,
    points: wp.array2d(dtype=wp.vec3),
    counts: wp.array(dtype=int),
):
    """Collect the points that a robot could touch before it stands, the present scan's first.

    Earlier scans add what is out of view now. Points on other robots are left out: they move.

    Args:
        scans: (robot, entry, beam), metres, the present scan last.
        beams: direction of each beam in the lidar's frame.
        poses: (robot, entry, teammate) when the scans were taken, world frame.
        agent: index of the robot in its team.
        velocities: forward speed and turn rate.
        jitter: seconds by which commands may act earlier or later; as far as the robot drives then, it keeps
            off more.
        limits: numbers.
        points: out; x, y in the robot's frame, and the square of the distance to keep.
        counts: out; points of each robot.
    """
    row = wp.tid()
    newest = scans.shape[1] - 1
    speed = wp.abs(velocities[row][0]) + limits.acceleration * limits.period
    stopping = speed * limits.period + 0.5 * speed * speed / limits.acceleration
    margin = limits.margin + jitter[row] * wp.abs(velocities[row][0])
    reach = limits.radius + margin + wp.max(stopping, limits.way_out)
    now = poses[row, newest, agent]
    cos = wp.cos(now[2])
    sin = wp.sin(now[2])
    count = int(0)
    for back in range(scans.shape[1]):
        entry = newest - back
        then = poses[row, entry, agent]
        # the lidar then, in the robot's present frame
        x = then[0] - now[0] + wp.cos(then[2]) * limits.mount[0] - wp.sin(then[2]) * limits.mount[1]
        y = then[1] - now[1] + wp.sin(then[2]) * limits.mount[0] + wp.cos(then[2]) * limits.mount[1]
        eye = wp.vec2(cos * x + sin * y, cos * y - sin * x)
        turned = then[2] - now[2] + limits.mount[2]
        along = wp.vec2(wp.cos(turned), wp.sin(turned))
        farthest = wp.min(reach + wp.length(eye), MISSED * limits.max_range)
        last = wp.vec2(1.0e6, 0.0)
        for beam in range(scans.shape[2]):
            distance = scans[row, entry, beam]
            if distance < farthest and count < points.shape[1]:
                ray = beams[beam]
                point = eye + distance * wp.vec2(
                    along[0] * ray[0] - along[1] * ray[1], along[1] * ray[0] + along[0] * ray[1]
                )
                if (
                    wp.length(point) < reach
                    and wp.length(point - last) > SPACING
                    and (back == 0 or not in_view(point, limits))
                ):
                    place = wp.vec2(
                        now[0] + cos * point[0] - sin * point[1], now[1] + sin * point[0] + cos * point[1]
                    )
                    if not on_teammate(row, entry, agent, place, poses, limits.body):
                        last = point
                        points[row, count] = keep_off(point, margin, limits)
                        count = count + 1
    counts[row] = count


@wp.func
def trespass(row: int, place: wp.vec2, count: int, points: wp.array2d(dtype=wp.vec3)) -> float:
    """Return how far a robot at a place would be in what it must keep off, square metres; 0 if it is not."""
    most = float(0.0)
    for p in range(count):
        point = points[row, p]
        x = point[0] - place[0]
        y = point[1] - place[1]
        most = wp.max(most, point[2] - x * x - y * y)
    return most


@wp.func
def trespass_of_stop(
    row: int,
    velocity: wp.vec2,
    command: wp.vec2,
    turn_rate: float,
    enough: float,
    count: int,
    points: wp.array2d(dtype=wp.vec3),
    limits: Limits,
) -> float:
    """Return the worst trespass of a command for one period and of a full stop after it.

    Args:
        row: robot.
        velocity: now.
        command: for one period.
        turn_rate: commanded while braking.
        enough: trespass at which the rest is not looked at.
        count: points of the robot.
        points: to keep off.
        limits: numbers.
    """
    change = wp.vec2(limits.acceleration * STEP, limits.turn_acceleration * STEP)
    wanted = command
    v = velocity[0]
    w = velocity[1]
    place = wp.vec2(0.0, 0.0)
    heading = float(0.0)
    time = float(0.0)
    worst = float(0.0)
    moving = bool(True)
    while moving:
        v_next = v + wp.clamp(wanted[0] - v, -change[0], change[0])
        w_next = w + wp.clamp(wanted[1] - w, -change[1], change[1])
        ahead = 0.5 * (v + v_next) * STEP
        turn = 0.5 * (w + w_next) * STEP
        place += ahead * wp.vec2(wp.cos(heading + 0.5 * turn), wp.sin(heading + 0.5 * turn))
        heading += turn
        v = v_next
        w = w_next
        time += STEP
        worst = wp.max(worst, trespass(row, place, count, points))
        if time > limits.period - 0.5 * STEP:
            wanted = wp.vec2(0.0, turn_rate)
            moving = wp.abs(v) > 0.0
        moving = moving and worst < enough
    return worst


@wp.func
def least_trespass(
    row: int,
    velocity: wp.vec2,
    command: wp.vec2,
    enough: float,
    count: int,
    points: wp.array2d(dtype=wp.vec3),
    limits: Limits,
) -> float:
    """Return the trespass of the best of four stops: turning on, straightening, or hard to either side."""
    least = trespass_of_stop(row, velocity, command, command[1], enough, count, points, limits)
    for side in range(3):
        if least > 0.0:
            turn_rate = float(side - 1) * limits.turn_rate
            other = trespass_of_stop(
                row, velocity, command, turn_rate, wp.min(least, enough), count, points, limits
            )
            least = wp.min(least, other)
    return least


@wp.func
def turn_out(
    row: int, turn_rate: float, count: int, points: wp.array2d(dtype=wp.vec3), limits: Limits
) -> float:
    """Return the turn rate that leads a stopped robot to the nearest heading in which it can drive off.

    Nearest to where it looks once it has stopped turning: so it goes on turning to the same side.
    """
    facing = 0.5 * turn_rate * wp.abs(turn_rate) / limits.turn_acceleration
    for k in range(HEADINGS):
        # 0, 1, -1, 2, -2, ...
        side = float((k + 1) / 2) * wp.where(k % 2 == 0, -1.0, 1.0)
        heading = facing + side * 2.0 * PI / float(HEADINGS)
        worst = float(0.0)
        for look in range(LOOKS):
            ahead = limits.way_out * float(look + 1) / float(LOOKS)
            place = wp.vec2(ahead * wp.cos(heading), ahead * wp.sin(heading))
            worst = wp.max(worst, trespass(row, place, count, points))
        if worst == 0.0:
            return wp.sign(heading) * wp.sqrt(2.0 * limits.turn_acceleration * wp.abs(heading))
    return turn_rate


@wp.func
def turn_to_try(index: int, wanted: float, turn_rate: float, change: float) -> float:
    """Return one of the turn rates that can be reached: evenly spaced, straightening, or the wanted one."""
    if index == TURNS - 1:
        return wanted
    if index == TURNS - 2:
        return turn_rate + wp.clamp(-turn_rate, -change, change)
    return turn_rate + 0.5 * change * float(index - 2)


@wp.kernel
def correct(
    commands: wp.array(dtype=wp.vec2),
    velocities: wp.array(dtype=wp.vec2),
    points: wp.array2d(dtype=wp.vec3),
    counts: wp.array(dtype=int),
    limits: Limits,
    corrected: wp.array(dtype=wp.vec2),
):
    """Replace commands after which a robot could no longer stop in time by the nearest after which it can.

    Args:
        commands: wanted forward speed and turn rate.
        velocities: present ones.
        points: to keep off, as ``gather`` wrote them.
        counts: points of each robot.
        limits: numbers.
        corrected: out; commands, the wanted ones where nothing stands against them. Where every command
            trespasses, the one that does so least.
    """
    row = wp.tid()
    count = counts[row]
    wanted = commands[row]
    velocity = velocities[row]
    speed_change = limits.acceleration * limits.period
    turn_change = limits.turn_acceleration * limits.period
    # what can be reached in one period
    v = velocity[0] + wp.clamp(wanted[0] - velocity[0], -speed_change, speed_change)
    w = velocity[1] + wp.clamp(wanted[1] - velocity[1], -turn_change, turn_change)
    v = wp.clamp(v, limits.speed_min, limits.speed_max)
    w = wp.clamp(w, -limits.turn_rate, limits.turn_rate)
    slowest = velocity[0] + wp.clamp(-velocity[0], -speed_change, speed_change)
    best = wanted
    least = least_trespass(row, velocity, wp.vec2(v, w), 1.0e6, count, points, limits)
    if least > 0.0:
        change = float(1.0e6)
        for i in range(SPEEDS):
            for j in range(TURNS):
                speed = v + (slowest - v) * float(i) / float(SPEEDS - 1)
                turn = turn_to_try(j, w, velocity[1], turn_change)
                own = wp.abs(speed - v) / speed_change + wp.abs(turn - w) / turn_change
                if least > 0.0 or own < change:
                    enough = wp.max(least, SLACK)
                    found = least_trespass(row, velocity, wp.vec2(speed, turn), enough, count, points, limits)
                    if found < least or (found == 0.0 and own < change):
                        least = found
                        change = own
                        best = wp.vec2(speed, turn)
        if wanted[0] > CREEP and velocity[0] < CREEP and best[0] < CREEP:
            best = wp.vec2(0.0, turn_out(row, velocity[1], count, points, limits))
    corrected[row] = best
