"""The lidar kernel of the batch simulator: angular rasterisation, front to back.

Each obstacle touches only the beams between its two ends and keeps the largest inverse range, which is linear
in a beam's direction cosines. The largest of several numbers does not depend on their order, so a scan has
the same bits whichever way the grid is walked and whatever is left out because something nearer hides it.
"""

import warp as wp

from hpp_framework.sim.batch.kernels import (
    LANES,
    PI,
    ROUGHLY,
    Box,
    Geometry,
    Grid,
    Lanes,
    Robot,
    bearing,
    cell_at,
    rough_bearing,
)

wp.set_module_options({"enable_backward": False})

SLACK = wp.constant(1.0e-4)
"""Share of the angle between two beams that segments are widened by, so that no beam slips between two."""
EDGE = wp.constant(1.0e-3)
"""Metres that circles around boxes are widened by against rounding."""
NEAR = wp.constant(2)
"""Rings of cells whose boxes are entered without asking first; they are seldom hidden."""
BLIND = wp.constant(1.0e9)
"""Inverse range of lanes that have no beam: nothing is nearer, so nothing is ever looked for in them."""


@wp.struct
class Rays:
    """Beams as blocks of eight, in the frame of beam 0."""

    x: wp.array2d(dtype=Lanes)
    y: wp.array2d(dtype=Lanes)
    windows: wp.array2d(dtype=Lanes)
    """(9, 9) ones from a first lane up to before a last one, zeros elsewhere."""


@wp.struct
class Eye:
    """The lidar of one robot of one episode; x axis along beam 0."""

    agent: int
    row: int
    x: float
    y: float
    cos: float
    sin: float


@wp.func
def turned(eye: Eye, x: float, y: float) -> wp.vec2:
    """Turn a vector of the world frame into the lidar's."""
    return wp.vec2(eye.cos * x + eye.sin * y, eye.cos * y - eye.sin * x)


@wp.func
def past_last_beam(point: wp.vec2, robot: Robot) -> float:
    """Metres that a point of the lidar's frame lies to the left of the line along its last beam."""
    return robot.last_beam[0] * point[1] - robot.last_beam[1] * point[0]


@wp.func
def is_out_of_view(right: bool, left: bool, robot: Robot) -> bool:
    """Return whether what lies right of the first beam's line, left of the last's, or both, is unseen."""
    # up to half a turn, either side will do; beyond it, only the wedge between both is unseen
    return wp.where(robot.field_of_view > PI, right and left, right or left)


@wp.func
def mark_line(first: int, last: int, slope: wp.vec2, eye: Eye, rays: Rays, scans: wp.array2d(dtype=Lanes)):
    """Enter a line, seen by beams ``first`` to ``last``, whose inverse range is ``slope . direction``."""
    if last < first:
        return
    for block in range(first // LANES, last // LANES + 1):
        low = wp.max(first - block * LANES, 0)
        high = wp.min(last + 1 - block * LANES, LANES)
        inverse = slope[0] * rays.x[eye.agent, block] + slope[1] * rays.y[eye.agent, block]
        inverse = wp.cw_mul(inverse, rays.windows[low, high])
        scans[eye.row, block] = wp.max(scans[eye.row, block], inverse)


@wp.func
def mark_side(
    low: float, high: float, slope: wp.vec2, eye: Eye, robot: Robot, rays: Rays,
    scans: wp.array2d(dtype=Lanes),
):  # fmt: skip
    """Enter a line into the beams between two angles, given in beams."""
    mark_line(int(wp.ceil(low - SLACK)), wp.min(int(high + SLACK), robot.beams - 1), slope, eye, rays, scans)
    lap = 2.0 * PI * robot.beams_per_radian
    if high + SLACK >= lap:
        first = wp.max(int(wp.ceil(low - lap - SLACK)), 0)
        mark_line(first, wp.min(int(high + SLACK - lap), robot.beams - 1), slope, eye, rays, scans)


@wp.func
def beams_between(low: float, high: float, robot: Robot) -> float:
    """Return the beams from one bearing to another, less than half a turn further on."""
    span = high - low
    span = wp.where(span < 0.0, span + 2.0 * PI, span)
    # edge-on, rounding may turn the ends around
    return wp.where(span > 1.5 * PI, 0.0, span * robot.beams_per_radian)


@wp.func
def mark_box(box: Box, eye: Eye, robot: Robot, rays: Rays, scans: wp.array2d(dtype=Lanes)):
    """Enter the sides of a box that the eye is outside of, two at most."""
    center = turned(eye, box.center[0] - eye.x, box.center[1] - eye.y)
    radius = box.half[0] + box.half[1] + EDGE
    if is_out_of_view(center[1] < -radius, past_last_beam(center, robot) > radius, robot):
        return
    along = turned(eye, box.along[0], box.along[1])
    across = wp.vec2(-along[1], along[0])
    # axes are turned towards the eye
    x = wp.dot(center, along)
    y = wp.dot(center, across)
    is_behind = x > 0.0
    is_left = y > 0.0
    along = wp.where(is_behind, -along, along)
    across = wp.where(is_left, -across, across)
    ahead = wp.abs(x) - box.half[0]
    beside = wp.abs(y) - box.half[1]
    corner = center + box.half[0] * along + box.half[1] * across
    middle = bearing(corner[0], corner[1])
    end = corner - 2.0 * box.half[1] * across
    front_end = bearing(end[0], end[1])
    end = corner - 2.0 * box.half[0] * along
    side_end = bearing(end[0], end[1])
    # which of the two sides comes first, counter-clockwise
    side_first = is_behind == is_left
    front = along / -ahead
    side = across / -beside
    is_front = ahead > 1.0e-6
    is_side = beside > 1.0e-6
    low = wp.where(side_first, side_end, front_end)
    high = wp.where(side_first, front_end, side_end)
    is_first = wp.where(side_first, is_side, is_front)
    is_second = wp.where(side_first, is_front, is_side)
    low = wp.where(is_first, low, middle)
    start = wp.where(low < 0.0, low + 2.0 * PI, low) * robot.beams_per_radian
    between = start + beams_between(low, middle, robot)
    if is_first:
        mark_side(start, between, wp.where(side_first, side, front), eye, robot, rays, scans)
    if is_second:
        stop = between + beams_between(middle, high, robot)
        mark_side(between, stop, wp.where(side_first, front, side), eye, robot, rays, scans)


@wp.func
def mark_arc(
    low: float, high: float, center: wp.vec2, outside: float, eye: Eye, robot: Robot, rays: Rays,
    scans: wp.array2d(dtype=Lanes),
):  # fmt: skip
    """Enter a disc into the beams between two angles, given in beams."""
    for beam in range(int(wp.ceil(low)), wp.min(int(high), robot.beams - 1) + 1):
        block = beam // LANES
        lane = beam - block * LANES
        along = center[0] * rays.x[eye.agent, block][lane] + center[1] * rays.y[eye.agent, block][lane]
        root = along * along - outside
        if root > 0.0 and along > 0.0:
            inverse = (along + wp.sqrt(root)) / outside
            if inverse > scans[eye.row, block][lane]:
                scans[eye.row, block][lane] = inverse


@wp.func
def mark_disc(
    x: float, y: float, radius: float, eye: Eye, robot: Robot, rays: Rays, scans: wp.array2d(dtype=Lanes)
):
    """Enter a disc at a place in the world."""
    center = turned(eye, x - eye.x, y - eye.y)
    outside = wp.dot(center, center) - radius * radius
    reach = robot.max_range + radius
    if outside <= 0.0 or outside > reach * reach:
        return
    half = bearing(wp.sqrt(outside), radius)
    low = bearing(center[0], center[1]) - half
    low = wp.where(low < 0.0, low + 2.0 * PI, low) * robot.beams_per_radian
    high = low + 2.0 * half * robot.beams_per_radian
    mark_arc(low, high, center, outside, eye, robot, rays, scans)
    lap = 2.0 * PI * robot.beams_per_radian
    if high >= lap:
        mark_arc(0.0, high - lap, center, outside, eye, robot, rays, scans)


@wp.func
def lesser(a: float, b: float) -> float:
    """Return the smaller of two numbers; ``wp.min`` minds NaN, which takes three times as long."""
    return wp.where(a < b, a, b)


@wp.func
def least(lanes: Lanes) -> float:
    """Return the smallest of eight numbers, in three steps."""
    first = lesser(lesser(lanes[0], lanes[4]), lesser(lanes[2], lanes[6]))
    second = lesser(lesser(lanes[1], lanes[5]), lesser(lanes[3], lanes[7]))
    return lesser(first, second)


@wp.func
def is_farther(first: int, last: int, distance: float, eye: Eye, scans: wp.array2d(dtype=Lanes)) -> bool:
    """Return whether a beam from ``first`` to ``last``, or of their blocks, reads more than a distance."""
    smallest = Lanes(BLIND)
    end = last // LANES
    # two at a time: fewer turns whose number the processor has to guess
    for block in range(first // LANES, end + 1, 2):
        smallest = wp.min(smallest, wp.min(scans[eye.row, block], scans[eye.row, wp.min(block + 1, end)]))
    return least(smallest) * distance < 1.0


@wp.func
def farthest_hit(eye: Eye, scans: wp.array2d(dtype=Lanes)) -> float:
    """Return the largest range entered so far, metres."""
    smallest = Lanes(BLIND)
    for block in range(scans.shape[1]):
        smallest = wp.min(smallest, scans[eye.row, block])
    return 1.0 / least(smallest)


@wp.func
def may_be_seen(
    at: wp.vec2, radius: float, reach: float, eye: Eye, robot: Robot, scans: wp.array2d(dtype=Lanes)
) -> bool:
    """Return whether a beam that may meet what lies in a circle has met nothing nearer yet.

    Args:
        at: centre of the circle.
        radius: of the circle; 0 if nothing lies in it.
        reach: metres that no beam reaches beyond.
        eye: the lidar.
        robot: whose it is.
        scans: what is entered so far.
    """
    center = turned(eye, at[0] - eye.x, at[1] - eye.y)
    if radius == 0.0:
        return False
    distance = wp.length(center)
    right = center[1] < -radius
    left = past_last_beam(center, robot) > radius
    if distance - radius > reach or is_out_of_view(right, left, robot):
        return False
    if distance <= radius:
        return True
    # not less than the arc sine, and quicker
    sine = radius / distance
    half = sine + 0.5708 * sine * sine * sine + ROUGHLY
    low = rough_bearing(center[0], center[1]) - half
    low = wp.where(low < 0.0, low + 2.0 * PI, low) * robot.beams_per_radian
    high = low + 2.0 * half * robot.beams_per_radian
    nearest = distance - radius
    if is_farther(int(low), wp.min(int(high) + 1, robot.beams - 1), nearest, eye, scans):
        return True
    lap = 2.0 * PI * robot.beams_per_radian
    if high >= lap:
        return is_farther(0, wp.min(int(high - lap) + 1, robot.beams - 1), nearest, eye, scans)
    return False


@wp.func
def mark_cell(
    index: int, ring: int, reach: float, eye: Eye, robot: Robot, geometry: Geometry, rays: Rays,
    scans: wp.array2d(dtype=Lanes),
):  # fmt: skip
    """Enter what lies in a cell of a ring around the eye's own, where no beam reaches beyond ``reach``."""
    cell = geometry.cells[index]
    after = geometry.cells[index + 1]
    for b in range(cell.first_box, after.first_box):
        box = geometry.boxes[b]
        if ring < NEAR or may_be_seen(box.center, wp.length(box.half) + EDGE, reach, eye, robot, scans):
            mark_box(box, eye, robot, rays, scans)
    for c in range(cell.first_disc, after.first_disc):
        disc = geometry.discs[c]
        mark_disc(disc[0], disc[1], disc[2], eye, robot, rays, scans)


@wp.func
def mark_world(
    grid: Grid, eye: Eye, robot: Robot, geometry: Geometry, rays: Rays, scans: wp.array2d(dtype=Lanes)
):
    """Enter a world: what is long, then cell by cell in rings around the eye's own."""
    mark_cell(
        grid.first_cell + grid.columns * grid.rows, 0, robot.max_range, eye, robot, geometry, rays, scans
    )
    here = cell_at(grid, eye.x, eye.y)
    rings = wp.max(wp.max(here[0], grid.columns - 1 - here[0]), wp.max(here[1], grid.rows - 1 - here[1]))
    reach = robot.max_range
    for ring in range(rings + 1):
        if ring > 1:
            reach = wp.min(reach, farthest_hit(eye, scans))
            # all that lies in this ring or further out is at least this far away
            if float(ring - 1) * grid.cell_size - grid.spill > reach:
                break
        for row in range(wp.max(here[1] - ring, 0), wp.min(here[1] + ring, grid.rows - 1) + 1):
            # the first and the last row of a ring are whole, of the others only the ends belong to it
            stride = wp.where(wp.abs(row - here[1]) == ring, 1, 2 * ring)
            for column in range(here[0] - ring, here[0] + ring + 1, wp.max(stride, 1)):
                if column >= 0 and column < grid.columns:
                    index = grid.first_cell + row * grid.columns + column
                    cell = geometry.cells[index]
                    if may_be_seen(cell.center, cell.radius, reach, eye, robot, scans):
                        mark_cell(index, ring, reach, eye, robot, geometry, rays, scans)


@wp.kernel
def cast(
    start: int,
    poses: wp.array3d(dtype=float),
    robots: wp.array(dtype=Robot),
    rays: Rays,
    geometry: Geometry,
    world_index: wp.array(dtype=int),
    scans: wp.array2d(dtype=Lanes),
):
    """Cast the lidar of one robot of one episode.

    Args:
        start: episode times robots that thread 0 works on.
        poses: (episodes, robots, 3).
        robots: the team.
        rays: beams of each robot.
        geometry: the worlds.
        world_index: world of each episode.
        scans: (episodes times robots, blocks of beams).
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
    farthest = 1.0 / robot.max_range
    for block in range(scans.shape[1]):
        blank = Lanes(farthest)
        if (block + 1) * LANES > robot.beams:
            blank += rays.windows[wp.clamp(robot.beams - block * LANES, 0, LANES), LANES] * BLIND
        scans[row, block] = blank
    for j in range(count):
        if j != agent and robots[j].height > robot.lidar_height:
            mark_disc(
                poses[episode, j, 0], poses[episode, j, 1], robots[j].profile_radius, eye, robot, rays, scans
            )
    grid = geometry.grids[robot.seen_layer * geometry.worlds + world_index[episode]]
    mark_world(grid, eye, robot, geometry, rays, scans)
    for block in range(scans.shape[1]):
        inverse = scans[row, block]
        for lane in range(LANES):
            distance = 1.0 / inverse[lane]
            # a miss reads the maximum to the last bit, whatever the rounding of 1 / (1 / x)
            miss = inverse[lane] <= farthest or inverse[lane] >= BLIND
            inverse[lane] = wp.where(miss, robot.max_range, wp.max(distance, robot.min_range))
        scans[row, block] = inverse
