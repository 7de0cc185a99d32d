"""Controls in limits against a search of all sets of bounds, and the order of what they do."""

import itertools

import numpy as np

from zivi.control.box_least_squares import allocated, in_box


def by_force(matrix, right, limits):
    best, least = None, np.inf
    for sides in itertools.product((0, 1, 2), repeat=len(limits)):
        x, inside = np.empty(len(limits)), np.array(sides) == 2
        x[~inside] = [limits[j, sides[j]] for j in np.flatnonzero(~inside)]
        if inside.any():
            left = right - matrix[:, ~inside] @ x[~inside]
            x[inside] = np.linalg.pinv(matrix[:, inside]) @ left
        if np.all(x >= limits[:, 0] - 1e-12) and np.all(x <= limits[:, 1] + 1e-12):
            value = np.sum((matrix @ x - right) ** 2)
            if value < least:
                best, least = x, value
    return best, least


def test_least_squares_in_a_box_are_those_of_the_best_set_of_bounds():
    source = np.random.default_rng(3)
    for _ in range(150):
        r, k = int(source.integers(1, 5)), int(source.integers(1, 6))
        matrix, right = source.normal(size=(k, r)), 3.0 * source.normal(size=k)
        limits = np.sort(source.normal(size=(r, 2)), axis=1)
        x = in_box(matrix, right, limits)
        assert np.all((x >= limits[:, 0]) & (x <= limits[:, 1]))
        least = by_force(matrix, right, limits)[1]
        assert np.sum((matrix @ x - right) ** 2) <= least + 1e-10 * (1 + least)


def test_gaps_come_first_then_the_rest_then_small_controls():
    source = np.random.default_rng(4)
    for _ in range(50):
        gaps = source.normal(size=(1, 4)), source.normal(size=1)
        rest = source.normal(size=(2, 4)), source.normal(size=2)
        size = source.uniform(0.5, 2.0, 4)
        u, limited = allocated(gaps, rest, None, size)
        both, right = np.concatenate([gaps[0], rest[0]]), np.concatenate([gaps[1], rest[1]])
        np.testing.assert_allclose(both @ u, right, atol=1e-12)
        assert not limited
        # the shortest in units of the sizes
        free = np.linalg.svd(both * size)[2][3:]
        np.testing.assert_allclose(free @ (u / size), 0.0, atol=1e-12)


def test_what_limits_take_they_take_from_the_rest():
    gaps, rest = (
        (np.array([[1.0, 1.0]]), np.array([1.5])),
        (np.array([[1.0, -1.0]]), np.array([4.0])),
    )
    limits = np.array([[-1.0, 1.0], [-1.0, 1.0]])
    u, limited = allocated(gaps, rest, limits, np.ones(2))
    assert limited
    np.testing.assert_allclose(u, [1.0, 0.5], atol=1e-6)
