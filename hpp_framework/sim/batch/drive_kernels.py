"""The drive kernel of the batch simulator: unicycles under limits, with contact."""

import warp as wp

from hpp_framework.sim.batch.kernels import PI, Box, Cell, Geometry, Grid, Robot, cell_at

wp.set_module_options({"enable_backward": False})

RELAXATIONS = wp.constant(3)
TOUCH = wp.constant(1.0e-4)
"""Metres that an obstacle must push a robot for a collision."""
SEARCH = wp.constant(0.1)
"""Metres around a footprint in which obstacles are looked for, again each time it moved that far."""
CLOSE = wp.constant(1.0e-4)
"""Metres to the nearest obstacle below which it is looked for again, whatever rounding did to that number."""


@wp.func
def from_box(point: wp.vec2, box: Box) -> wp.vec3:
    """Unit vector away from the nearest side of a box, and the distance to it, negative inside."""
    x = point[0] - box.center[0]
    y = point[1] - box.center[1]
    ahead = x * box.along[0] + y * box.along[1]
    beside = y * box.along[0] - x * box.along[1]
    outside = wp.vec2(wp.abs(ahead) - box.half[0], wp.abs(beside) - box.half[1])
    away = wp.vec2(wp.max(outside[0], 0.0), wp.max(outside[1], 0.0))
    distance = wp.length(away)
    if distance > 0.0:
        away = away / distance
    else:
        distance = wp.max(outside)
        away = wp.where(outside[0] > outside[1], wp.vec2(1.0, 0.0), wp.vec2(0.0, 1.0))
    ahead = wp.where(ahead < 0.0, -away[0], away[0])
    beside = wp.where(beside < 0.0, -away[1], away[1])
    return wp.vec3(
        ahead * box.along[0] - beside * box.along[1], ahead * box.along[1] + beside * box.along[0], distance
    )


@wp.func
def pushed_out_of(away: wp.vec2, overlap: float, body: wp.vec4) -> wp.vec4:
    """Move a disc out of an obstacle, if it overlaps it.

    Args:
        away: unit vector away from the obstacle.
        overlap: metres, negative for a gap.
        body: x and y of the disc, its gap to what it was not moved out of, how often it was moved.
    """
    if overlap > 0.0:
        return body + wp.vec4(away[0] * overlap, away[1] * overlap, -overlap, 1.0)
    return wp.vec4(body[0], body[1], wp.min(body[2], -overlap), body[3])


@wp.func
def pushed_out_of_cell(index: int, body: wp.vec4, radius: float, geometry: Geometry) -> wp.vec4:
    """Move a disc out of every obstacle of a cell that it overlaps, one after the other."""
    cell = geometry.cells[index]
    after = geometry.cells[index + 1]
    for b in range(cell.first_box, after.first_box):
        nearest = from_box(wp.vec2(body[0], body[1]), geometry.boxes[b])
        body = pushed_out_of(wp.vec2(nearest[0], nearest[1]), radius - nearest[2], body)
    for c in range(cell.first_disc, after.first_disc):
        disc = geometry.discs[c]
        gap = wp.vec2(body[0] - disc[0], body[1] - disc[1])
        distance = wp.max(wp.length(gap), 1.0e-9)
        body = pushed_out_of(gap / distance, radius + disc[2] - distance, body)
    return body


@wp.func
def is_near(cell: Cell, body: wp.vec4, reach: float) -> bool:
    """Return whether the circle around a cell's content comes within reach."""
    dx = cell.center[0] - body[0]
    dy = cell.center[1] - body[1]
    return dx * dx + dy * dy < (cell.radius + reach) * (cell.radius + reach)


@wp.func
def pushed_out(point: wp.vec2, radius: float, grid: Grid, geometry: Geometry) -> wp.vec3:
    """Move a disc out of every obstacle it overlaps.

    Returns:
        Its new x and y, and its gap to the nearest obstacle: at most ``SEARCH``, and 0 if it may
        have been moved into another one.
    """
    reach = radius + SEARCH
    body = wp.vec4(point[0], point[1], SEARCH, 0.0)
    body = pushed_out_of_cell(grid.first_cell + grid.columns * grid.rows, body, radius, geometry)
    low = cell_at(grid, point[0] - reach - grid.spill, point[1] - reach - grid.spill)
    high = cell_at(grid, point[0] + reach + grid.spill, point[1] + reach + grid.spill)
    for row in range(low[1], high[1] + 1):
        for column in range(low[0], high[0] + 1):
            index = grid.first_cell + row * grid.columns + column
            if is_near(geometry.cells[index], body, reach):
                body = pushed_out_of_cell(index, body, radius, geometry)
    gap = wp.max(body[2], 0.0)
    if body[3] > 0.0:
        # out of one obstacle and into no other: it need not be looked again before it moves
        gap = wp.where(body[3] == 1.0 and gap > 0.0, CLOSE, 0.0)
    return wp.vec3(body[0], body[1], gap)


@wp.func
def advance(
    episode: int,
    i: int,
    part: int,
    dt: float,
    robot: Robot,
    commands: wp.array4d(dtype=float),
    poses: wp.array3d(dtype=float),
    velocities: wp.array3d(dtype=float),
    gap: wp.array2d(dtype=float),
):
    """Drive one robot for one substep as if nothing was in its way."""
    theta = poses[episode, i, 2]
    v_old = velocities[episode, i, 0]
    w_old = velocities[episode, i, 1]
    v_goal = wp.clamp(commands[episode, i, part, 0], robot.speed_min, robot.speed_max)
    w_goal = wp.clamp(commands[episode, i, part, 1], -robot.turn_rate, robot.turn_rate)
    v = v_old + wp.clamp(v_goal - v_old, -robot.acceleration * dt, robot.acceleration * dt)
    w = w_old + wp.clamp(w_goal - w_old, -robot.turn_acceleration * dt, robot.turn_acceleration * dt)
    turn = 0.5 * (w_old + w) * dt
    ahead = 0.5 * (v_old + v) * dt
    heading = theta + 0.5 * turn
    poses[episode, i, 0] = poses[episode, i, 0] + ahead * wp.cos(heading)
    poses[episode, i, 1] = poses[episode, i, 1] + ahead * wp.sin(heading)
    poses[episode, i, 2] = theta + turn - 2.0 * PI * wp.floor((theta + turn + PI) / (2.0 * PI))
    velocities[episode, i, 0] = v
    velocities[episode, i, 1] = w
    gap[episode, i] = gap[episode, i] - wp.abs(ahead)


@wp.func
def push_apart(
    episode: int,
    robots: wp.array(dtype=Robot),
    poses: wp.array3d(dtype=float),
    touched: wp.array2d(dtype=wp.bool),
    touched_robot: wp.array2d(dtype=wp.bool),
    gap: wp.array2d(dtype=float),
) -> int:
    """Move robots that overlap apart, the lighter one further, and return whether there were any."""
    moved = int(0)
    for i in range(robots.shape[0]):
        for j in range(i + 1, robots.shape[0]):
            gap_x = poses[episode, i, 0] - poses[episode, j, 0]
            gap_y = poses[episode, i, 1] - poses[episode, j, 1]
            reach = robots[i].radius + robots[j].radius
            distance_sq = gap_x * gap_x + gap_y * gap_y
            if distance_sq < reach * reach and distance_sq > 1.0e-18:
                distance = wp.sqrt(distance_sq)
                overlap = reach - distance
                share = robots[j].mass / (robots[i].mass + robots[j].mass)
                nx = gap_x / distance
                ny = gap_y / distance
                poses[episode, i, 0] = poses[episode, i, 0] + nx * overlap * share
                poses[episode, i, 1] = poses[episode, i, 1] + ny * overlap * share
                poses[episode, j, 0] = poses[episode, j, 0] - nx * overlap * (1.0 - share)
                poses[episode, j, 1] = poses[episode, j, 1] - ny * overlap * (1.0 - share)
                gap[episode, i] = gap[episode, i] - overlap
                gap[episode, j] = gap[episode, j] - overlap
                touched[episode, i] = True
                touched[episode, j] = True
                touched_robot[episode, i] = True
                touched_robot[episode, j] = True
                moved = 1
    return moved


@wp.func
def begin_substep(
    episode: int,
    part: int,
    dt: float,
    commands: wp.array4d(dtype=float),
    robots: wp.array(dtype=Robot),
    poses: wp.array3d(dtype=float),
    velocities: wp.array3d(dtype=float),
    touched: wp.array2d(dtype=wp.bool),
    before: wp.array2d(dtype=wp.vec2),
    gap: wp.array2d(dtype=float),
):
    """Drive all robots for one substep as if nothing was in their way."""
    for i in range(robots.shape[0]):
        touched[episode, i] = False
        before[episode, i] = wp.vec2(poses[episode, i, 0], poses[episode, i, 1])
        advance(episode, i, part, dt, robots[i], commands, poses, velocities, gap)


@wp.func
def push_out_of_obstacles(
    episode: int,
    world: int,
    robots: wp.array(dtype=Robot),
    geometry: Geometry,
    poses: wp.array3d(dtype=float),
    touched: wp.array2d(dtype=wp.bool),
    touched_obstacle: wp.array2d(dtype=wp.bool),
    gap: wp.array2d(dtype=float),
) -> int:
    """Move robots out of obstacles, and return whether there were any."""
    moved = int(0)
    for i in range(robots.shape[0]):
        if gap[episode, i] < CLOSE:
            at = wp.vec2(poses[episode, i, 0], poses[episode, i, 1])
            grid = geometry.grids[robots[i].touched_layer * geometry.worlds + world]
            free = pushed_out(at, robots[i].radius, grid, geometry)
            if wp.length(wp.vec2(free[0], free[1]) - at) > TOUCH:
                touched[episode, i] = True
                touched_obstacle[episode, i] = True
                moved = 1
            poses[episode, i, 0] = free[0]
            poses[episode, i, 1] = free[1]
            gap[episode, i] = free[2]
    return moved


@wp.func
def end_substep(
    episode: int,
    dt: float,
    robots: wp.array(dtype=Robot),
    poses: wp.array3d(dtype=float),
    velocities: wp.array3d(dtype=float),
    touched: wp.array2d(dtype=wp.bool),
    before: wp.array2d(dtype=wp.vec2),
):
    """Leave robots that touched something the speed that contact left them."""
    for i in range(robots.shape[0]):
        if touched[episode, i]:
            theta = poses[episode, i, 2]
            travelled = wp.vec2(poses[episode, i, 0], poses[episode, i, 1]) - before[episode, i]
            along = wp.dot(travelled, wp.vec2(wp.cos(theta), wp.sin(theta))) / dt
            v = velocities[episode, i, 0]
            velocities[episode, i, 0] = wp.clamp(along, wp.min(v, 0.0), wp.max(v, 0.0))


@wp.kernel
def drive(
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
):
    """Drive every robot of one episode for one control period.

    Unicycle under speed and acceleration limits, integrated by the midpoint rule (exact for constant
    acceleration on a straight line). Contact moves discs apart along the normal, so a robot stops head-on and
    slides at an angle; its speed becomes what is left of it along the heading.

    Args:
        start: episode that thread 0 works on.
        commands: (episodes, robots, substeps, 2) wanted speed and turn rate.
        robots: the team.
        geometry: the worlds.
        world_index: world of each episode.
        period: seconds.
        substeps: times that speeds and contact are worked out in a period.
        poses: (episodes, robots, 3).
        velocities: (episodes, robots, 2).
        touched_obstacle: whether a robot touched an obstacle in the period.
        touched_robot: whether it touched another robot in the period.
        touched: scratch: whether it touched anything in the substep.
        before: scratch: place before the substep.
        gap: metres that a robot may move before it can meet an obstacle, at least; kept between periods.
    """
    episode = start + wp.tid()
    world = world_index[episode]
    count = robots.shape[0]
    dt = period / float(substeps)
    for i in range(count):
        touched_obstacle[episode, i] = False
        touched_robot[episode, i] = False
    for part in range(substeps):
        begin_substep(episode, part, dt, commands, robots, poses, velocities, touched, before, gap)
        for _relaxation in range(RELAXATIONS):
            moved = push_apart(episode, robots, poses, touched, touched_robot, gap)
            if push_out_of_obstacles(episode, world, robots, geometry, poses, touched, touched_obstacle, gap):
                moved = 1
            if moved == 0:
                break
        end_substep(episode, dt, robots, poses, velocities, touched, before)
