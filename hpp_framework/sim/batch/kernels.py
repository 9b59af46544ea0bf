"""What both kernels of the batch simulator share: their data, and small functions.

The obstacles of all worlds lie in flat arrays, sorted by the cells of one grid per world and layer. A layer
is what one lidar height sees, or what one body height touches; ``hpp_framework.sim.batch.grid`` builds it
all.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

PI = wp.constant(3.14159265358979)
ROUGHLY = wp.constant(0.005)
"""Radians."""
LANES = wp.constant(8)
"""Beams that are marked at once."""
Lanes = wp.types.vector(length=8, dtype=float)


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
    touched_layer: int
    seen_layer: int
    mount: wp.vec3
    lidar_height: float
    min_range: float
    max_range: float
    first_angle: float
    field_of_view: float
    last_beam: wp.vec2
    beams_per_radian: float
    beams: int


@wp.struct
class Grid:
    """The cells of one world and layer; row by row, and one more that holds what is too long for a cell."""

    origin: wp.vec2
    cells_per_metre: wp.vec2
    columns: int
    rows: int
    first_cell: int
    cell_size: float
    """Metres, the shorter side."""
    spill: float
    """Metres that the content of a cell may reach out of it."""


@wp.struct
class Cell:
    """What lies in a cell, up to where the next cell begins, within a circle."""

    center: wp.vec2
    radius: float
    first_box: int
    first_disc: int


@wp.struct
class Box:
    """A rectangle, or a line that is met from both sides: a rectangle without width."""

    center: wp.vec2
    along: wp.vec2
    """Unit vector along its length."""
    half: wp.vec2
    """Half its length and half its width."""


@wp.struct
class Geometry:
    """All worlds of a pool; the grid of world ``w`` and layer ``l`` is ``grids[l * worlds + w]``."""

    worlds: int
    grids: wp.array(dtype=Grid)
    cells: wp.array(dtype=Cell)
    boxes: wp.array(dtype=Box)
    discs: wp.array(dtype=wp.vec3)


@wp.func
def unfolded(angle: float, x: float, y: float) -> float:
    """Angle of (x, y), given that of the larger and the smaller of their absolute values."""
    angle = wp.where(wp.abs(y) > wp.abs(x), 0.5 * PI - angle, angle)
    angle = wp.where(x < 0.0, PI - angle, angle)
    return wp.where(y < 0.0, -angle, angle)


@wp.func
def bearing(x: float, y: float) -> float:
    """Angle of a point, within 2e-7 rad of ``atan2``, at a quarter of its time.

    The arc tangent on [0, 1] is an odd polynomial of degree 15, fitted for the least greatest error.
    """
    is_steep = wp.abs(y) > wp.abs(x)
    larger = wp.where(is_steep, wp.abs(y), wp.abs(x))
    smaller = wp.where(is_steep, wp.abs(x), wp.abs(y))
    # never 0 / 0
    t = smaller / (larger + 1.0e-30)
    z = t * t
    zz = z * z
    # in pairs: shorter chains of operations that wait for each other
    first = (0.99999934 - 0.33329861 * z) + zz * (0.19946564 - 0.13908620 * z)
    second = (0.096421722 - 0.055911989 * z) + zz * (0.021862727 - 0.0040545043 * z)
    return unfolded((first + zz * zz * second) * t, x, y)


@wp.func
def rough_bearing(x: float, y: float) -> float:
    """Angle of a point, within ``ROUGHLY`` of ``atan2``, at half the time of :func:`bearing`."""
    is_steep = wp.abs(y) > wp.abs(x)
    larger = wp.where(is_steep, wp.abs(y), wp.abs(x))
    smaller = wp.where(is_steep, wp.abs(x), wp.abs(y))
    # never 0 / 0
    t = smaller / (larger + 1.0e-30)
    return unfolded((0.97239411 - 0.19194795 * t * t) * t, x, y)


@wp.func
def cell_at(grid: Grid, x: float, y: float) -> wp.vec2i:
    """Column and row of the cell at a place, or of the nearest one."""
    column = wp.clamp((x - grid.origin[0]) * grid.cells_per_metre[0], 0.0, float(grid.columns - 1))
    row = wp.clamp((y - grid.origin[1]) * grid.cells_per_metre[1], 0.0, float(grid.rows - 1))
    return wp.vec2i(int(column), int(row))
