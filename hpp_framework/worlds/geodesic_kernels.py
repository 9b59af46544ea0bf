"""Warp kernels that find the way to a goal from every cell of a grid, by fast sweeping (Zhao 2005)."""

import warp as wp

FAR = wp.constant(1.0e6)
"""What a cell reads before anything reached it, and what it keeps if nothing can."""
ROUNDS = wp.constant(64)
"""Rounds of four sweeps before giving up; rooms take 3 to 10, mazes more."""
SETTLED = wp.constant(1.0e-3)
"""Change of a round, in cells, below which a field is finished."""


@wp.struct
class Grids:
    """Slowness maps of several grids, one after the other."""

    slowness: wp.array(dtype=float)
    """Cost of crossing a cell, 1 for open ground; ``FAR`` and more is blocked."""
    first: wp.array(dtype=wp.int64)
    rows: wp.array(dtype=int)
    columns: wp.array(dtype=int)


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
def solve(
    start: int,
    grids: Grids,
    grid_of: wp.array(dtype=int),
    goals: wp.array(dtype=wp.vec2),
    field_first: wp.array(dtype=wp.int64),
    values: wp.array(dtype=float),
):
    """Fill one field with the least cost from each cell to its goal, in cells.

    Args:
        start: field that thread 0 works on.
        grids: the maps.
        grid_of: map of each field.
        goals: of each field, in cells (column, row); a cell's centre is at .5.
        field_first: index of each field's first cell in ``values``.
        values: out.
    """
    f = start + wp.tid()
    first = grids.first[grid_of[f]]
    rows = grids.rows[grid_of[f]]
    columns = grids.columns[grid_of[f]]
    out = field_first[f]
    for row in range(rows):
        for column in range(columns):
            here = wp.int64(row * columns + column)
            away = wp.length(wp.vec2(float(column) + 0.5, float(row) + 0.5) - goals[f])
            cost = grids.slowness[first + here]
            values[out + here] = wp.where(away < 1.5 and cost < FAR, away * cost, FAR)
    for _round in range(ROUNDS):
        change = float(0.0)
        for sweep in range(4):
            for i in range(rows):
                row = swept(i, rows, sweep, 0)
                for j in range(columns):
                    column = swept(j, columns, sweep, 1)
                    here = wp.int64(row * columns + column)
                    cost = grids.slowness[first + here]
                    if cost < FAR:
                        ahead = float(FAR)
                        beside = float(FAR)
                        if column > 0:
                            ahead = values[out + here - wp.int64(1)]
                        if column < columns - 1:
                            ahead = wp.min(ahead, values[out + here + wp.int64(1)])
                        if row > 0:
                            beside = values[out + here - wp.int64(columns)]
                        if row < rows - 1:
                            beside = wp.min(beside, values[out + here + wp.int64(columns)])
                        new = upwind(ahead, beside, cost)
                        old = values[out + here]
                        if new < old:
                            values[out + here] = new
                            change = wp.max(change, old - new)
        if change < SETTLED:
            break


@wp.func
def sees(a: wp.vec2, b: wp.vec2, slowness: wp.array(dtype=float), first: wp.int64, columns: int) -> bool:
    """Return whether the straight way between two points crosses open cells only."""
    steps = int(wp.ceil(2.0 * wp.max(wp.abs(b[0] - a[0]), wp.abs(b[1] - a[1]))))
    for s in range(steps):
        at = a + (b - a) * (float(s) / float(steps))
        if slowness[first + wp.int64(int(at[1]) * columns + int(at[0]))] >= FAR:
            return False
    return True


@wp.kernel(enable_backward=False)
def solve_straight(
    start: int,
    grids: Grids,
    grid_of: wp.array(dtype=int),
    goals: wp.array(dtype=wp.vec2),
    field_first: wp.array(dtype=wp.int64),
    values: wp.array(dtype=float),
    corners: wp.array(dtype=int),
):
    """Fill one field with the length of the shortest way from each open cell to its goal, in cells.

    A way is a chain of straight lines: each cell knows the corner it heads for, and takes over its
    neighbours' corners if it sees them (the any-angle idea of Theta*, Nash et al. 2007, in sweeps). Slowness
    between open and blocked is not heeded.

    Args:
        start: field that thread 0 works on.
        grids: the maps.
        grid_of: map of each field.
        goals: of each field, in cells (column, row); a cell's centre is at .5.
        field_first: index of each field's first cell in ``values``.
        values: out.
        corners: scratch of the same shape: the cell that each cell heads for, -1 for the goal.
    """
    f = start + wp.tid()
    first = grids.first[grid_of[f]]
    rows = grids.rows[grid_of[f]]
    columns = grids.columns[grid_of[f]]
    out = field_first[f]
    for row in range(rows):
        for column in range(columns):
            cell = wp.int64(row * columns + column)
            away = wp.length(wp.vec2(float(column) + 0.5, float(row) + 0.5) - goals[f])
            values[out + cell] = wp.where(away < 1.5 and grids.slowness[first + cell] < FAR, away, FAR)
            corners[out + cell] = -1
    for sweep in range(4 * ROUNDS):
        changed = bool(False)
        for i in range(rows):
            row = swept(i, rows, sweep, 0)
            for j in range(columns):
                column = swept(j, columns, sweep, 1)
                here = row * columns + column
                if grids.slowness[first + wp.int64(here)] < FAR:
                    place = wp.vec2(float(column) + 0.5, float(row) + 0.5)
                    best = values[out + wp.int64(here)]
                    for k in range(9):
                        next_row = row + k // 3 - 1
                        next_column = column + k % 3 - 1
                        if next_row >= 0 and next_row < rows and next_column >= 0 and next_column < columns:
                            there = next_row * columns + next_column
                            value = values[out + wp.int64(there)]
                            if value < best:
                                corner = corners[out + wp.int64(there)]
                                target = goals[f]
                                left = float(0.0)
                                if corner >= 0:
                                    target = wp.vec2(
                                        float(corner % columns) + 0.5, float(corner // columns) + 0.5
                                    )
                                    left = values[out + wp.int64(corner)]
                                new = left + wp.length(target - place)
                                if new < best - SETTLED:
                                    if not sees(place, target, grids.slowness, first, columns):
                                        corner = there
                                        new = value + wp.length(
                                            wp.vec2(float(next_column - column), float(next_row - row))
                                        )
                                    if new < best - SETTLED:
                                        changed = bool(True)
                                        best = new
                                        values[out + wp.int64(here)] = new
                                        corners[out + wp.int64(here)] = corner
        # every update is worth more than SETTLED, and none depends on the direction of the sweep
        if not changed:
            break
