"""Warp kernel of the separation layer.

Annotations are the types of Warp, which compiles this source.
"""

# no "from __future__ import annotations": Warp reads the annotations as they are

from hpp_framework.utils.kernels import wp

wp.set_module_options({"enable_backward": False})

PI = wp.constant(3.14159265358979)
STEP = wp.constant(0.1)
"""Seconds between the places of a foreseen motion."""
NEARER = wp.constant(0.001)
"""Metres by which robots that are too near may come nearer still."""
SPEEDS = wp.constant(9)
"""Speeds that are tried, from the wanted one to the slowest that can be reached."""


@wp.struct
class Self:
    """Numbers of the robot that drives."""

    acceleration: float
    turn_acceleration: float
    turn_rate: float
    speed_min: float
    speed_max: float
    period: float


@wp.struct
class Other:
    """A teammate in the robot's frame: place and velocity, what of it is unsure, how far to keep off."""

    place: wp.vec2
    velocity: wp.vec2
    deceleration: float
    turn: float
    off: float
    apart: float


@wp.func
def nearest_after(other: Other, place: wp.vec2, time: float, period: float, turns: float) -> wp.vec2:
    """Return the nearest to a place that a teammate can be that goes on for a period and then brakes.

    It may turn meanwhile: it comes straight along the chord of an arc.

    Args:
        other: the teammate.
        place: that it may come near.
        time: seconds from now.
        period: seconds for which it goes on.
        turns: rad/s^2 at which it may turn.
    """
    pace = wp.length(other.velocity)
    braking = wp.clamp(time - period, 0.0, pace / wp.max(other.deceleration, 1.0e-3))
    distance = pace * wp.min(time, period) + braking * (pace - 0.5 * braking * other.deceleration)
    ahead = wp.atan2(other.velocity[1], other.velocity[0]) + 0.5 * time * other.turn
    gap = place - other.place
    aside = wp.atan2(gap[1], gap[0]) - ahead
    aside -= 2.0 * PI * wp.floor((aside + PI) / (2.0 * PI))
    most = other.off + 0.25 * turns * time * time
    heading = ahead + wp.clamp(aside, -most, most)
    return other.place + wp.min(distance, wp.length(gap)) * wp.vec2(wp.cos(heading), wp.sin(heading))


@wp.func
def touches(
    row: int,
    velocity: wp.vec2,
    command: wp.vec2,
    turn_rate: float,
    own: Self,
    agent: int,
    others: wp.array2d(dtype=Other),
) -> bool:
    """Return whether a command for one period and a full stop after it may end in a touch.

    Args:
        row: episode.
        velocity: now.
        command: for one period.
        turn_rate: commanded while braking.
        own: numbers of the robot.
        agent: its index.
        others: all robots of the team.
    """
    wanted = command
    v = velocity[0]
    w = velocity[1]
    place = wp.vec2(0.0, 0.0)
    heading = float(0.0)
    time = float(0.0)
    moving = bool(True)
    touched = bool(False)
    while moving:
        v_next = v + wp.clamp(wanted[0] - v, -own.acceleration * STEP, own.acceleration * STEP)
        w_next = w + wp.clamp(wanted[1] - w, -own.turn_acceleration * STEP, own.turn_acceleration * STEP)
        ahead = 0.5 * (v + v_next) * STEP
        turn = 0.5 * (w + w_next) * STEP
        place += ahead * wp.vec2(wp.cos(heading + 0.5 * turn), wp.sin(heading + 0.5 * turn))
        heading += turn
        v = v_next
        w = w_next
        time += STEP
        if time > own.period - 0.5 * STEP:
            wanted = wp.vec2(0.0, turn_rate)
            moving = wp.abs(v) > 0.0
        for robot in range(others.shape[1]):
            if robot != agent:
                other = others[row, robot]
                gap = place - nearest_after(other, place, time, own.period, own.turn_acceleration)
                touched = touched or wp.length(gap) < other.apart
        moving = moving and not touched
    return touched


@wp.kernel
def slow_down(
    agent: int,
    commands: wp.array(dtype=wp.vec2),
    velocities: wp.array(dtype=wp.vec2),
    poses: wp.array2d(dtype=wp.vec3),
    motions: wp.array2d(dtype=wp.vec4),
    keeps: wp.array2d(dtype=float),
    decelerations: wp.array(dtype=float),
    own: Self,
    others: wp.array2d(dtype=Other),
    slowed: wp.array(dtype=wp.vec2),
):
    """Replace speeds from which a robot could touch a teammate by the highest from which it cannot.

    Args:
        agent: index of the robot.
        commands: wanted forward speed and turn rate.
        velocities: present ones.
        poses: of the team, world frame.
        motions: speed, turn rate, what the heading may be off, and what a position may be off.
        keeps: metres that middles must keep apart, if all was sure.
        decelerations: of the team.
        own: numbers of the robot.
        others: scratch: the team in the robot's frame.
        slowed: out; commands.
    """
    row = wp.tid()
    here = poses[row, agent]
    cos = wp.cos(here[2])
    sin = wp.sin(here[2])
    for robot in range(poses.shape[1]):
        there = poses[row, robot]
        motion = motions[row, robot]
        x = there[0] - here[0]
        y = there[1] - here[1]
        heading = there[2] - here[2]
        other = Other()
        other.place = wp.vec2(cos * x + sin * y, cos * y - sin * x)
        other.velocity = motion[0] * wp.vec2(wp.cos(heading), wp.sin(heading))
        other.deceleration = decelerations[robot]
        other.turn = motion[1]
        other.off = motion[2]
        # who is too near already may stay, and leave
        other.apart = wp.min(keeps[row, robot] + motion[3], wp.length(other.place) - NEARER)
        others[row, robot] = other
    wanted = commands[row]
    velocity = velocities[row]
    speed_change = own.acceleration * own.period
    turn_change = own.turn_acceleration * own.period
    v = velocity[0] + wp.clamp(wanted[0] - velocity[0], -speed_change, speed_change)
    w = velocity[1] + wp.clamp(wanted[1] - velocity[1], -turn_change, turn_change)
    v = wp.clamp(v, own.speed_min, own.speed_max)
    w = wp.clamp(w, -own.turn_rate, own.turn_rate)
    slowest = velocity[0] + wp.clamp(-velocity[0], -speed_change, speed_change)
    best = wanted
    searching = bool(True)
    for i in range(SPEEDS):
        if searching:
            speed = v + (slowest - v) * float(i) / float(SPEEDS - 1)
            command = wp.vec2(speed, w)
            if i > 0:
                best = wp.vec2(wp.min(wanted[0], speed), wanted[1])
            if i == SPEEDS - 1:
                # a full stop: a speed that is reached goes on if the next command comes late
                best = wp.vec2(wp.min(wanted[0], 0.0), wanted[1])
            if not touches(row, velocity, command, w, own, agent, others) or not touches(
                row, velocity, command, 0.0, own, agent, others
            ):
                searching = bool(False)
    slowed[row] = best
