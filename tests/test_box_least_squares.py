"""Controls in limits against a search of all sets of bounds, and the order of what they do."""

import itertools

import numpy as np
import pytest

from inside import _zivi


def allocated(gaps, rest, limits):
    """Give the controls of a system of unit masses, and whether limits act."""
    n, (normals, pulls), (matrix, wanted) = len(rest[1]), gaps, rest
    bounds = None if limits is None else [tuple(it) for it in limits]
    none = np.zeros(len(pulls))
    return _zivi.controls(np.eye(n), np.zeros(n), normals, none, matrix, pulls, wanted, bounds)[:2]


def in_box(matrix, right, limits):
    """Give the least squares in a box: a system without gaps."""
    none = np.zeros((0, len(right))), np.zeros(0)
    return allocated(none, (matrix, right), limits)[0]


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
        normals, pulls = source.normal(size=(1, 3)), source.normal(size=1)
        matrix, wanted = source.normal(size=(3, 4)), source.normal(size=3)
        u, limited = allocated((normals, pulls), (matrix, wanted), None)
        split = np.linalg.qr(normals.T, mode="complete")[0][:, 1:].T
        moved = matrix @ u
        np.testing.assert_allclose(normals @ moved, pulls, atol=1e-12)
        np.testing.assert_allclose(split @ moved, split @ wanted, atol=1e-12)
        assert not limited
        # the shortest
        free = np.linalg.svd(matrix)[2][3:]
        np.testing.assert_allclose(free @ u, 0.0, atol=1e-12)


def test_what_limits_take_they_take_from_the_rest():
    gaps = np.array([[1.0, 1.0]]), np.array([1.5])
    limits = np.array([[-1.0, 1.0], [-1.0, 1.0]])
    # across the gap 4 is asked for
    u, limited = allocated(gaps, (np.eye(2), np.array([2.0, -2.0])), limits)
    assert limited
    np.testing.assert_allclose(u, [1.0, 0.5], atol=1e-6)


def test_controls_that_do_not_reach_a_gap_are_told():
    gaps = np.array([[0.0, 1.0]]), np.array([1.0])
    with pytest.raises(ValueError, match="must reach all 1 gaps"):
        allocated(gaps, (np.array([[1.0], [0.0]]), np.zeros(2)), None)
