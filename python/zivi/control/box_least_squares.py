"""Controls within limits: least squares in a box."""

from __future__ import annotations

import itertools

import numpy as np

from zivi.base.check import Array

__all__ = ["allocated", "in_box"]

FIRST = 1e4
"""How much heavier the gaps count than the rest, where limits do not leave room for both."""
SMALL = 1e-12
"""Singular values below this part of the largest are zero."""


def allocated(
    gaps: tuple[Array, Array], rest: tuple[Array, Array], limits: Array | None, size: Array
) -> tuple[Array, bool]:
    r"""Give the controls that do what is asked of the gaps, then as much as they can of the rest.

    .. math::

        \min |S u - s|, \quad \text{then} \quad \min |R u - r|, \quad \text{then} \quad
        \min |u/size|, \qquad u_{min} \le u \le u_{max}

    Where limits act the first two are weighed against each other by 1e8 to 1.

    Parameters
    ----------
    gaps, rest : (ndarray, ndarray)
        S of shape (m, r) and s; R of shape (n - m or n, r) and r.
    limits : ndarray or None
        Shape (r, 2).
    size : ndarray
        What a control counts against the others, shape (r,).

    Returns
    -------
    (ndarray, bool)
        The controls, and whether limits act.
    """
    matrix, right = gaps[0] * size, gaps[1]
    first, null = _least(matrix, right)
    other, wanted = rest[0] * size, rest[1]
    if null.shape[1] and len(wanted):
        first = first + null @ _least(other @ null, wanted - other @ first)[0]
    u: Array = size * first
    if limits is None or (np.all(u >= limits[:, 0]) and np.all(u <= limits[:, 1])):
        return u, False
    scale = FIRST * max(1.0, float(np.abs(other).max(initial=0.0)))
    scale /= max(float(np.abs(matrix).max(initial=0.0)), 1e-300)
    stacked = np.concatenate([scale * matrix, other])
    target = np.concatenate([scale * right, wanted])
    return size * in_box(stacked, target, limits / size[:, None]), True


def _least(matrix: Array, right: Array) -> tuple[Array, Array]:
    """Give the shortest least-squares solution, and a basis of what changes nothing."""
    left, values, rows = np.linalg.svd(matrix)
    rank = int(np.count_nonzero(values > SMALL * values.max(initial=0.0)))
    solved = rows[:rank].T @ ((left[:, :rank].T @ right) / values[:rank])
    return solved, rows[rank:].T


def in_box(matrix: Array, right: Array, limits: Array) -> Array:
    r"""Solve :math:`\min |A x - b|` in a box, by its active sets.

    A set of bounds and the least squares in between are the solution if that is within the bounds
    and the gradient points out at each of them. From the clipped free solution sets are followed by
    the bound that is violated, or let go, most; where that comes back to a set, all are looked at.

    Parameters
    ----------
    matrix : ndarray
        A, shape (k, r).
    right : ndarray
        b, shape (k,).
    limits : ndarray
        Lower and upper bounds, shape (r, 2); infinite for none.

    Returns
    -------
    ndarray
        x, shape (r,).
    """
    low, high = limits.T
    free = _at_bounds(matrix, right, limits, np.zeros(len(low), dtype=int))
    state = np.where(free < low, -1, np.where(free > high, 1, 0))
    seen: set[tuple[int, ...]] = set()
    while tuple(state) not in seen:
        seen.add(tuple(state))
        x = _at_bounds(matrix, right, limits, state)
        over = np.maximum(low - x, x - high)
        slope = matrix.T @ (matrix @ x - right)
        pull = np.where(state == 0, -np.inf, state * slope)
        if over.max() > SMALL * float(1.0 + np.abs(x).max()):
            j = int(over.argmax())
            state = state.copy()
            state[j] = -1 if x[j] < low[j] else 1
        elif pull.max() > SMALL * float(np.abs(matrix.T).sum() * (1.0 + np.abs(right).max())):
            state = state.copy()
            state[int(pull.argmax())] = 0
        else:
            return np.clip(x, low, high)
    return _best(matrix, right, limits)


def _at_bounds(matrix: Array, right: Array, limits: Array, state: Array) -> Array:
    """Solve with some variables at their bounds: -1 the lower, 1 the upper, 0 between."""
    x = np.where(state < 0, limits[:, 0], limits[:, 1])
    inside = state == 0
    if inside.any():
        left = right - matrix[:, ~inside] @ x[~inside]
        x[inside] = np.linalg.lstsq(matrix[:, inside], left, rcond=None)[0]
    return x


def _best(matrix: Array, right: Array, limits: Array) -> Array:
    """Look at all sets."""
    found, least = np.clip(np.zeros(len(limits)), *limits.T), np.inf
    for sides in itertools.product((-1, 0, 1), repeat=len(limits)):
        x = np.clip(_at_bounds(matrix, right, limits, np.array(sides)), *limits.T)
        if not np.all(np.isfinite(x)):
            continue  # no bound on that side
        residual = float(np.sum((matrix @ x - right) ** 2))
        if residual < least:
            found, least = x, residual
    return found
