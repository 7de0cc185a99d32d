"""Whether flights of linear systems miss an impact: random systems beside exact propagation.

    python benchmarks/linear_certified.py [systems]

Systems of 2 to 8 coordinates whose damping is not proportional, every third with a singular
stiffness, every third driven at a frequency of the undamped system without damping, between two
gaps. The motion is propagated anew by matrix exponentials from impact to impact at the times that
zivi gives. At each the gap has to vanish, and between them the Bernstein coefficients of its Taylor
polynomial, over parts that are halved until they do, have to show that no gap falls below zero by
more than 1e-12 of the coordinates. Prints how many impacts there were, the largest gap at one, and
how often a gap vanished between two, or could not be certified.
"""

from __future__ import annotations

import sys
from math import comb
from typing import NamedTuple

import numpy as np
from scipy import linalg

import zivi

END = 8.0
SLOW = 1e-3
"""Impacts are followed until one is slower than this (m/s)."""
DEGREE, DEEPEST = 24, 40
CLEAR = 1e-12
"""A gap below zero by less, relative to the coordinates, has rounding in it."""
SAME = 1e-13
"""A gap that vanishes so shortly before an impact on it (s) is that impact."""
E_GAPS = (0.7, 0.5)


class Case(NamedTuple):
    """A system, and its matrix of first order in ``(q, q', cos, sin, 1)``."""

    system: zivi.LinearSystem
    A: np.ndarray
    rows: np.ndarray
    start: tuple[np.ndarray, np.ndarray]
    mobility: np.ndarray


def draw(case: int) -> Case:
    """Draw a system."""
    rng = np.random.default_rng([24, case])
    n = int(rng.integers(2, 9))
    a, b, c = rng.normal(size=(3, n, n))
    M, K, C = np.eye(n) + 0.2 * a @ a.T / n, 20 * b @ b.T / n, 0.3 * c @ c.T / n
    if case % 3 == 1:
        b[:, 0] = 0.0
        K = 20 * b.T @ b / n
    omega = rng.uniform(0.5, 6.0)
    if case % 3 == 2:
        C = np.zeros((n, n))
        omega = float(np.sqrt(linalg.eigh(K, M)[0][rng.integers(n)]))
    p, load = 4 * rng.normal(size=n), rng.normal(size=n)
    normals = rng.normal(size=(2, n))
    gaps = [zivi.LinearGap(normal, 0.2) for normal in normals]
    excitation = [load, zivi.Harmonic(p, omega)]
    system = zivi.LinearSystem(M, C, K, excitation=excitation, gaps=gaps, e=E_GAPS)
    inverse = np.linalg.inv(M)
    A = np.zeros((2 * n + 3, 2 * n + 3))
    A[:n, n : 2 * n] = np.eye(n)
    A[n : 2 * n, :n], A[n : 2 * n, n : 2 * n] = -inverse @ K, -inverse @ C
    A[n : 2 * n, 2 * n], A[n : 2 * n, 2 * n + 2] = inverse @ p, inverse @ load
    A[2 * n, 2 * n + 1], A[2 * n + 1, 2 * n] = -omega, omega
    rows = np.zeros((2, 2 * n + 3))
    rows[:, :n], rows[:, -1] = normals, 0.2
    return Case(system, A, rows, (np.zeros(n), rng.normal(size=n)), inverse @ normals.T)


def bernstein(row: np.ndarray, A: np.ndarray, h: float) -> np.ndarray:
    """Return the matrix that makes of ``y`` the Bernstein coefficients of ``row . y`` over `h`."""
    powers = [row]
    for k in range(1, DEGREE + 1):
        powers.append(powers[-1] @ A * (h / k))
    binomial = [comb(DEGREE, k) for k in range(DEGREE + 1)]
    low = [[comb(i, k) / binomial[k] for k in range(DEGREE + 1)] for i in range(DEGREE + 1)]
    return np.array(low) @ np.array(powers)


def halved(b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the coefficients over both halves, by de Casteljau."""
    left, right, now = [b[0]], [b[-1]], b
    while len(now) > 1:
        now = 0.5 * (now[1:] + now[:-1])
        left.append(now[0])
        right.append(now[-1])
    return np.array(left), np.array(right[::-1])


def vanishes(b: np.ndarray, noise: float, depth: int = 0) -> str:
    """Tell whether a polynomial falls below zero, by its coefficients or those of its parts."""
    if b.min() >= -noise:
        return "open"
    if min(b[0], b[-1]) < -noise:
        return "closed"
    if depth == DEEPEST:
        return "unclear"
    told = [vanishes(half, noise, depth + 1) for half in halved(b)]
    return "closed" if "closed" in told else "unclear" if "unclear" in told else "open"


def followed(system: int) -> tuple[int, float, int, int]:
    """Return the impacts of a system, the largest gap at one, and what was missed or unclear."""
    case = draw(system)
    n, (q, v), A = len(case.start[0]), case.start, case.A
    sol = zivi.simulate(case.system, (0, END), (q, v), zivi.SwitchedRK(rtol=1e-10), t_eval=[])
    t, y = 0.0, np.concatenate([q, v, [1.0, 0.0, 1.0]])
    count, largest, told = 0, 0.0, []
    step, omega = 1.0 / float(np.linalg.norm(A, 2)), A[2 * n + 1, 2 * n]
    ends = [(hit["t"], int(hit["gap"])) for hit in sol.resolved_impacts]
    rests = min([END, *(z for zeno in sol.zeno_times for z in np.ravel(zeno))])
    ends = [it for it in ends if it[0] < rests] + ([] if rests < END else [(END, -1)])
    for until, gap in ends:
        pieces = max(1, int(np.ceil((until - t) / step)))
        h = (until - t) / pieces
        propagator, tests = linalg.expm(A * h), [bernstein(row, A, h) for row in case.rows]
        size = max(1.0, float(np.abs(y[:n]).max()))
        for piece in range(1, pieces + 1):
            end = propagator @ y
            for number, test in enumerate(tests):
                hit = piece == pieces and number == gap
                fall = abs(case.rows[gap][:n] @ end[n : 2 * n]) if hit else 0.0
                told.append(vanishes(test @ y, CLEAR * size + SAME * fall))
            y = end
        t = until
        y[2 * n : 2 * n + 2] = np.cos(omega * t), np.sin(omega * t)
        if gap < 0:
            break
        count += 1
        largest = max(largest, abs(case.rows[gap] @ y) / max(1.0, float(np.abs(y[:n]).max())))
        normal, way = case.rows[gap][:n], case.mobility[:, gap]
        speed = normal @ y[n : 2 * n]
        y[n : 2 * n] -= (1 + E_GAPS[gap]) * speed / (normal @ way) * way
        y[:n] -= (case.rows[gap] @ y) / (normal @ way) * way
        if abs(speed) < SLOW:
            break
    return count, largest, told.count("closed"), told.count("unclear")


def main(systems: int) -> None:
    """Print the sums over all systems."""
    each = [followed(number) for number in range(systems)]
    counts, gaps, missed, unclear = zip(*each, strict=True)
    print(f"{systems} systems, {sum(counts)} impacts, largest gap at one {max(gaps):.1e} m")
    print(f"{sum(missed)} vanish between two, {sum(unclear)} could not be certified")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 2000)
