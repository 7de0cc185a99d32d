"""What users would write with numba: Lemke's method, and balls impact by impact."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

Array = Any


@numba.njit(cache=True)
def _pivot(tableau: Array, row: int, column: int) -> None:
    tableau[row] /= tableau[row, column]
    for i in range(len(tableau)):
        if i != row and tableau[i, column] != 0.0:
            tableau[i] -= tableau[i, column] * tableau[row]


@numba.njit(cache=True)
def lemke(M: Array, q: Array) -> Array:
    """Solve ``x >= 0``, ``M x + q >= 0``, ``x'(M x + q) = 0`` by complementary pivots on a tableau.

    NaN where the path ends on a ray. No scaling, no order of ties, no check of the solution.
    """
    n = len(q)
    x = np.zeros(n)
    if q.min() >= 0.0:
        return x
    tableau = np.zeros((n, 2 * n + 2))
    tableau[:, :n] = np.eye(n)
    tableau[:, n : 2 * n] = -M
    tableau[:, 2 * n] = -1.0
    tableau[:, 2 * n + 1] = q
    basis = np.arange(n)
    row, column = int(np.argmin(q)), 2 * n
    for _ in range(50 * n):
        _pivot(tableau, row, column)
        leaving, basis[row] = basis[row], column
        if leaving == 2 * n:
            for i in range(n):
                if n <= basis[i] < 2 * n:
                    x[basis[i] - n] = tableau[i, 2 * n + 1]
            return x
        column = leaving + n if leaving < n else leaving - n
        row, least = -1, np.inf
        for i in range(n):
            if tableau[i, column] > 1e-11:
                ratio = tableau[i, 2 * n + 1] / tableau[i, column]
                if ratio < least or (ratio == least and basis[i] == 2 * n):
                    row, least = i, ratio
        if row < 0:
            break
    return np.full(n, np.nan)


@numba.njit(cache=True)
def balls(e: Array, height: float, g: float, slowest: float) -> Array:
    """Follow balls impact by impact down to a part of the first speed: the times of rest."""
    times = np.empty(len(e))
    for i in range(len(e)):
        u = np.sqrt(2.0 * g * height)
        t, least = u / g, slowest * u
        while u > least:
            u *= e[i]
            t += 2.0 * u / g
        times[i] = t + 2.0 * u * e[i] / (g * (1.0 - e[i]))
    return times
