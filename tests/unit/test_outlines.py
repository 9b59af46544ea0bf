"""Outlines with fewer lines: what is straight becomes one line, and nothing moves further than allowed."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hpp_framework.worlds.outlines import simplify


def _lines(points, *, closed=True):
    points = np.asarray(points, np.float32)
    after = np.roll(points, -1, 0) if closed else points[1:]
    return np.concatenate([points[: len(after)], after], -1)


def _length(lines):
    return float(np.hypot(lines[:, 2] - lines[:, 0], lines[:, 3] - lines[:, 1]).sum())


def _distance(points, lines):
    """Return the distance (k,) from points (k, 2) to the nearest of lines (s, 4)."""
    start, along = lines[:, :2], lines[:, 2:] - lines[:, :2]
    share = ((points[:, None] - start) * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-12)
    nearest = start + np.clip(share, 0, 1)[..., None] * along
    return np.linalg.norm(points[:, None] - nearest, axis=-1).min(1)


def test_a_square_in_any_order_becomes_four_lines():
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    points = np.concatenate(
        [
            a + np.linspace(0, 1, 10)[:-1, None] * (b - a)
            for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)
        ]
    )
    lines = _lines(points)
    rng = np.random.default_rng(0)
    mixed = rng.permutation(lines)
    turned = np.where(rng.random((len(mixed), 1)) < 0.5, mixed, mixed[:, [2, 3, 0, 1]])
    fewer = simplify(turned, 0.002)
    assert len(fewer) == 4
    assert abs(_length(fewer) - 4) < 1e-5


def test_open_chains_keep_their_ends_and_crossings_stay():
    plus = [_lines([[0, 0], [0.5, 0.0], [1, 0]], closed=False), _lines([[1, 0], [2, 0.001]], closed=False)]
    plus += [_lines([[1, 0], [1, 1]], closed=False)]
    fewer = simplify(np.concatenate(plus), 0.01)
    assert len(fewer) == 3
    ends = {(round(x, 3), round(y, 3)) for x, y in fewer.reshape(-1, 2).tolist()}
    assert ends == {(0.0, 0.0), (1.0, 0.0), (2.0, 0.001), (1.0, 1.0)}


def test_nothing_and_outlines_smaller_than_the_tolerance():
    assert simplify(np.zeros((0, 4), np.float32), 0.002).shape == (0, 4)
    assert simplify(np.array([[1, 1, 1, 1]], np.float32), 0.002).shape == (0, 4)
    tiny = _lines([[0, 0], [0.001, 0], [0.001, 0.001], [0, 0.001]])
    assert len(simplify(tiny, 0.01)) > 0


@given(st.integers(0, 10_000), st.integers(3, 40), st.floats(0.001, 0.1))
def test_no_point_is_left_further_off_than_allowed(seed, count, tolerance):
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0, 2 * np.pi, count))
    points = np.stack([np.cos(angles), np.sin(angles)], -1) * rng.uniform(0.9, 1.1, (count, 1))
    lines = _lines(points)
    fewer = simplify(rng.permutation(lines), tolerance)
    assert len(fewer) <= len(lines)
    assert _distance(points, fewer).max() <= tolerance + 1e-4
