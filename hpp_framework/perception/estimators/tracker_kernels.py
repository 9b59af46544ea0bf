"""Warp kernels of the tracker: one extended Kalman filter a robot, sightings by lidar, scans moved along.

Annotations are the types of Warp, which compiles this source.
"""

# no "from __future__ import annotations": Warp reads the annotations as they are

import warp as wp

wp.set_module_options({"enable_backward": False})

Vec9 = wp.types.vector(length=9, dtype=float)
Mat99 = wp.types.matrix(shape=(9, 9), dtype=float)
"""State: x, y, heading, speed, turn rate, errors of its localisation in x, y, heading; acceleration."""

PI = wp.constant(3.14159265358979)
TINY = wp.constant(1.0e-6)
"""Least variance that anything is taken to have."""
GATE = wp.constant(25.0)
"""Squared innovation, in its own variance, from which on a localisation is taken to have jumped."""
ROUNDS = wp.constant(5)
"""Steps of Gauss and Newton by which a disc is fitted to a scan."""
WAVERS = wp.constant(0.012)
"""Radians by which the estimated own heading changes from step to step."""
REACH = wp.constant(1.5)
"""Metres from where it is expected within which a teammate is looked for, at most."""
ACROSS = wp.constant(8)
"""Beams that a surface seen between two neighbouring beams may fill once the lidar has come nearer."""
SURFACE = wp.constant(0.25)
"""Metres by which the ranges of neighbouring beams differ at most on one surface."""
AROUND = wp.constant(0.15)
"""Metres around a robot within which an earlier scan may have seen it."""
MISSED = wp.constant(0.999)
"""Share of the maximum range from which on a beam hit nothing."""


@wp.struct
class Track:
    """Numbers of one robot as another one tracks it; variances in m^2 and rad^2."""

    white: float
    white_turn: float
    bias: float
    bias_turn: float
    decay: float
    jump: float
    acceleration: float
    steadiness: float
    turn_acceleration: float
    top_speed: float
    radius: float
    odometry: float


@wp.struct
class View:
    """Numbers of one lidar."""

    mount: wp.vec3
    half_view: float
    step: float
    beams: int
    min_range: float
    max_range: float
    noise: float


@wp.struct
class Drive:
    """Numbers of one drive."""

    speed_min: float
    speed_max: float
    turn_rate: float
    acceleration: float
    turn_acceleration: float


@wp.func
def wrapped(angle: float) -> float:
    """Return an angle in -pi..pi."""
    return angle - 2.0 * PI * wp.floor((angle + PI) / (2.0 * PI))


@wp.func
def composed(pose: wp.vec3, relative: wp.vec3) -> wp.vec3:
    """Return the world pose of one given in the frame of another."""
    cos = wp.cos(pose[2])
    sin = wp.sin(pose[2])
    return wp.vec3(
        pose[0] + cos * relative[0] - sin * relative[1],
        pose[1] + sin * relative[0] + cos * relative[1],
        wrapped(pose[2] + relative[2]),
    )


@wp.func
def fused(x: Vec9, p: Mat99, h: Vec9, innovation: float, variance: float):
    """Return state and covariance after a scalar measurement."""
    g = p * h
    gain = g / (wp.dot(h, g) + variance)
    return x + gain * innovation, p - wp.outer(gain, g)


@wp.kernel
def begin(
    chosen: wp.array2d(dtype=wp.bool),
    poses: wp.array2d(dtype=wp.vec3),
    tracks: wp.array(dtype=Track),
    states: wp.array2d(dtype=Vec9),
    covariances: wp.array2d(dtype=Mat99),
):
    """Begin tracks of robots at rest.

    Args:
        chosen: which tracks (episode, robot).
        poses: localised.
        tracks: numbers of each robot.
        states: out.
        covariances: out.
    """
    row, robot = wp.tid()
    if not chosen[row, robot]:
        return
    at = poses[row, robot]
    track = tracks[robot]
    x = Vec9()
    x[0] = at[0]
    x[1] = at[1]
    x[2] = at[2]
    p = Mat99()
    for i in range(3):
        bias = wp.where(i < 2, track.bias, track.bias_turn)
        p[i, i] = bias + wp.where(i < 2, track.white, track.white_turn) + TINY
        p[i, i + 5] = -bias
        p[i + 5, i] = -bias
        p[i + 5, i + 5] = bias
    p[3, 3] = TINY
    p[4, 4] = TINY
    states[row, robot] = x
    covariances[row, robot] = p


@wp.kernel
def follow(
    agent: int,
    period: float,
    sensing: float,
    ahead: float,
    poses: wp.array2d(dtype=wp.vec3),
    ages: wp.array2d(dtype=float),
    fresh: wp.array2d(dtype=wp.bool),
    odometry: wp.array(dtype=wp.vec2),
    tracks: wp.array(dtype=Track),
    silent: wp.array2d(dtype=float),
    states: wp.array2d(dtype=Vec9),
    covariances: wp.array2d(dtype=Mat99),
):
    """Move tracks on by a control period and correct them by the localised poses that came.

    Args:
        agent: index of the robot that tracks; its own motion is known by odometry.
        period: seconds.
        sensing: seconds by which the agent's readings are late.
        ahead: seconds without news for which a robot is taken to go on as before.
        poses: localised (episode, robot).
        ages: of those, seconds.
        fresh: which are new.
        odometry: own speed and turn rate.
        tracks: numbers of each robot.
        silent: seconds since anything was heard or seen of a robot; kept here.
        states: to move on.
        covariances: to move on.
    """
    row, robot = wp.tid()
    track = tracks[robot]
    x = states[row, robot]
    p = covariances[row, robot]
    mine = robot == agent
    silence = silent[row, robot] + period
    speed = x[3]
    turn = x[4]
    if mine:
        speed = 0.5 * (speed + odometry[row][0])
        turn = 0.5 * (turn + odometry[row][1])
    going = wp.where(silence <= ahead or mine, 1.0, 0.0)
    if not mine:
        speed = wp.clamp(speed + 0.5 * x[8] * period, -track.top_speed, track.top_speed)
    along = x[2] + 0.5 * turn * period * going
    cos = wp.cos(along)
    sin = wp.sin(along)
    step = speed * period * going
    f = wp.identity(n=9, dtype=float)
    f[0, 2] = -step * sin
    f[1, 2] = step * cos
    if not mine:
        f[0, 3] = period * cos * going
        f[1, 3] = period * sin * going
        f[0, 4] = -0.5 * step * sin * period
        f[1, 4] = 0.5 * step * cos * period
        f[2, 4] = period * going
        f[0, 8] = 0.5 * period * period * cos * going
        f[1, 8] = 0.5 * period * period * sin * going
        f[3, 8] = period
        f[8, 8] = track.steadiness
    for i in range(3):
        f[i + 5, i + 5] = track.decay
    x[0] += step * cos
    x[1] += step * sin
    x[2] = wrapped(x[2] + turn * period * going)
    if not mine:
        x[3] = wp.clamp(x[3] + x[8] * period, -track.top_speed, track.top_speed)
        x[8] = track.steadiness * x[8]
    for i in range(3):
        x[i + 5] = track.decay * x[i + 5]
    p = f * p * wp.transpose(f)
    forgotten = 1.0 - track.decay * track.decay
    p[5, 5] += track.bias * forgotten
    p[6, 6] += track.bias * forgotten
    p[7, 7] += track.bias_turn * forgotten
    if mine:
        x[3] = odometry[row][0]
        x[4] = odometry[row][1]
        p[0, 0] += track.odometry * step * step + TINY
        p[1, 1] += track.odometry * step * step + TINY
        p[2, 2] += track.odometry * turn * turn * period * period + TINY
    else:
        p[8, 8] += track.acceleration * track.acceleration * (1.0 - track.steadiness * track.steadiness)
        p[0, 0] += TINY
        p[1, 1] += TINY
        change = track.turn_acceleration * period
        drift = 0.5 * change * period
        p[2, 2] += drift * drift
        p[4, 4] += change * change
        if going == 0.0:
            drift = 0.5 * track.top_speed * period
            p[0, 0] += drift * drift
            p[1, 1] += drift * drift
    if fresh[row, robot]:
        z = poses[row, robot]
        late = wp.max(ages[row, robot] - sensing, 0.0)
        silence = wp.min(silence, late)
        age = wp.min(late, ahead)
        back = x[2] - 0.5 * x[4] * age
        cos = wp.cos(back)
        sin = wp.sin(back)
        lag = (x[3] - 0.5 * x[8] * age) * age
        # it has sped up, slowed down or turned since
        spread_turn = 0.5 * track.turn_acceleration * age * age + (late - age)
        spread = 0.25 * track.acceleration * age * age + 0.5 * track.top_speed * (late - age)
        spread += 0.5 * wp.abs(lag) * wp.min(spread_turn, 1.0)
        if mine:
            spread = 0.0
            spread_turn = 0.0
        variance = track.white + spread * spread + TINY
        hx = Vec9(
            1.0, 0.0, lag * sin, -age * cos, -0.5 * lag * sin * age, 1.0, 0.0, 0.0, 0.5 * age * age * cos
        )
        hy = Vec9(
            0.0, 1.0, -lag * cos, -age * sin, 0.5 * lag * cos * age, 0.0, 1.0, 0.0, 0.5 * age * age * sin
        )
        ht = Vec9(0.0, 0.0, 1.0, 0.0, -age, 0.0, 0.0, 1.0, 0.0)
        dx = z[0] - (x[0] - lag * cos + x[5])
        dy = z[1] - (x[1] - lag * sin + x[6])
        off = dx * dx / (wp.dot(hx, p * hx) + variance) + dy * dy / (wp.dot(hy, p * hy) + variance)
        if off > GATE:
            # robots do not jump, but where they take themselves to be may
            p[5, 5] += track.jump
            p[6, 6] += track.jump
        x, p = fused(x, p, hx, dx, variance)
        dy = z[1] - (x[1] - lag * sin + x[6])
        x, p = fused(x, p, hy, dy, variance)
        turned = wrapped(z[2] - (x[2] - x[4] * age + x[7]))
        x, p = fused(x, p, ht, turned, track.white_turn + spread_turn * spread_turn + TINY)
        x[2] = wrapped(x[2])
    silent[row, robot] = silence
    states[row, robot] = x
    covariances[row, robot] = p


@wp.func
def disc_at(
    row: int,
    expected: wp.vec2,
    reach: float,
    radius: float,
    first: int,
    last: int,
    scans: wp.array2d(dtype=float),
    beams: wp.array(dtype=wp.vec2),
    view: View,
) -> wp.vec3:
    """Return the middle of a disc that a lidar sees near a place, and the beams on it: 0 if it sees none.

    Args:
        row: episode.
        expected: place, in the lidar's frame.
        reach: metres from its edge within which points count at first.
        radius: of the disc, metres.
        first: beam that can lie on it.
        last: beam after those that can.
        scans: metres.
        beams: their directions in the lidar's frame.
        view: numbers of the lidar.
    """
    centre = expected
    count = int(0)
    squares = float(0.0)
    tolerance = reach
    for fit in range(ROUNDS):
        xx = float(0.5)
        xy = float(0.0)
        yy = float(0.5)
        gx = float(0.0)
        gy = float(0.0)
        count = int(0)
        squares = float(0.0)
        far = wp.length(centre)
        for k in range(first, last):
            distance = scans[row, k]
            if distance < MISSED * view.max_range:
                point = distance * beams[k]
                apart = point - centre
                length = wp.max(wp.length(apart), 1.0e-4)
                off = length - radius
                # the side that faces the lidar
                if wp.abs(off) < tolerance and wp.dot(apart, centre) < 0.25 * radius * far:
                    nx = apart[0] / length
                    ny = apart[1] / length
                    xx += nx * nx
                    xy += nx * ny
                    yy += ny * ny
                    gx += nx * off
                    gy += ny * off
                    count += 1
                    squares += off * off
        determinant = xx * yy - xy * xy
        if fit < ROUNDS - 1 and count > 0:
            centre += wp.vec2(yy * gx - xy * gy, xx * gy - xy * gx) / determinant
        tolerance = wp.max(0.5 * tolerance, 0.06 + 2.0 * view.noise)
    nothing = wp.vec3(0.0, 0.0, 0.0)
    far = wp.length(centre)
    if far <= radius + view.min_range:
        return nothing
    half = wp.asin(radius / far)
    bearing = wp.atan2(centre[1], centre[0])
    left = int(wp.ceil((bearing + half + view.half_view) / view.step)) + 1
    right = int(wp.floor((bearing - half + view.half_view) / view.step)) - 1
    # beams beside it go past it
    if left < view.beams:
        if scans[row, left] < far - 0.05:
            return nothing
    if right >= 0:
        if scans[row, right] < far - 0.05:
            return nothing
    # part of it may be out of view
    seen_from = wp.max(-half, -view.half_view - bearing)
    seen_to = wp.min(half, view.half_view - bearing)
    wanted = wp.max((seen_to - seen_from) / view.step, 0.0)
    if float(count) < wp.max(3.0, 0.6 * wanted) or squares > float(count) * wp.pow(
        0.03 + 1.5 * view.noise, 2.0
    ):
        return nothing
    return wp.vec3(centre[0], centre[1], float(count))


@wp.kernel
def sight(
    agent: int,
    scans: wp.array2d(dtype=float),
    beams: wp.array(dtype=wp.vec2),
    trusted: wp.array(dtype=wp.bool),
    view: View,
    tracks: wp.array(dtype=Track),
    silent: wp.array2d(dtype=float),
    states: wp.array2d(dtype=Vec9),
    covariances: wp.array2d(dtype=Mat99),
):
    """Correct tracks by where the lidar sees a disc of the robot's size, near where it is expected.

    A disc counts if enough beams lie on it and those beside it go past it.

    Args:
        agent: index of the robot that looks.
        scans: its lidar, metres.
        beams: their directions in the lidar's frame.
        trusted: whether the scan of an episode can be believed.
        view: numbers of the lidar.
        tracks: numbers of each robot.
        silent: seconds since anything was heard or seen of a robot.
        states: to correct.
        covariances: to correct.
    """
    row, robot = wp.tid()
    if robot == agent or not trusted[row]:
        return
    mine = states[row, agent]
    eye = composed(wp.vec3(mine[0], mine[1], mine[2]), view.mount)
    x = states[row, robot]
    p = covariances[row, robot]
    radius = tracks[robot].radius
    cos = wp.cos(eye[2])
    sin = wp.sin(eye[2])
    gap = wp.vec2(x[0] - eye[0], x[1] - eye[1])
    expected = wp.vec2(cos * gap[0] + sin * gap[1], cos * gap[1] - sin * gap[0])
    std = wp.sqrt(0.5 * (p[0, 0] + p[1, 1]))
    reach = wp.min(0.15 + 2.5 * std, REACH)
    away = wp.length(expected)
    if away < radius + view.min_range or away > view.max_range + radius:
        return
    # beams that can lie on it, wherever it is within reach
    span = wp.asin(wp.min((radius + reach) / away, 1.0))
    bearing = wp.atan2(expected[1], expected[0])
    first = wp.max(int((bearing - span + view.half_view) / view.step), 0)
    last = wp.min(int((bearing + span + view.half_view) / view.step) + 2, view.beams)
    if last - first < 3:
        return
    # where it is expected, or else nearer or farther off
    found = disc_at(row, expected, reach, radius, first, last, scans, beams, view)
    for side in range(2):
        if found[2] == 0.0 and reach > 0.5:
            start = expected * (1.0 + (float(side) - 0.5) * reach / away)
            found = disc_at(row, start, 0.7 * reach, radius, first, last, scans, beams, view)
    centre = wp.vec2(found[0], found[1])
    if found[2] == 0.0 or wp.length(centre - expected) > reach:
        return
    far = wp.length(centre)
    # the heading from which it is seen wavers
    variance = 0.01 * 0.01 + 4.0 * view.noise * view.noise / found[2] + WAVERS * WAVERS * far * far
    dx = eye[0] + cos * centre[0] - sin * centre[1] - x[0]
    dy = eye[1] + sin * centre[0] + cos * centre[1] - x[1]
    if dx * dx / (p[0, 0] + variance) + dy * dy / (p[1, 1] + variance) > GATE:
        return
    x, p = fused(x, p, Vec9(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), dx, variance)
    dy = eye[1] + sin * centre[0] + cos * centre[1] - x[1]
    x, p = fused(x, p, Vec9(0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), dy, variance)
    x[2] = wrapped(x[2])
    silent[row, robot] = 0.0
    states[row, robot] = x
    covariances[row, robot] = p


@wp.kernel
def forecast(
    agent: int,
    horizon: float,
    ahead: float,
    commands: wp.array2d(dtype=wp.vec2),
    durations: wp.array(dtype=float),
    drive: Drive,
    tracks: wp.array(dtype=Track),
    silent: wp.array2d(dtype=float),
    states: wp.array2d(dtype=Vec9),
    covariances: wp.array2d(dtype=Mat99),
    poses: wp.array2d(dtype=wp.vec3),
    velocities: wp.array2d(dtype=wp.vec2),
    stds: wp.array2d(dtype=wp.vec3),
):
    """Foresee where robots are once the next command acts.

    Args:
        agent: index of the robot that foresees; what is under way to its wheels is known.
        horizon: seconds.
        ahead: seconds without news for which a robot is taken to go on as before.
        commands: under way (episode, command), oldest first.
        durations: seconds for which each acts.
        drive: numbers of the agent's drive.
        tracks: numbers of each robot.
        silent: seconds since anything was heard or seen of a robot.
        states: tracks.
        covariances: of the tracks.
        poses: out.
        velocities: out; speed and turn rate.
        stds: out; of position along each axis, heading and speed.
    """
    row, robot = wp.tid()
    x = states[row, robot]
    p = covariances[row, robot]
    v = x[3]
    w = x[4]
    px = x[0]
    py = x[1]
    heading = x[2]
    more = float(0.0)
    if robot == agent:
        for k in range(durations.shape[0]):
            duration = durations[k]
            command = commands[row, k]
            v_wanted = wp.clamp(command[0], drive.speed_min, drive.speed_max)
            w_wanted = wp.clamp(command[1], -drive.turn_rate, drive.turn_rate)
            steps = int(wp.ceil(duration / 0.05 - 1.0e-4))
            for _ in range(steps):
                dt = duration / float(steps)
                v_next = v + wp.clamp(v_wanted - v, -drive.acceleration * dt, drive.acceleration * dt)
                w_next = w + wp.clamp(
                    w_wanted - w, -drive.turn_acceleration * dt, drive.turn_acceleration * dt
                )
                along = heading + 0.25 * (w + w_next) * dt
                px += 0.5 * (v + v_next) * dt * wp.cos(along)
                py += 0.5 * (v + v_next) * dt * wp.sin(along)
                heading += 0.5 * (w + w_next) * dt
                v = v_next
                w = w_next
    else:
        time = wp.clamp(ahead - silent[row, robot], 0.0, horizon)
        along = heading + 0.5 * w * time
        v_next = wp.clamp(v + x[8] * time, -tracks[robot].top_speed, tracks[robot].top_speed)
        px += 0.5 * (v + v_next) * time * wp.cos(along)
        py += 0.5 * (v + v_next) * time * wp.sin(along)
        heading += w * time
        v = v_next
        more = p[3, 3] * time * time
        if time < horizon:
            v = 0.0
            w = 0.0
    poses[row, robot] = wp.vec3(px, py, wrapped(heading))
    velocities[row, robot] = wp.vec2(v, w)
    quick = p[3, 3] + 2.0 * horizon * p[3, 8] + horizon * horizon * p[8, 8]
    askew = p[2, 2] + 2.0 * horizon * p[2, 4] + horizon * horizon * p[4, 4]
    if robot == agent:
        quick = p[3, 3]
        askew = p[2, 2]
    stds[row, robot] = wp.vec3(
        wp.sqrt(0.5 * (p[0, 0] + p[1, 1] + more)), wp.sqrt(wp.max(askew, 0.0)), wp.sqrt(wp.max(quick, 0.0))
    )


@wp.func
def show(
    row: int,
    beam: int,
    distance: float,
    entry: int,
    moved: wp.array2d(dtype=float),
    told: wp.array2d(dtype=wp.int32),
):
    """Keep the nearer of two ranges of one scan; what a newer scan told stays."""
    if beam >= 0 and beam < moved.shape[1]:
        if told[row, beam] < 0:
            told[row, beam] = entry
            moved[row, beam] = distance
        elif told[row, beam] == entry:
            moved[row, beam] = wp.min(moved[row, beam], distance)


@wp.kernel
def move_scans(
    poses: wp.array2d(dtype=wp.vec3),
    scans: wp.array3d(dtype=float),
    mates: wp.array3d(dtype=wp.vec2),
    after: wp.array(dtype=wp.vec3),
    agent: int,
    beams: wp.array(dtype=wp.vec2),
    view: View,
    tracks: wp.array(dtype=Track),
    told: wp.array2d(dtype=wp.int32),
    moved: wp.array2d(dtype=float),
):
    """Show what a scan would be from another pose, if nothing but the robot moved.

    Earlier scans show what the newest does not, without what they saw on other robots.

    Args:
        poses: (row, entry), of the robot when each scan was taken, newest first, world frame.
        scans: (row, entry, beam), metres.
        mates: (row, entry, robot), where the team was then, metres.
        after: pose to show them from.
        agent: index of the robot.
        beams: their directions in the lidar's frame.
        view: numbers of the lidar.
        tracks: of the team, for their size.
        told: out; number of the scan that each beam is from, -1 for none.
        moved: out; where nothing is known, the range of the nearest beam that is; of two, the farther.
    """
    row = wp.tid()
    new = composed(after[row], view.mount)
    cos = wp.cos(new[2])
    sin = wp.sin(new[2])
    for k in range(view.beams):
        told[row, k] = -1
    for entry in range(scans.shape[1]):
        old = composed(poses[row, entry], view.mount)
        gap = wp.vec2(old[0] - new[0], old[1] - new[1])
        eye = wp.vec2(cos * gap[0] + sin * gap[1], cos * gap[1] - sin * gap[0])
        turn = old[2] - new[2]
        tcos = wp.cos(turn)
        tsin = wp.sin(turn)
        last_beam = int(0)
        last_distance = float(0.0)
        last_range = float(1.0e6)
        for k in range(view.beams):
            distance = scans[row, entry, k]
            ray = distance * beams[k]
            point = eye + wp.vec2(tcos * ray[0] - tsin * ray[1], tsin * ray[0] + tcos * ray[1])
            mate = bool(False)
            if entry > 0:
                place = wp.vec2(
                    new[0] + cos * point[0] - sin * point[1], new[1] + sin * point[0] + cos * point[1]
                )
                for robot in range(mates.shape[2]):
                    near = wp.length(place - mates[row, entry, robot]) < tracks[robot].radius + AROUND
                    mate = mate or (robot != agent and near)
            if mate:
                last_range = 1.0e6
            else:
                angle = wp.atan2(point[1], point[0])
                beam = int(wp.round((angle + view.half_view) / view.step))
                seen = wp.where(distance < MISSED * view.max_range, wp.length(point), view.max_range)
                show(row, beam, seen, entry, moved, told)
                across = beam - last_beam
                if across > 1 and across <= ACROSS and wp.abs(distance - last_range) < SURFACE:
                    for between in range(1, across):
                        share = float(between) / float(across)
                        filled = last_distance + share * (seen - last_distance)
                        show(row, last_beam + between, filled, entry, moved, told)
                last_beam = beam
                last_distance = seen
                last_range = distance
    for k in range(view.beams):
        if told[row, k] < 0:
            before = int(k)
            beyond = int(k)
            while before >= 0 and told[row, before] < 0:
                before -= 1
            while beyond < view.beams and told[row, beyond] < 0:
                beyond += 1
            nearest = float(0.0)
            if before >= 0:
                nearest = moved[row, before]
            if beyond < view.beams:
                nearest = wp.max(nearest, moved[row, beyond])
            moved[row, k] = wp.where(nearest > 0.0, nearest, view.max_range)
    for k in range(view.beams):
        moved[row, k] = wp.clamp(moved[row, k], view.min_range, view.max_range)
