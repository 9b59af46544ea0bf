"""Warp kernel of target slots: robots drawn to a middle until all have room around it."""

import warp as wp

wp.set_module_options({"enable_backward": False})

ROUNDS = wp.constant(120)
PULL = wp.constant(0.3)
"""Share of the distance to the ring by which a robot outside comes nearer each round."""
SAME = wp.constant(1.0e-5)
"""Metres below which two robots count as on one point; one of them goes along x."""


@wp.kernel
def spread_out(
    offsets: wp.array2d(dtype=wp.vec2),
    radius: float,
    apart: float,
    here: wp.array2d(dtype=wp.vec2),
    there: wp.array2d(dtype=wp.vec2),
):
    """Write into ``here`` the targets of each row's robots around the origin.

    Each round, robots outside the ring come nearer and robots too near each other move apart by half of what
    is missing; in the second half, their middle is moved back to the origin.
    """
    row = wp.tid()
    count = offsets.shape[1]
    for i in range(count):
        here[row, i] = offsets[row, i]
    for turn in range(ROUNDS):
        middle = wp.vec2(0.0, 0.0)
        if 2 * turn >= ROUNDS:
            for i in range(count):
                middle += here[row, i] / float(count)
        for i in range(count):
            place = here[row, i] - middle
            distance = wp.length(place)
            if distance > radius:
                place *= 1.0 - PULL * (distance - radius) / distance
            there[row, i] = place
        for i in range(count):
            moved = there[row, i]
            for j in range(count):
                if j != i:
                    between = there[row, i] - there[row, j]
                    gap = wp.length(between)
                    if gap < SAME:
                        between = wp.vec2(SAME * float(i - j), 0.0)
                        gap = wp.length(between)
                    if gap < apart:
                        moved += between * (0.5 * (apart - gap) / gap)
            here[row, i] = moved
