"""How many random problems of many families zivi solves, judged by a residual written anew.

Run with the options to compare: ``python benchmarks/vi_families.py [name=value ...]``.
"""

from __future__ import annotations

import dataclasses
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

import zivi

INF = np.inf
Array = Any


@dataclasses.dataclass(frozen=True)
class Problem:
    """A box VI, affine where `M` is given."""

    F: Callable[[Array], Array]
    jac: Callable[[Array], Array]
    lower: Array
    upper: Array
    x0: Array
    M: Array | None = None
    q: Array | None = None


def affine(M: Array, q: Array, lower: Any = 0.0, upper: Any = INF) -> Problem:
    """Pose ``M x + q``."""
    n = len(q)
    bounds = (np.full(n, b, float) if np.isscalar(b) else b for b in (lower, upper))
    return Problem(lambda x: M @ x + q, lambda x: M, *bounds, np.zeros(n), M, q)


def planted(M: Array, rng: Any) -> Problem:
    """Choose `q` such that there is a solution."""
    n = len(M)
    x = np.where(rng.random(n) < 0.5, rng.random(n), 0)
    return affine(M, np.where(x > 0, 0, rng.random(n)) - M @ x)


def definite(rng: Any, n: int) -> Problem:
    """Draw a monotone problem, not symmetric."""
    A = rng.normal(size=(n, n))
    return affine(A @ A.T / n + (A - A.T) + 0.01 * np.eye(n), rng.normal(size=n))


def triangular(rng: Any, n: int) -> Problem:
    """Draw a triangular P0 matrix."""
    M = np.tril(rng.normal(size=(n, n)), -1)
    return planted(M + np.diag(np.where(rng.random(n) < 0.4, 0.0, rng.random(n))), rng)


def steep(rng: Any, n: int) -> Problem:
    """Draw exponentials of linear maps, of slopes up to 1e4 and more."""
    A = rng.normal(size=(n, n)) / np.sqrt(n)
    k = 10 ** rng.uniform(0, 1.2)
    x = np.where(rng.random(n) < 0.5, 2 * rng.random(n), 0)
    push = np.where(x > 0, 0, rng.random(n))

    def value(y: Array) -> Array:
        return A.T @ (np.exp(k * A @ y) - np.exp(k * A @ x)) + 0.1 * (y - x) + push

    def jac(y: Array) -> Array:
        return k * A.T @ (np.exp(k * A @ y)[:, None] * A) + 0.1 * np.eye(n)

    return Problem(value, jac, np.zeros(n), np.full(n, INF), np.zeros(n))


def diagonal_exponentials(rng: Any, n: int) -> Problem:
    """Draw steep exponentials of the single unknowns beside a monotone map."""
    B = rng.normal(size=(n, n))
    S, k = B @ B.T / n + B - B.T, 10 ** rng.uniform(0, 1.5, n)
    q = 5 * rng.normal(size=n)
    return Problem(
        lambda y: S @ y + np.exp(k * y) + q,
        lambda y: S + np.diag(k * np.exp(k * y)),
        np.full(n, -3.0),
        np.full(n, 3.0),
        np.zeros(n),
    )


def scaled(rng: Any, n: int) -> Problem:
    """Draw a monotone problem whose rows and unknowns have units from 1e-8 to 1e8."""
    A = rng.normal(size=(n, n))
    M = A @ A.T / n + 0.5 * (A - A.T) + 0.1 * np.eye(n)
    p = planted(M, rng)
    rows, columns = (10 ** rng.uniform(-8, 8, n) for _ in range(2))
    return affine(rows[:, None] * M * columns, rows * p.q)


def nonmonotone(rng: Any, n: int) -> Problem:
    """Plant a solution in a random matrix."""
    return planted(rng.normal(size=(n, n)), rng)


def stationary(rng: Any, n: int) -> Problem:
    """Draw the stationary points of an indefinite quadratic function on a box."""
    A = rng.normal(size=(n, n))
    return affine(A + A.T, rng.normal(size=n), -1.0, 1.0)


def obstacles(rng: Any, n: int) -> Problem:
    """Draw a membrane between two obstacles."""
    side = int(np.sqrt(n))
    one = 2 * np.eye(side) - np.eye(side, k=1) - np.eye(side, k=-1)
    M = np.kron(one, np.eye(side)) + np.kron(np.eye(side), one)
    s = np.sin(np.linspace(0, np.pi * rng.uniform(1, 4), side))
    mid = (s[:, None] * s).ravel()
    low, high = mid - 0.1 * rng.random(), mid + 0.1 * rng.random()
    return affine(M, 0.05 * rng.normal(size=side * side), low, high)


def transport(rng: Any, n: int) -> Problem:
    """Draw a transport problem with its prices: skew, degenerate."""
    k = max(2, n // 5)
    A = np.zeros((2 * k, k * k))
    for i in range(k):
        A[i, i * k : (i + 1) * k] = -1
        A[k + i, i::k] = 1
    b = np.concatenate([-np.full(k, 1.2), rng.uniform(0.5, 1.0, k)])
    M = np.block([[np.zeros((k * k, k * k)), -A.T], [A, np.zeros((2 * k, 2 * k))]])
    return affine(M, np.concatenate([rng.random(k * k), -b]))


def game(rng: Any, n: int) -> Problem:
    """Draw a bimatrix game as a complementarity problem."""
    A, B = 1 + rng.random((n, n)), 1 + rng.random((n, n))
    Z = np.zeros((n, n))
    return affine(np.block([[Z, A], [B.T, Z]]), -np.ones(2 * n))


def polymatrix(rng: Any, n: int) -> Problem:
    """Draw a game of three players in pairs, with free multipliers."""
    k = max(2, n // 5)
    C = 1 + rng.random((3 * k, 3 * k))
    for p in range(3):
        C[p * k : (p + 1) * k, p * k : (p + 1) * k] = 0
    E = np.kron(np.eye(3), np.ones((k, 1)))
    M = np.block([[C, -E], [E.T, np.zeros((3, 3))]])
    lower = np.concatenate([np.zeros(3 * k), np.full(3, -INF)])
    return affine(M, np.concatenate([np.zeros(3 * k), -np.ones(3)]), lower)


def cournot(rng: Any, n: int) -> Problem:
    """Draw firms whose slopes are infinite at zero output."""
    c, size = rng.uniform(2, 60, n), rng.uniform(5, 50, n)

    def jac(q: Array) -> Array:
        own = 0.8 / size * (np.maximum(q, 0) / size) ** -0.2
        return np.diag(own + 1) + 1

    return Problem(
        lambda q: c + (q / size) ** 0.8 + q - (50 - q.sum()),
        jac,
        np.zeros(n),
        np.full(n, INF),
        np.zeros(n),
    )


def waves(rng: Any, n: int) -> Problem:
    """Draw a map with sines, not monotone, on a box."""
    A, b = rng.normal(size=(n, n)) / np.sqrt(n), rng.normal(size=n)
    return Problem(
        lambda x: A @ x + 2 * np.sin(3 * x) + b,
        lambda x: A + np.diag(6 * np.cos(3 * x)),
        np.full(n, -2.0),
        np.full(n, 2.0),
        rng.uniform(-2, 2, n),
    )


def logarithms(rng: Any, n: int) -> Problem:
    """Draw a map that is not defined at its start."""
    A = rng.normal(size=(n, n))
    S, b = A @ A.T / n, 3 * rng.normal(size=n)
    return Problem(
        lambda x: S @ x + np.log(x) + b,
        lambda x: S + np.diag(1 / x),
        np.zeros(n),
        np.full(n, 5.0),
        np.zeros(n),
    )


def cubes(rng: Any, n: int) -> Problem:
    """Draw a degenerate monotone problem: cubes that vanish at the solution."""
    x = np.where(rng.random(n) < 0.5, rng.random(n), 0)
    A = rng.normal(size=(n, n))
    S = A - A.T
    return Problem(
        lambda y: S @ (y - x) + (y - x) ** 3,
        lambda y: S + np.diag(3 * (y - x) ** 2),
        np.zeros(n),
        np.full(n, INF),
        np.ones(n),
    )


FAMILIES: dict[str, tuple[Callable[[Any, int], Problem], tuple[int, ...]]] = {
    "definite": (definite, (5, 30, 80)),
    "triangular": (triangular, (10, 20, 40)),
    "steep": (steep, (5, 10, 30)),
    "exponentials": (diagonal_exponentials, (5, 20, 50)),
    "scaled": (scaled, (5, 10, 30)),
    "nonmonotone": (nonmonotone, (10, 20, 40)),
    "stationary": (stationary, (5, 20, 60)),
    "obstacles": (obstacles, (36, 144, 576)),
    "transport": (transport, (10, 20, 40)),
    "game": (game, (5, 15, 40)),
    "polymatrix": (polymatrix, (10, 20, 40)),
    "cournot": (cournot, (3, 10, 40)),
    "waves": (waves, (5, 10, 30)),
    "logarithms": (logarithms, (3, 10, 30)),
    "cubes": (cubes, (2, 5, 20)),
}


def draws(name: str, each: int) -> Iterator[Problem]:
    """Draw `each` problems of every size of a family."""
    make, sizes = FAMILIES[name]
    for n in sizes:
        for seed in range(each):
            yield make(np.random.default_rng((sum(map(ord, name)), n, seed)), n)


def residual(p: Problem, x: Array) -> float:
    """Return the natural residual, written anew."""
    parts = np.maximum(x - p.upper, np.minimum(x - p.lower, p.F(x)))
    return float(np.max(np.abs(parts)))


def rounding(p: Problem, x: Array) -> float:
    """Return what rounding of an affine map may add to the residual."""
    if p.M is None or p.q is None:
        return 0.0
    return float(8 * np.finfo(float).eps * np.max(np.abs(p.M) @ np.abs(x) + np.abs(p.q)))


def solved(p: Problem, **options: Any) -> zivi.VIResult:
    """Solve one."""
    chosen = zivi.VIOptions(**options)
    if p.M is not None:
        return zivi.solve_avi(p.M, p.q, p.lower, p.upper, p.x0, options=chosen, time_limit=20)
    return zivi.solve_vi(p.F, p.lower, p.upper, p.x0, jac=p.jac, options=chosen, time_limit=20)


@dataclasses.dataclass
class Count:
    """What came of the problems of a family."""

    drawn: int = 0
    solved: int = 0
    false: int = 0
    """Called solved without being it."""
    pivots: int = 0
    seconds: float = 0.0
    stages: dict[str, int] = dataclasses.field(default_factory=dict)


def counted(name: str, each: int, **options: Any) -> Count:
    """Solve `each` problems of every size of a family."""
    count, began = Count(), time.process_time()
    for p in draws(name, each):
        with np.errstate(all="ignore"):
            res = solved(p, **options)
            r = residual(p, res.x)
        count.drawn += 1
        count.solved += res.success
        count.pivots += res.n_pivots
        limit = 1.01 * max(res.tolerance, 1e-9) + rounding(p, res.x)
        count.false += bool(res.success and not r <= limit)
        stage = res.stage if res.success else "-"
        count.stages[stage] = count.stages.get(stage, 0) + 1
    count.seconds = time.process_time() - began
    return count


def main(each: int, **options: Any) -> None:
    """Print a line for each family."""
    solved_, drawn = 0, 0
    for name in FAMILIES:
        it = counted(name, each, **options)
        solved_, drawn = solved_ + it.solved, drawn + it.drawn
        told = " ".join(f"{k}:{v}" for k, v in sorted(it.stages.items()))
        print(f"{name:14} {it.solved:4} / {it.drawn}  false {it.false}  pivots {it.pivots}"
              f"  {it.seconds:7.2f} s  {told}", flush=True)  # fmt: skip
    print("all", solved_, drawn)


if __name__ == "__main__":
    given = dict(it.split("=") for it in sys.argv[1:])
    known = {"True": True, "False": False}
    main(int(given.pop("each", 8)), **{k: known.get(v, v) for k, v in given.items()})
