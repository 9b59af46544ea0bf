"""People and moving obstacles: what the kernels know of them, how people walk, and where doors are.

People walk by the social forces of Moussaid, Helbing, Garnier, Johansson, Combe and Theraulaz, "Experimental
study of the behavioural mechanisms underlying self-organization in human crowds", Proc. R. Soc. B 276 (2009),
with the constants that they fitted to trajectories of pedestrians. Three things are added: distances to
walls count from the edge of the body, so that people do not brush along them; speed is at most 1.3 times the
preferred one (Helbing and Molnar 1995); and a person that gets nowhere for some seconds turns back.
"""

import warp as wp

from hpp_framework.sim.batch.drive_kernels import from_box
from hpp_framework.sim.batch.kernels import Box, Robot, bearing

wp.set_module_options({"enable_backward": False})

RELAXATION = wp.constant(0.54)
"""Seconds in which a person takes up its preferred velocity (tau)."""
STRENGTH = wp.constant(4.5)
"""Of the force between two people, m/s^2 (A)."""
VELOCITY_WEIGHT = wp.constant(2.0)
"""Of the relative velocity against the direction to the other (lambda), s/m."""
RANGE = wp.constant(0.35)
"""Metres that the force reaches for each unit of that sum (gamma)."""
TURNING = wp.constant(2.0)
"""Angular interaction range of turning aside (n)."""
SLOWING = wp.constant(3.0)
"""Angular interaction range of slowing down (n')."""
SIDE = wp.constant(0.005)
"""Radians by which people prefer one side (epsilon)."""
WALL_STRENGTH = wp.constant(3.0)
"""Of the force of a wall that is touched, m/s^2 (a)."""
WALL_RANGE = wp.constant(0.1)
"""Metres over which it falls to 1 / e (b)."""
FASTEST = wp.constant(1.3)
"""Times the preferred speed."""

WALL_REACH = wp.constant(0.3)
"""Metres from the edge of a body within which walls are felt; the force is 0.15 m/s^2 there."""
SLACK = wp.constant(0.07)
"""Metres by which a distance between the middles of cells may be too large: bodies keep it off walls."""
NEARBY = wp.constant(2.25)
"""Square metres within which others are felt; who does not come nearer has 6 cm/s^2 there."""
FARTHEST = wp.constant(16.0)
"""Square metres within which others are felt who come nearer."""
FAINT = wp.constant(16.0)
"""Square of the distance, in ranges of the force, from which others are not felt: 8 cm/s^2 there."""
SPARE = wp.constant(0.2)
"""Metres added to what people and robots can drive in a period, to tell who may meet whom in it."""
ARRIVED = wp.constant(0.4)
"""Metres from a place of its route at which a person turns to the next."""
HALT = wp.constant(0.05)
"""Metres from the last place at which it stands."""
SLOW = wp.constant(0.15)
"""Share of its speed below which a person gets nowhere."""
PATIENCE = wp.constant(4.0)
"""Seconds of that after which it turns back."""
FACING = wp.constant(0.1)
"""m/s from which a person looks where it goes."""
DRIVING = wp.constant(0.05)
"""m/s from which a robot that touches a person counts: those that stand are walked into."""
GRAZE = wp.constant(1.0e-4)
"""Metres of overlap that are a touch."""


@wp.struct
class Walker:
    """One person of a world; its route is ``points`` places from ``first_point`` on."""

    radius: float
    height: float
    speed: float
    first_point: int
    points: int
    loop: int


@wp.struct
class Mover:
    """One moving obstacle: a box, or a disc if its radius is positive; its timetable is a run of ``keys``."""

    half: wp.vec2
    radius: float
    along: wp.vec2
    base: float
    top: float
    first_key: int
    keys: int
    loop: int


@wp.struct
class Field:
    """Distances to the nearest obstacle on a grid over a room; row by row, at the middles of cells."""

    origin: wp.vec2
    cells_per_metre: float
    columns: int
    rows: int
    first: int


@wp.struct
class Crowds:
    """What moves in all worlds of a pool; that of world ``w`` begins at ``first_...[w]``."""

    first_walker: wp.array(dtype=int)
    walkers: wp.array(dtype=Walker)
    points: wp.array(dtype=wp.vec2)
    first_mover: wp.array(dtype=int)
    movers: wp.array(dtype=Mover)
    keys: wp.array(dtype=wp.vec3)
    fields: wp.array(dtype=Field)
    """Of the rooms."""
    distances: wp.array(dtype=float)


@wp.struct
class Walk:
    """The people of all episodes; see ``People``."""

    world: wp.array(dtype=int)
    time: wp.array(dtype=wp.int64)
    poses: wp.array2d(dtype=wp.vec3)
    velocities: wp.array2d(dtype=wp.vec2)
    progress: wp.array2d(dtype=wp.vec3)
    forces: wp.array2d(dtype=wp.vec2)
    """Scratch, m/s^2."""
    is_near: wp.array2d(dtype=wp.bool)
    """Whether a person may meet a robot or obstacle in this period; all others have walked it already."""
    near: wp.array(dtype=int)
    """How many may."""


@wp.func
def place_of(mover: Mover, crowds: Crowds, time: float) -> wp.vec2:
    """Return where the middle of a moving obstacle is at a time in seconds."""
    last = mover.first_key + mover.keys - 1
    period = crowds.keys[last][0]
    if mover.loop == 1 and period > 0.0:
        time = time - period * wp.floor(time / period)
    after = mover.first_key
    while after < last and crowds.keys[after][0] <= time:
        after += 1
    before = wp.max(after - 1, mover.first_key)
    start = crowds.keys[before]
    end = crowds.keys[after]
    share = wp.clamp((time - start[0]) / wp.max(end[0] - start[0], 1.0e-6), 0.0, 1.0)
    return wp.vec2(start[1] + share * (end[1] - start[1]), start[2] + share * (end[2] - start[2]))


@wp.func
def from_mover(point: wp.vec2, mover: Mover, place: wp.vec2) -> wp.vec3:
    """Unit vector away from a moving obstacle, and the distance to it, negative inside."""
    if mover.radius > 0.0:
        apart = point - place
        distance = wp.max(wp.length(apart), 1.0e-9)
        return wp.vec3(apart[0] / distance, apart[1] / distance, distance - mover.radius)
    box = Box()
    box.center = place
    box.along = mover.along
    box.half = mover.half
    return from_box(point, box)


@wp.func
def wall_at(point: wp.vec2, field: Field, crowds: Crowds) -> wp.vec3:
    """Vector away from walls, at most 1 long, and the distance to the nearest: bilinear between cells."""
    place = (point - field.origin) * field.cells_per_metre
    column = wp.clamp(place[0] - 0.5, 0.0, float(field.columns) - 1.001)
    row = wp.clamp(place[1] - 0.5, 0.0, float(field.rows) - 1.001)
    left = int(column)
    low = int(row)
    x = column - float(left)
    y = row - float(low)
    first = field.first + low * field.columns + left
    near = crowds.distances[first]
    right = crowds.distances[first + 1] - near
    above = crowds.distances[first + field.columns]
    above_right = crowds.distances[first + field.columns + 1] - above
    along = right + y * (above_right - right)
    up = (above + x * above_right) - (near + x * right)
    steepness = wp.max(wp.sqrt(along * along + up * up), 1.0 / field.cells_per_metre)
    return wp.vec3(along / steepness, up / steepness, near + x * right + y * up)


@wp.func
def may_feel(apart: wp.vec2, distance_sq: float, relative: wp.vec2) -> bool:
    """Return whether there may be a force worth computing: who is far is felt if it comes nearer."""
    return distance_sq < NEARBY or (distance_sq < FARTHEST and wp.dot(relative, apart) > 0.0)


@wp.func
def away_from(apart: wp.vec2, distance_sq: float, relative: wp.vec2) -> wp.vec2:
    """Return the force of another on a person, m/s^2; that on the other is the opposite.

    Args:
        apart: from the person to the other, metres.
        distance_sq: its length squared.
        relative: velocity of the person less that of the other, m/s.
    """
    none = wp.vec2(0.0, 0.0)
    if distance_sq < 1.0e-6:
        return none
    distance = wp.sqrt(distance_sq)
    # the interaction vector D = lambda v + e times the distance: few divisions, which wait for each other
    scaled = VELOCITY_WEIGHT * distance * relative + apart
    length_sq = wp.dot(scaled, scaled)
    if distance_sq * distance_sq > FAINT * RANGE * RANGE * length_sq:
        return none
    along = wp.dot(scaled, apart)
    # who passes far aside is not felt: (n B theta)^2 is 3.8 and more
    if length_sq > 9.0 * distance_sq and (along < 0.0 or along * along < 0.36 * length_sq * distance_sq):
        return none
    length = wp.sqrt(length_sq)
    angle = bearing(along, scaled[0] * apart[1] - scaled[1] * apart[0]) + SIDE
    side = wp.where(angle < 0.0, -STRENGTH, STRENGTH)
    spread = RANGE * angle * (length / distance)
    inverse = 1.0 / length
    near = distance_sq * inverse / RANGE
    ahead = -STRENGTH * wp.exp(-near - SLOWING * SLOWING * spread * spread) * inverse
    aside = -side * wp.exp(-near - TURNING * TURNING * spread * spread) * inverse
    return wp.vec2(ahead * scaled[0] - aside * scaled[1], ahead * scaled[1] + aside * scaled[0])


@wp.func
def from_wall(away: wp.vec2, gap: float) -> wp.vec2:
    """Return the force of a wall, m/s^2, given the direction from it and the metres to the body's edge."""
    return WALL_STRENGTH * wp.exp(-wp.max(gap, 0.0) / WALL_RANGE) * away


@wp.func
def follow_route(
    episode: int, p: int, walker: Walker, at: wp.vec2, v: wp.vec2, dt: float, crowds: Crowds, walk: Walk
) -> wp.vec2:
    """Turn to the next place of the route, or back where it is blocked, and return the wanted velocity."""
    progress = walk.progress[episode, p]
    following = int(progress[0])
    direction = int(progress[1])
    tried = progress[2]
    apart = crowds.points[walker.first_point + following] - at
    distance = wp.length(apart)
    final = walker.loop == 0 and following == walker.points - 1
    if not final and distance < ARRIVED:
        tried = 0.0
        if walker.loop == 0 and following == 0:
            # back at the start, it tries again
            direction = 1
        following = (following + direction + walker.points) % walker.points
        final = walker.loop == 0 and following == walker.points - 1
        apart = crowds.points[walker.first_point + following] - at
        distance = wp.length(apart)
    wanted = wp.vec2(0.0, 0.0)
    if walker.speed > 0.0 and walker.points > 1 and not (final and distance < HALT):
        pace = wp.where(final, wp.min(walker.speed, distance / RELAXATION), walker.speed)
        wanted = apart * (pace / wp.max(distance, 1.0e-6))
        slow = SLOW * walker.speed
        tried = wp.where(wp.dot(v, v) < slow * slow, tried + dt, wp.max(tried - dt, 0.0))
        if final and distance < ARRIVED:
            tried = 0.0
        if tried > PATIENCE:
            tried = 0.0
            direction = -direction
            following = (following + direction + walker.points) % walker.points
    walk.progress[episode, p] = wp.vec3(float(following), float(direction), tried)
    return wanted


@wp.func
def planar(pose: wp.vec3) -> wp.vec2:
    """Return x and y of a pose."""
    return wp.vec2(pose[0], pose[1])


@wp.func
def shift(episode: int, p: int, direction: wp.vec2, distance: float, walk: Walk):
    """Move a person."""
    pose = walk.poses[episode, p]
    walk.poses[episode, p] = wp.vec3(
        pose[0] + direction[0] * distance, pose[1] + direction[1] * distance, pose[2]
    )


@wp.func
def feel_people(episode: int, first: int, count: int, crowds: Crowds, walk: Walk):
    """Add the forces of people on each other, and move those apart that overlap; who stands stays."""
    for p in range(count):
        at = planar(walk.poses[episode, p])
        v = walk.velocities[episode, p]
        force = walk.forces[episode, p]
        for q in range(p + 1, count):
            apart = planar(walk.poses[episode, q]) - at
            distance_sq = wp.dot(apart, apart)
            relative = v - walk.velocities[episode, q]
            if may_feel(apart, distance_sq, relative):
                felt = away_from(apart, distance_sq, relative)
                force += felt
                walk.forces[episode, q] = walk.forces[episode, q] - felt
                reach = crowds.walkers[first + p].radius + crowds.walkers[first + q].radius
                if distance_sq < reach * reach and distance_sq > 1.0e-12:
                    distance = wp.sqrt(distance_sq)
                    share = wp.where(crowds.walkers[first + q].speed > 0.0, 0.5, 1.0)
                    share = wp.where(crowds.walkers[first + p].speed > 0.0, share, 0.0)
                    rest = wp.where(crowds.walkers[first + q].speed > 0.0, 1.0 - share, 0.0)
                    shift(episode, p, -apart / distance, (reach - distance) * share, walk)
                    shift(episode, q, apart / distance, (reach - distance) * rest, walk)
        walk.forces[episode, p] = force


@wp.func
def feel_robots(
    episode: int,
    first: int,
    count: int,
    period: float,
    robots: wp.array(dtype=Robot),
    robot_poses: wp.array3d(dtype=float),
    robot_velocities: wp.array3d(dtype=float),
    crowds: Crowds,
    walk: Walk,
):
    """Add the forces of robots on people, and mark people that a robot may meet in this period."""
    for i in range(robots.shape[0]):
        theta = robot_poses[episode, i, 2]
        v = robot_velocities[episode, i, 0] * wp.vec2(wp.cos(theta), wp.sin(theta))
        place = wp.vec2(robot_poses[episode, i, 0], robot_poses[episode, i, 1])
        fastest = wp.max(robots[i].speed_max, -robots[i].speed_min)
        for p in range(count):
            apart = place - planar(walk.poses[episode, p])
            distance_sq = wp.dot(apart, apart)
            relative = walk.velocities[episode, p] - v
            if may_feel(apart, distance_sq, relative):
                felt = away_from(apart, distance_sq, relative)
                walk.forces[episode, p] = walk.forces[episode, p] + felt
            walker = crowds.walkers[first + p]
            reach = robots[i].radius + walker.radius + period * (fastest + FASTEST * walker.speed) + SPARE
            if distance_sq < reach * reach:
                walk.is_near[episode, p] = True


@wp.func
def steer(
    episode: int,
    world: int,
    period: float,
    substep: float,
    robots: wp.array(dtype=Robot),
    robot_poses: wp.array3d(dtype=float),
    robot_velocities: wp.array3d(dtype=float),
    crowds: Crowds,
    walk: Walk,
):
    """Choose the velocity of every person of an episode for one control period.

    People who can meet nothing in it walk it at once; ``move_people`` moves the others.

    Args:
        episode: whose people.
        world: its room.
        period: seconds.
        substep: seconds of a substep, the unit of the episode's time.
        robots: the team.
        robot_poses: (episodes, robots, 3).
        robot_velocities: (episodes, robots, 2).
        crowds: what moves in them.
        walk: the people.
    """
    own = walk.world[episode]
    first = crowds.first_walker[own]
    count = crowds.first_walker[own + 1] - first
    first_mover = crowds.first_mover[own]
    last_mover = crowds.first_mover[own + 1]
    now = float(walk.time[episode]) * substep
    for p in range(count):
        at = planar(walk.poses[episode, p])
        v = walk.velocities[episode, p]
        wanted = follow_route(episode, p, crowds.walkers[first + p], at, v, period, crowds, walk)
        walk.forces[episode, p] = (wanted - v) / RELAXATION
        walk.is_near[episode, p] = last_mover > first_mover
    feel_people(episode, first, count, crowds, walk)
    feel_robots(episode, first, count, period, robots, robot_poses, robot_velocities, crowds, walk)
    near = int(0)
    field = crowds.fields[world]
    for p in range(count):
        walker = crowds.walkers[first + p]
        pose = walk.poses[episode, p]
        at = planar(pose)
        force = walk.forces[episode, p]
        wall = wall_at(at, field, crowds)
        room = wall[2] - SLACK - walker.radius
        if wall[2] < walker.radius + WALL_REACH:
            force += from_wall(planar(wall), wall[2] - walker.radius)
        for m in range(first_mover, last_mover):
            mover = crowds.movers[m]
            if mover.base < walker.height:
                wall = from_mover(at, mover, place_of(mover, crowds, now))
                force += from_wall(planar(wall), wall[2] - walker.radius)
        v = walk.velocities[episode, p] + period * force
        fastest = FASTEST * walker.speed
        speed = wp.length(v)
        if speed > fastest:
            v = v * (fastest / speed)
            speed = fastest
        walk.velocities[episode, p] = v
        if walk.is_near[episode, p] or room < speed * period:
            walk.is_near[episode, p] = True
            near += 1
        else:
            heading = wp.where(speed > FACING, bearing(v[0], v[1]), pose[2])
            walk.poses[episode, p] = wp.vec3(at[0] + period * v[0], at[1] + period * v[1], heading)
    walk.near[episode] = near


@wp.func
def out_of_robots(
    episode: int,
    at: wp.vec2,
    radius: float,
    robots: wp.array(dtype=Robot),
    robot_poses: wp.array3d(dtype=float),
) -> wp.vec2:
    """Move a person out of the robots that it overlaps."""
    for i in range(robots.shape[0]):
        apart = at - wp.vec2(robot_poses[episode, i, 0], robot_poses[episode, i, 1])
        reach = radius + robots[i].radius
        distance_sq = wp.dot(apart, apart)
        if distance_sq < reach * reach and distance_sq > 1.0e-12:
            at = at + apart * (reach / wp.sqrt(distance_sq) - 1.0)
    return at


@wp.func
def overlaps_robot(
    episode: int,
    at: wp.vec2,
    radius: float,
    robots: wp.array(dtype=Robot),
    robot_poses: wp.array3d(dtype=float),
) -> bool:
    """Return whether a person is pressed into a robot."""
    pressed = bool(False)
    for i in range(robots.shape[0]):
        apart = at - wp.vec2(robot_poses[episode, i, 0], robot_poses[episode, i, 1])
        if wp.length(apart) < radius + robots[i].radius - GRAZE:
            pressed = True
    return pressed


@wp.func
def move_people(
    episode: int,
    world: int,
    dt: float,
    robots: wp.array(dtype=Robot),
    robot_poses: wp.array3d(dtype=float),
    crowds: Crowds,
    walk: Walk,
):
    """Let people who may meet something walk for one substep; robots, obstacles and doors stop them.

    Moving obstacles are where they are at the end of the substep.
    """
    walk.time[episode] = walk.time[episode] + wp.int64(1)
    if walk.near[episode] == 0:
        return
    own = walk.world[episode]
    first = crowds.first_walker[own]
    now = float(walk.time[episode]) * dt
    field = crowds.fields[world]
    for p in range(crowds.first_walker[own + 1] - first):
        if walk.is_near[episode, p]:
            walker = crowds.walkers[first + p]
            before = planar(walk.poses[episode, p])
            v = walk.velocities[episode, p]
            free = before + dt * v
            at = out_of_robots(episode, free, walker.radius, robots, robot_poses)
            for m in range(crowds.first_mover[own], crowds.first_mover[own + 1]):
                mover = crowds.movers[m]
                if mover.base < walker.height:
                    wall = from_mover(at, mover, place_of(mover, crowds, now))
                    if wall[2] < walker.radius:
                        at = at + (walker.radius - wall[2]) * planar(wall)
            for _corner in range(2):
                wall = wall_at(at, field, crowds)
                at = at + wp.max(walker.radius + SLACK - wall[2], 0.0) * planar(wall)
            if overlaps_robot(episode, at, walker.radius, robots, robot_poses) and not overlaps_robot(
                episode, before, walker.radius, robots, robot_poses
            ):
                # between a robot and something else it stays where it was
                at = before
            if at[0] != free[0] or at[1] != free[1]:
                # what is left of its speed; being pushed makes none
                actual = (at - before) / dt
                v = actual * wp.min(1.0, wp.length(v) / wp.max(wp.length(actual), 1.0e-9))
                walk.velocities[episode, p] = v
            heading = wp.where(wp.dot(v, v) > FACING * FACING, bearing(v[0], v[1]), walk.poses[episode, p][2])
            walk.poses[episode, p] = wp.vec3(at[0], at[1], heading)


@wp.kernel
def walk_alone(
    is_first: int,
    period: float,
    substeps: int,
    robots: wp.array(dtype=Robot),
    robot_poses: wp.array3d(dtype=float),
    robot_velocities: wp.array3d(dtype=float),
    crowds: Crowds,
    walk: Walk,
):
    """Let the people of one episode walk for one substep, for simulators that move robots themselves.

    Args:
        is_first: whether the substep begins a control period, 1 or 0.
        period: seconds of a control period.
        substeps: of it.
        robots: the team; only radii are read.
        robot_poses: (1, robots, 3).
        robot_velocities: (1, robots, 2).
        crowds: what moves in it.
        walk: the people.
    """
    dt = period / float(substeps)
    if is_first == 1:
        steer(0, 0, period, dt, robots, robot_poses, robot_velocities, crowds, walk)
    move_people(0, 0, dt, robots, robot_poses, crowds, walk)
