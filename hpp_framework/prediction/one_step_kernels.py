"""Warp kernel of the paper's one-step models: a whole imagined trajectory in one go, on CPU and CUDA.

A network of four layers is too small to keep a matrix library busy, and every call of one costs more than
the sums it does. One thread imagines one robot for one goal here; vectors of a layer's width keep the sums
in the processor's wide registers.
"""

from typing import Any

import warp as wp

from hpp_framework.perception.sensing import HISTORY
from hpp_framework.prediction.one_step import HIDDEN

PI = wp.constant(3.14159265358979)
PAST = wp.constant(HISTORY)
WIDTHS = wp.constant(wp.vec4i(*HIDDEN))
First = wp.types.vector(HIDDEN[0], wp.float32)
Second = wp.types.vector(HIDDEN[1], wp.float32)
Third = wp.types.vector(HIDDEN[2], wp.float32)
Last = wp.types.vector(HIDDEN[3], wp.float32)


@wp.struct
class Models:
    """Weights of the team's models; row ``s`` belongs to the robot ``s``; a layer lies input by input.

    Attributes:
        in_world: 1 if the models think in world coordinates, 0 if in the agent's frame.
        pose_changes: 1 if the models answer with changes of pose, 0 if with poses.
        reach: so many steps, at most, lie between an imagined scan and a first layer that it enters.
        near: first layer, of the poses in the history (x, y, theta each) and the goal.
        lags: first layer, of what the step 1, 2, ... steps ago did to the lidar, by that step's last layer.
        second: second layer, its bias in the last row, as in the following.
        third: third layer.
        last: fourth layer.
        change: pose or its change, in metres and radians.
    """

    in_world: int
    pose_changes: int
    reach: int
    near: wp.array2d(dtype=First)
    lags: wp.array3d(dtype=First)
    second: wp.array2d(dtype=Second)
    third: wp.array2d(dtype=Third)
    last: wp.array2d(dtype=Last)
    change: wp.array2d(dtype=wp.vec3)


@wp.func
def wrap(angle: float) -> float:
    """Wrap an angle into [-pi, pi)."""
    return angle - 2.0 * PI * wp.floor((angle + PI) / (2.0 * PI))


@wp.func
def between(frame: wp.vec3, turn: wp.vec2, pose: wp.vec3) -> wp.vec3:
    """Express a pose in a frame whose heading has the cosine and sine ``turn``."""
    x = pose[0] - frame[0]
    y = pose[1] - frame[1]
    return wp.vec3(turn[0] * x + turn[1] * y, turn[0] * y - turn[1] * x, wrap(pose[2] - frame[2]))


@wp.func
def compose(frame: wp.vec3, pose: wp.vec3) -> wp.vec3:
    """Return the world pose of a pose given in a frame."""
    cos = wp.cos(frame[2])
    sin = wp.sin(frame[2])
    x = frame[0] + cos * pose[0] - sin * pose[1]
    y = frame[1] + sin * pose[0] + cos * pose[1]
    return wp.vec3(x, y, wrap(frame[2] + pose[2]))


@wp.func
def pose_at(
    entry: int,
    episode: int,
    candidate: int,
    robot: int,
    history: wp.array3d(dtype=wp.vec3),
    poses: wp.array4d(dtype=wp.vec3),
):
    """Return an entry of what was observed first and imagined then."""
    pose = wp.vec3()
    if entry < PAST:
        pose = history[episode, entry, robot]
    else:
        pose = poses[episode, candidate, entry - PAST, robot]
    return pose


@wp.func
def weigh(rows: wp.array(dtype=Any), inputs: int, u: Any, v: Any, x: Any, y: Any):
    """Return ``u`` plus the rows weighed by ``x``, and ``v`` plus the rows weighed by ``y``."""
    for k in range(inputs):
        row = rows[k]
        u += row * x[k]
        v += row * y[k]
    return u, v


@wp.func
def near_inputs(
    models: Models,
    step: int,
    episode: int,
    candidate: int,
    robot: int,
    agent: int,
    goal: wp.vec2,
    history: wp.array3d(dtype=wp.vec3),
    poses: wp.array4d(dtype=wp.vec3),
):
    """Return what poses and goal add to the first layer, the frame, and what the answer is added to in it."""
    frame = wp.vec3()
    if models.in_world == 0:
        frame = pose_at(PAST - 1 + step, episode, candidate, agent, history, poses)
    turn = wp.vec2(wp.cos(frame[2]), wp.sin(frame[2]))
    target = between(frame, turn, wp.vec3(goal[0], goal[1], 0.0))
    out = models.near[robot, 3 * PAST] * target[0] + models.near[robot, 3 * PAST + 1] * target[1]
    now = wp.vec3()
    for j in range(PAST):
        now = between(frame, turn, pose_at(step + j, episode, candidate, robot, history, poses))
        out += models.near[robot, 3 * j] * now[0]
        out += models.near[robot, 3 * j + 1] * now[1]
        out += models.near[robot, 3 * j + 2] * now[2]
    if models.pose_changes == 0:
        now = wp.vec3()
    return out, frame, now


@wp.kernel(enable_backward=False)
def imagine(
    models: Models,
    agent: int,
    order: wp.array(dtype=int),
    base: wp.array3d(dtype=First),
    history: wp.array3d(dtype=wp.vec3),
    goals: wp.array2d(dtype=wp.vec2),
    hidden: wp.array4d(dtype=Last),
    poses: wp.array4d(dtype=wp.vec3),
):
    """Imagine one robot of one episode for two goals, ``p`` and ``q``: weights are read once for both.

    Args:
        models: of the whole team.
        agent: index of the predicting robot, in whose frames the models think unless they do in the world's.
        order: robots this launch imagines; the agent itself must have been imagined before the others.
        base: what bias and real lidar add to the first layer (episode, step, robot).
        history: observed poses (episode, entry, robot), oldest first.
        goals: (episode, candidate).
        hidden: room for last layers (episode, candidate, robot, step).
        poses: imagined ones (episode, candidate, step, robot), out.
    """
    episode, pair, place = wp.tid()
    robot = order[place]
    p = 2 * pair
    q = wp.min(p + 1, goals.shape[1] - 1)  # an odd last goal is imagined twice
    for t in range(poses.shape[2]):
        near_p, frame_p, now_p = near_inputs(
            models, t, episode, p, robot, agent, goals[episode, p], history, poses
        )
        near_q, frame_q, now_q = near_inputs(
            models, t, episode, q, robot, agent, goals[episode, q], history, poses
        )
        a_p = base[episode, t, robot] + near_p
        a_q = base[episode, t, robot] + near_q
        for v in range(wp.max(t - models.reach, 0), t):
            lag = models.lags[robot, wp.min(t - v, PAST) - 1]
            a_p, a_q = weigh(
                lag, WIDTHS[3], a_p, a_q, hidden[episode, p, robot, v], hidden[episode, q, robot, v]
            )
        a_p = wp.max(a_p, First())
        a_q = wp.max(a_q, First())
        second = models.second[robot]
        b_p, b_q = weigh(second, WIDTHS[0], second[WIDTHS[0]], second[WIDTHS[0]], a_p, a_q)
        b_p = wp.max(b_p, Second())
        b_q = wp.max(b_q, Second())
        third = models.third[robot]
        c_p, c_q = weigh(third, WIDTHS[1], third[WIDTHS[1]], third[WIDTHS[1]], b_p, b_q)
        c_p = wp.max(c_p, Third())
        c_q = wp.max(c_q, Third())
        last = models.last[robot]
        d_p, d_q = weigh(last, WIDTHS[2], last[WIDTHS[2]], last[WIDTHS[2]], c_p, c_q)
        d_p = wp.max(d_p, Last())
        d_q = wp.max(d_q, Last())
        hidden[episode, p, robot, t] = d_p
        hidden[episode, q, robot, t] = d_q
        change = models.change[robot]
        now_p, now_q = weigh(
            change, WIDTHS[3], now_p + change[WIDTHS[3]], now_q + change[WIDTHS[3]], d_p, d_q
        )
        poses[episode, p, t, robot] = compose(frame_p, now_p)
        poses[episode, q, t, robot] = compose(frame_q, now_q)
