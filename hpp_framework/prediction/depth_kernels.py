"""Warp kernel that reads points off a scan: how far in front of or behind what the lidar saw."""

import warp as wp


@wp.kernel(enable_backward=False)
def read_depths(
    eyes: wp.array(dtype=wp.vec3),
    scans: wp.array2d(dtype=float),
    first_angle: float,
    angle_step: float,
    frames: wp.array2d(dtype=wp.vec3),
    grid: wp.array(dtype=wp.vec2),
    unit: float,
    depths: wp.array3d(dtype=float),
):
    """Read a grid of points, placed in a frame, off the scan of one episode.

    Args:
        eyes: lidar pose of each episode, world frame.
        scans: ranges of each episode, metres.
        first_angle: of the beams.
        angle_step: of the beams.
        frames: (episode, candidate), world frame.
        grid: points in a frame.
        unit: metres that count as 1.
        depths: (episode, candidate, point), out; within [-1, 1], -1 outside the field of view.
    """
    episode, candidate = wp.tid()
    eye = eyes[episode]
    frame = frames[episode, candidate]
    cos = wp.cos(eye[2])
    sin = wp.sin(eye[2])
    x = cos * (frame[0] - eye[0]) + sin * (frame[1] - eye[1])
    y = cos * (frame[1] - eye[1]) - sin * (frame[0] - eye[0])
    cos = wp.cos(frame[2] - eye[2])
    sin = wp.sin(frame[2] - eye[2])
    for p in range(grid.shape[0]):
        point = wp.vec2(x + cos * grid[p][0] - sin * grid[p][1], y + sin * grid[p][0] + cos * grid[p][1])
        beam = int(wp.rint((wp.atan2(point[1], point[0]) - first_angle) / angle_step))
        depth = float(-1.0)
        if beam >= 0 and beam < scans.shape[1]:
            depth = wp.clamp((scans[episode, beam] - wp.length(point)) / unit, -1.0, 1.0)
        depths[episode, candidate, p] = depth
