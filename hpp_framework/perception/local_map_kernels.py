"""Warp kernels that map what a robot has seen, and find paths through it for every robot and goal."""

import warp as wp

FAR = wp.constant(1.0e6)
"""What a cell reads before anything reached it."""
REACH = wp.constant(3)
"""Cells around a seen point that learn how near it is."""
ROUNDS = wp.constant(12)
"""Rounds of four sweeps before a field is taken as it is; furnished rooms take 3 to 6."""
SETTLED = wp.constant(1.0e-2)
"""Change of a round, in cells, below which a field is finished."""
STRIDE = wp.constant(0.5)
"""Length of a step down a field, in cells."""
STEPS = wp.constant(192)
"""Steps after which a path that has not arrived goes straight."""
NEAR = wp.constant(1.5)
"""Cells from the robot within which a path goes straight."""


@wp.kernel(enable_backward=False)
def mark(
    eyes: wp.array2d(dtype=wp.vec3),
    scans: wp.array2d(dtype=wp.vec3),
    ranges: wp.array3d(dtype=float),
    poses: wp.array3d(dtype=wp.vec3),
    agent: int,
    farthest: float,
    body: float,
    origins: wp.array(dtype=wp.vec2),
    resolution: float,
    seen: wp.array3d(dtype=wp.vec3),
):
    """Sum up the points seen in each cell of one episode's local map.

    Points on other robots are left out: they will not stay where they are.

    Args:
        eyes: (episode, glimpse), lidar poses, world frame.
        scans: (1, beam): direction of each beam (x, y) in the lidar's frame.
        ranges: (episode, glimpse, beam), metres.
        poses: (episode, glimpse, robot), world frame.
        agent: whose lidar it is.
        farthest: range in metres from which a beam hit nothing.
        body: distance in metres from a robot's middle within which points are on it.
        origins: corner of each local map, world frame.
        resolution: metres per cell.
        seen: (episode, row, column): sums of x and y in cells, and count; in and out.
    """
    episode = wp.tid()
    rows = seen.shape[1]
    columns = seen.shape[2]
    origin = origins[episode]
    for glimpse in range(eyes.shape[1]):
        eye = eyes[episode, glimpse]
        cos = wp.cos(eye[2])
        sin = wp.sin(eye[2])
        for beam in range(ranges.shape[2]):
            reach = ranges[episode, glimpse, beam]
            if reach < farthest:
                along = scans[0, beam]
                x = eye[0] + reach * (cos * along[0] - sin * along[1])
                y = eye[1] + reach * (sin * along[0] + cos * along[1])
                column = int(wp.floor((x - origin[0]) / resolution))
                row = int(wp.floor((y - origin[1]) / resolution))
                if row >= 0 and row < rows and column >= 0 and column < columns:
                    fixed = bool(True)
                    for robot in range(poses.shape[2]):
                        if robot != agent:
                            at = poses[episode, glimpse, robot]
                            if wp.length(wp.vec2(x - at[0], y - at[1])) < body:
                                fixed = False
                    if fixed:
                        u = (x - origin[0]) / resolution
                        v = (y - origin[1]) / resolution
                        seen[episode, row, column] = seen[episode, row, column] + wp.vec3(u, v, 1.0)


@wp.kernel(enable_backward=False)
def dilate(seen: wp.array3d(dtype=wp.vec3), most: float, clearance: wp.array3d(dtype=float)):
    """Write into each cell of one episode's map how far the nearest seen point is.

    Args:
        seen: as ``mark`` leaves it.
        most: clearance in cells of what is far from everything seen.
        clearance: (episode, row, column), cells, out.
    """
    episode = wp.tid()
    rows = seen.shape[1]
    columns = seen.shape[2]
    for row in range(rows):
        for column in range(columns):
            clearance[episode, row, column] = most
    for row in range(rows):
        for column in range(columns):
            total = seen[episode, row, column]
            if total[2] > 0.0:
                x = total[0] / total[2]
                y = total[1] / total[2]
                for r in range(wp.max(row - REACH, 0), wp.min(row + REACH + 1, rows)):
                    for c in range(wp.max(column - REACH, 0), wp.min(column + REACH + 1, columns)):
                        away = wp.length(wp.vec2(float(c) + 0.5 - x, float(r) + 0.5 - y))
                        clearance[episode, r, c] = wp.min(clearance[episode, r, c], away)


@wp.func
def slowness(clearance: float, radius: float, comfort: float, blocked: float) -> float:
    """Return the cost of a cell: 1 in the open, up to 3 near things, ``blocked`` where there is no room."""
    room = clearance - radius
    if room <= 0.0:
        return blocked
    return 1.0 + 2.0 * wp.clamp(1.0 - room / comfort, 0.0, 1.0)


@wp.func
def upwind(ahead: float, beside: float, cost: float) -> float:
    """Arrival at a cell from its nearest neighbours along each axis (Godunov's scheme)."""
    low = wp.min(ahead, beside)
    gap = wp.abs(ahead - beside)
    if gap >= cost:
        return low + cost
    return 0.5 * (ahead + beside + wp.sqrt(2.0 * cost * cost - gap * gap))


@wp.func
def swept(line: int, count: int, sweep: int, axis: int) -> int:
    """Return the row (axis 0) or column (axis 1) that comes at a place of a sweep."""
    if ((sweep >> axis) & 1) == 0:
        return line
    return count - 1 - line


@wp.kernel(enable_backward=False)
def sweep(
    clearance: wp.array3d(dtype=float),
    starts: wp.array2d(dtype=wp.vec2),
    radii: wp.array(dtype=float),
    comfort: float,
    blocked: float,
    costs: wp.array(dtype=float),
    values: wp.array(dtype=float),
):
    """Fill the field of one robot: the cost of the path from it to each cell (Zhao 2005).

    Args:
        clearance: (episode, row, column), cells.
        starts: (episode, robot), cells.
        radii: of the robots' footprints, cells.
        comfort: gap to obstacles from which a cell costs 1, cells.
        blocked: cost of a cell without room.
        costs: scratch of the shape of ``values``.
        values: (episode, robot, row, column) in one row, cells, out.
    """
    episode, robot = wp.tid()
    rows = clearance.shape[1]
    columns = clearance.shape[2]
    start = starts[episode, robot]
    radius = radii[robot]
    first = (episode * starts.shape[1] + robot) * rows * columns
    for row in range(rows):
        for column in range(columns):
            here = first + row * columns + column
            away = wp.length(wp.vec2(float(column) + 0.5, float(row) + 0.5) - start)
            values[here] = wp.where(away < NEAR, away, FAR)
            costs[here] = slowness(clearance[episode, row, column], radius, comfort, blocked)
    for _round in range(ROUNDS):
        change = float(0.0)
        for direction in range(4):
            for i in range(rows):
                row = swept(i, rows, direction, 0)
                # beyond an edge lies the cell itself, which never lowers its own value
                down = wp.where(row > 0, -columns, 0)
                up = wp.where(row < rows - 1, columns, 0)
                for j in range(columns):
                    column = swept(j, columns, direction, 1)
                    here = first + row * columns + column
                    left = wp.where(column > 0, -1, 0)
                    right = wp.where(column < columns - 1, 1, 0)
                    old = values[here]
                    ahead = wp.min(values[here + left], values[here + right])
                    beside = wp.min(values[here + down], values[here + up])
                    if wp.min(ahead, beside) < old:
                        new = upwind(ahead, beside, costs[here])
                        if new < old:
                            values[here] = new
                            change = wp.max(change, old - new)
        if change < SETTLED:
            break


@wp.func
def downhill(values: wp.array4d(dtype=float), episode: int, robot: int, at: wp.vec2) -> wp.vec2:
    """Return the direction in which a field falls fastest, from the four cells around a point."""
    rows = values.shape[2]
    columns = values.shape[3]
    x = wp.clamp(at[0] - 0.5, 0.0, float(columns) - 1.001)
    y = wp.clamp(at[1] - 0.5, 0.0, float(rows) - 1.001)
    column = int(x)
    row = int(y)
    u = x - float(column)
    v = y - float(row)
    a = values[episode, robot, row, column]
    b = values[episode, robot, row, column + 1]
    c = values[episode, robot, row + 1, column]
    d = values[episode, robot, row + 1, column + 1]
    slope = wp.vec2((a - b) * (1.0 - v) + (c - d) * v, (a - c) * (1.0 - u) + (b - d) * u)
    length = wp.length(slope)
    if length < 1.0e-6:
        return wp.vec2(0.0, 0.0)
    return slope / length


@wp.func
def clamped(at: wp.vec2, rows: int, columns: int) -> wp.vec2:
    """Return the nearest point on the local map."""
    return wp.vec2(wp.clamp(at[0], 0.5, float(columns) - 0.5), wp.clamp(at[1], 0.5, float(rows) - 0.5))


@wp.func
def stepped(
    values: wp.array4d(dtype=float), episode: int, robot: int, at: wp.vec2, start: wp.vec2
) -> wp.vec2:
    """Return where a path goes next from a point: down the field, or the point itself once it has arrived."""
    if wp.length(at - start) <= NEAR:
        return at
    return clamped(at + STRIDE * downhill(values, episode, robot, at), values.shape[2], values.shape[3])


@wp.kernel(enable_backward=False)
def trace(
    values: wp.array4d(dtype=float),
    starts: wp.array2d(dtype=wp.vec2),
    goals: wp.array2d(dtype=wp.vec2),
    arcs: wp.array(dtype=float),
    lengths: wp.array3d(dtype=wp.vec2),
    points: wp.array4d(dtype=wp.vec2),
):
    """Follow one path from its goal down the field to the robot, and note where it is after some lengths.

    Args:
        values: (episode, robot, row, column), cells.
        starts: (episode, robot), cells.
        goals: (episode, goal), cells.
        arcs: lengths from the robot at which to note the path, cells, increasing.
        lengths: (episode, robot, goal), out: the path's length and cost, cells.
        points: (episode, robot, goal, arc), cells, out; the goal beyond the path's end.
    """
    episode, robot, g = wp.tid()
    start = starts[episode, robot]
    goal = goals[episode, g]
    entry = clamped(goal, values.shape[2], values.shape[3])
    outside = wp.length(goal - entry)
    # first measure the path, then note it: it is followed from its end
    at = entry
    done = float(outside)
    for _step in range(STEPS):
        after = stepped(values, episode, robot, at, start)
        stride = wp.length(after - at)
        if stride < 1.0e-3:
            break
        done += stride
        at = after
    total = done + wp.length(start - at)
    cost = values[episode, robot, int(entry[1]), int(entry[0])] + outside
    lengths[episode, robot, g] = wp.vec2(total, cost)
    k = int(arcs.shape[0] - 1)
    for _past in range(arcs.shape[0]):
        if k < 0 or arcs[k] < total:
            break
        points[episode, robot, g, k] = goal
        k -= 1
    before = goal
    done = float(0.0)
    at = entry
    arrived = bool(False)
    for _step in range(STEPS + 2):
        stride = wp.length(at - before)
        for _noted in range(arcs.shape[0]):
            if k < 0 or total - arcs[k] > done + stride:
                break
            share = (total - arcs[k] - done) / wp.max(stride, 1.0e-6)
            points[episode, robot, g, k] = before + share * (at - before)
            k -= 1
        if k < 0 or arrived:
            break
        done += stride
        before = at
        at = stepped(values, episode, robot, before, start)
        if wp.length(at - before) < 1.0e-3 or _step == STEPS:
            at = start
            arrived = True
    for _left in range(arcs.shape[0]):
        if k < 0:
            break
        points[episode, robot, g, k] = start
        k -= 1


@wp.kernel(enable_backward=False)
def look_around(
    clearance: wp.array3d(dtype=float),
    frames: wp.array3d(dtype=wp.vec3),
    grid: wp.array(dtype=wp.vec2),
    unit: float,
    around: wp.array4d(dtype=float),
):
    """Read the clearance at a grid of points, placed in a frame.

    Args:
        clearance: (episode, row, column), cells.
        frames: (episode, robot, goal): origin in cells, and heading.
        grid: points in a frame, cells.
        unit: clearance that counts as 1, cells.
        around: (episode, robot, goal, point), out; 1 outside the local map.
    """
    episode, robot, g = wp.tid()
    frame = frames[episode, robot, g]
    cos = wp.cos(frame[2])
    sin = wp.sin(frame[2])
    for p in range(grid.shape[0]):
        column = int(wp.floor(frame[0] + cos * grid[p][0] - sin * grid[p][1]))
        row = int(wp.floor(frame[1] + sin * grid[p][0] + cos * grid[p][1]))
        value = float(1.0)
        if row >= 0 and row < clearance.shape[1] and column >= 0 and column < clearance.shape[2]:
            value = wp.min(clearance[episode, row, column] / unit, 1.0)
        around[episode, robot, g, p] = value
